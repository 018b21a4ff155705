"""Bending and twist against the span: what a deformation means in the words of aeroelasticity, whatever the law.

At each station the chord, a line fixed to the volume, is followed through the laws: bending is how far its middle
rises, twist how far it turns nose-up about the span, both in the frame asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.deformation.result import Deformation
from windmark.errors import UsageError
from windmark.geometry.rotations import hat
from windmark.scene.shown import check_kinds

Array = NDArray[np.float64]

STEP = 1e-5
ALONG_SPAN = 0.87
"""Cosine of up and span from which up is no direction of a bending: of a turn about the span less than half is left in
the twist, none where they are one. A wing with 60 degrees of dihedral and an upright up is just within it."""
ACROSS = 0.25
"""Part of the line from start to end that is across the chord where it is a span: chords along a body lie on it."""


@dataclass(frozen=True)
class Stations:
    """Where bending and twist are asked for.

    Parameters
    ----------
    eta : (S,) what the stations are called on the axis of a plot, usually the part of the span
    fore, aft : (S, 3) the ends of the chords on the undeformed model
    up : (3,) direction of positive bending
    volume : the volume that they are fixed to

    Examples
    --------
    >>> import windmark as wm
    >>> stations = wm.Stations.along([50.0, 0.0, 0.0], [90.0, 400.0, 0.0], 5, volume="wing", chord=[80.0, 0.0, 0.0])
    >>> len(stations), stations.eta.tolist()
    (5, [0.0, 0.25, 0.5, 0.75, 1.0])
    >>> stations.fore[0].tolist(), stations.aft[0].tolist()
    ([10.0, 0.0, 0.0], [90.0, 0.0, 0.0])
    """

    eta: Array
    fore: Array
    aft: Array
    up: Array
    volume: str

    @staticmethod
    def along(
        start: ArrayLike,
        end: ArrayLike,
        count: int | Sequence[float] = 11,
        *,
        volume: str,
        chord: ArrayLike = (1.0, 0.0, 0.0),
        up: ArrayLike = (0.0, 0.0, 1.0),
    ) -> Stations:
        """Stations on a line along the span.

        Parameters
        ----------
        start, end : (3,) its ends
        count : how many, evenly spaced; or their places as parts of the line
        volume : the volume that they are fixed to
        chord : (3,) from the leading towards the trailing edge, which tells nose up from nose down; its length is
            that of the chord (middle on the line)
        up : (3,) made normal to the chord

        Raises
        ------
        ValueError
            For ends that coincide, no station, a chord without length or along ``up``, an ``up`` nearly along the span.
        """
        a, b, c, u = (np.asarray(v, dtype=float) for v in (start, end, chord, up))
        for name, v in (("start", a), ("end", b), ("chord", c), ("up", u)):
            if v.shape != (3,) or not np.isfinite(v).all():
                raise UsageError(f"stations: {name} must be three finite numbers, got {v.tolist()}")
        eta = np.linspace(0.0, 1.0, count) if isinstance(count, int) else np.asarray(count, dtype=float)
        if not len(eta) or not np.isfinite(eta).all():
            raise UsageError(f"stations: expected at least one station, got {count}")
        length = np.linalg.norm(c)
        if not length > 0 or np.linalg.norm(b - a) == 0:
            raise UsageError("stations: chord must have a length, start and end must differ")
        u = u - (u @ c) * c / length**2
        if not np.linalg.norm(u) > 1e-9:
            raise UsageError("stations: up must not lie along the chord")
        span = (b - a) - ((b - a) @ c) * c / length**2
        cosine = abs(u @ span) / (np.linalg.norm(u) * max(float(np.linalg.norm(span)), 1e-300))
        if cosine > ALONG_SPAN and np.linalg.norm(span) > ACROSS * np.linalg.norm(b - a):
            away = float(np.degrees(np.arccos(min(cosine, 1.0))))
            raise UsageError(f"stations: up {_text(up)} is {away:.0f} degrees from the span, the line from start to "
                             "end: no bending is along it and a turn about the span is no twist then; expected the "
                             "direction in which the wing bends, about normal to span and chord")  # fmt: skip
        middle = a + eta[:, None] * (b - a)
        return Stations(eta, middle - 0.5 * c, middle + 0.5 * c, u / np.linalg.norm(u), volume)

    def __len__(self) -> int:
        return len(self.eta)

    @property
    def middle(self) -> Array:
        """(S, 3) of the chords."""
        return 0.5 * (self.fore + self.aft)


def _text(vector: ArrayLike) -> str:
    return "(" + ", ".join(f"{v:g}" for v in np.asarray(vector, dtype=float)) + ")"


@dataclass(frozen=True)
class SpanValues:
    """Bending and twist at S stations.

    Parameters
    ----------
    eta : (S,)
    bending : (S,) rise of the chord's middle along ``up``, length unit
    twist_deg : (S,) nose-up turn of the chord
    cov : (2 S, 2 S) covariance of [bending, twist_deg]
    """

    eta: Array
    bending: Array
    twist_deg: Array
    cov: Array

    @property
    def bending_sigma(self) -> Array:
        """(S,) standard deviation of the bending."""
        return np.sqrt(np.diag(self.cov)[: len(self.eta)])

    @property
    def twist_sigma_deg(self) -> Array:
        """(S,) standard deviation of the twist."""
        return np.sqrt(np.diag(self.cov)[len(self.eta) :])


def span_values(state: Deformation, stations: Stations, *, frame: str = "model") -> SpanValues:
    """Bending and twist of an identified state.

    Parameters
    ----------
    state : the state
    stations : where
    frame : "model": the laws alone; "tunnel": with the rigid motion, so that twist holds the model's pitch, too

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> @wm.law(tip={"unit": "mm", "sigma": 20.0})
    ... def bend(xyz, tip):
    ...     return xyz + np.outer((xyz[:, 1] / 400.0) ** 2, [0.0, 0.0, tip])
    >>> x, y = (v.ravel() for v in np.meshgrid([0.0, 40.0, 80.0], np.linspace(50.0, 400.0, 8)))
    >>> markers = wm.MarkerSet.make([f"m{i}" for i in range(24)], np.c_[x, y, 0 * x], volume="wing")
    >>> camera, pose = wm.Camera((640, 480), 800.0), wm.Pose.look_at([300, 200, 700], [40, 200, 0], [0, 1, 0])
    >>> xy, _ = camera.project(pose.apply(bend.function(markers.xyz, 8.0)))
    >>> seen = wm.Observations(np.zeros(24, dtype=int), np.arange(24), xy, np.tile(0.01 * np.eye(2), (24, 1, 1)))
    >>> wing, view = wm.Volume("wing", bend), wm.View("cam1", cam_from_model=pose)
    >>> state = wm.identify(seen, markers, [wing], camera, [view], free_motion=False)
    >>> values = wm.span_values(state, wm.Stations.along([40, 0, 0], [40, 400, 0], 3, volume="wing"))
    >>> values.bending.round(2).tolist(), bool(abs(values.twist_deg).max() < 0.01)
    ([0.0, 2.0, 8.0], True)
    """
    check_kinds("span_values", state=(state, Deformation), stations=(stations, Stations))
    if frame not in ("model", "tunnel"):
        raise UsageError(f"span_values: frame must be 'model' or 'tunnel', got {frame!r}")
    ends = np.concatenate([stations.fore, stations.aft])
    place, by_q = state.volumes.bind(ends, stations.volume).linearise(state.q)
    by_motion = np.zeros((*place.shape, 6))
    if frame == "tunnel":
        motion = state.tunnel_from_model
        place, by_q = motion.apply(place), motion.rotation @ by_q
        by_motion = np.concatenate([-hat(place), np.broadcast_to(np.eye(3), (len(place), 3, 3))], axis=-1)
    by_free = state.by_free(by_q, by_motion)
    lacking = state.lacking(ends, np.full(len(ends), stations.volume), frame)
    s = len(stations)
    chord = stations.aft - stations.fore
    length = np.linalg.norm(chord, axis=1)
    aft = chord / length[:, None]
    now = place[s:] - place[:s]
    along, rise = (now * aft).sum(axis=1), now @ stations.up
    # Nose-up: the trailing edge goes down.
    twist = np.degrees(np.arctan2(-rise, along))
    turn = (rise[:, None] * aft - along[:, None] * stations.up) / (along**2 + rise**2)[:, None]
    middle = 0.5 * (place[:s] + place[s:]) - stations.middle

    def of(by_ends: Array) -> Array:
        """(2 S, ...) bending and twist by what moves the chords' ends (2 S, 3, ...)."""
        by_bending = np.einsum("i,sif->sf", stations.up, 0.5 * (by_ends[:s] + by_ends[s:]))
        return np.concatenate([by_bending, np.degrees(np.einsum("si,sif->sf", turn, by_ends[s:] - by_ends[:s]))])

    cov = state.propagated(of(by_free), None if lacking is None else of(lacking))
    return SpanValues(stations.eta, middle @ stations.up, twist, cov)
