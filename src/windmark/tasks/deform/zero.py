"""The wind-off state that everything is relative to, and how well the difference from it is known.

The markers' places are corrected by the wind-off images first (`zero_markers`): what these images' noise does to the
zero is from then on in the places, and so in the covariance of every later state, which is that of its difference from
the zero. The table's errors are in both and leave with the difference. Two things no such covariance has: noise that
did not go into the places because the table is better than the images, and wind-off frames that are not of one state.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark.deformation import Deformation, SpanValues, Stations, span_values
from windmark.deformation.discs import OtherDiscs, sigmas_of
from windmark.deformation.volumes import Placed
from windmark.errors import g2, plus_minus
from windmark.geometry import Pose
from windmark.geometry.rotations import hat, log_so3
from windmark.scene import MarkerSet

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

MOTION = ("shift_x", "shift_y", "shift_z", "turn_x_deg", "turn_y_deg", "turn_z_deg")
"""The rigid motion of the model in the tunnel's axes: shift of its markers' centre, rotation vector."""
SURE = 3.0
"""Sigmas from which a shape is another one."""
SCATTER = 4.0
"""Sigmas of a wind-off frame's difference from the mean of all from which they are not of one state: of a hundred
numbers (five frames, twenty of each) one in 160 tests has such a one by chance."""


@dataclass(frozen=True)
class Zero:
    """The wind-off state that results are relative to.

    Parameters
    ----------
    q : (K,) parameters of the laws
    tunnel_from_model : rigid motion
    span : bending and twist, in the model's frame and with the rigid motion; None without stations
    frames : how many frames it is the mean of
    marker, deformed, deformed_sigma : the marker that the laws moved farthest from its table, how far, and its sigma
    more : (K + 6, K + 6) covariance of the laws' parameters and the motion (``exp(delta) @ pose``) that a later
        state's own covariance has not; None for nothing
    apart : (K + 6,) how far the wind-off frames differ in each parameter and each of `MOTION`, in sigmas of one
        frame; None of a single frame
    scatter : name, difference and `apart` of the one that differs most, where that is beyond chance
    """

    q: Array
    tunnel_from_model: Pose
    span: tuple[SpanValues, SpanValues] | None = None
    frames: int = 0
    marker: str = ""
    deformed: float = 0.0
    deformed_sigma: float = 0.0
    more: Array | None = None
    apart: Array | None = None
    scatter: tuple[str, float, float] | None = None

    @staticmethod
    def of(
        states: Sequence[Deformation], stations: Stations | None, markers: MarkerSet, share: float = 1.0
    ) -> Zero:  # fmt: skip
        """The mean of wind-off states, at least one.

        ``share`` of the images' noise went into the places of ``markers``, see `noise_share`.
        """
        q = np.mean([s.q for s in states], axis=0)
        first = states[0].tunnel_from_model
        away = np.mean([(s.tunnel_from_model @ first.inverse()).log() for s in states], axis=0)
        motion, n = Pose.exp(away) @ first, len(states)
        covs = np.array([_own_cov(s) for s in states])
        cov = covs.mean(axis=0)
        noise = cov / (1.0 + share / n)  # of one frame, without that in the markers' places
        apart, worst, scattered = _scatter(states, q, motion, cov, noise, markers)
        more = scattered if scattered is not None else noise * (1.0 - share) / n
        span = None
        if stations is not None:
            values = ([span_values(s, stations, frame=f) for s in states] for f in ("model", "tunnel"))
            span = tuple(_mean(v, scattered is not None) for v in values)
        farthest = _farthest(states, markers)
        return Zero(q, motion, span, n, *farthest, more if more.any() else None, apart, worst)  # type: ignore[arg-type]

    def words(self, unit: str) -> str:
        """How far the laws have it from the table's shape. Pictures do not tell a load from the model's own weight."""
        size = f"up to {plus_minus(self.deformed, self.deformed_sigma)} {unit} (marker {self.marker})"
        if self.deformed < SURE * self.deformed_sigma:
            shape = f"by the laws no other shape than the table's, {size}"
        else:
            shape = (f"by the laws {size} from the table's shape: the model's own weight, a setting, an error of the "
                     "table, or a load; all results are relative to it")  # fmt: skip
        if self.scatter is None:
            return shape
        name, size_of, times = self.scatter
        return (f"{shape}. Its {self.frames} frames are not of one state: they differ in {name} by {g2(size_of)}, "
                f"{g2(times)} times its sigma, and every sigma of what is relative to it contains this scatter: "
                "see whether one of them had a load, or the model moved between them")  # fmt: skip

    def rest(self, placed: Placed, frame: str) -> Array:
        """(N, 3) where bound points are in this state."""
        place = placed.place(self.q)
        return place if frame == "model" else self.tunnel_from_model.apply(place)

    def more_of(self, by_law: Array, by_motion: Array | None = None) -> Array | float:
        """(..., m, m) covariance to be added to that of what moves by (..., m, K) and (..., m, 6); 0.0 for none."""
        if self.more is None:
            return 0.0
        by = np.concatenate([by_law, np.zeros((*by_law.shape[:-1], 6)) if by_motion is None else by_motion], axis=-1)
        return np.asarray(by @ self.more @ np.swapaxes(by, -1, -2))


def displaced_since(
    zero: Zero | None, state: Deformation, placed: Placed, *, frame: str = "tunnel"
) -> tuple[Array, Array]:
    """How points moved since the zero, or from their undeformed places without one.

    Parameters
    ----------
    placed : N points, bound to the laws
    frame : "tunnel", or "model", which leaves the rigid motion out

    Returns
    -------
    (N, 3) displacement and (N, 3, 3) its covariance
    """
    place, cov = state.moved(placed, frame)
    if zero is None:
        return place - placed.xyz, cov
    rest = zero.rest(placed, frame)
    if zero.more is not None:
        by_law, by_motion = placed.linearise(state.q)[1], None
        if frame == "tunnel":
            by_law = state.tunnel_from_model.rotation @ by_law
            by_motion = np.concatenate([-hat(place), np.broadcast_to(np.eye(3), (len(place), 3, 3))], axis=-1)
        cov = cov + zero.more_of(by_law, by_motion)
    return place - rest, cov


def noise_share(table: MarkerSet, cov: Array, seen: NDArray[np.bool_]) -> float:
    """Part of the wind-off images' noise that went into the corrected places of markers.

    A table of unknown sigma is taken to be far worse than the images, and all of it does. Of a better one the images
    correct little: their noise is then in the zero, and not in the places.

    Parameters
    ----------
    table : N markers before they were corrected
    cov, seen : (N, 3, 3) and (N,) of `ZeroMarkers`
    """
    known = seen & (table.sigma > 0).all(axis=1) & np.isfinite(table.sigma).all(axis=1)
    if not known.any():
        return 1.0
    left = np.diagonal(cov[known], axis1=1, axis2=2) / table.sigma[known] ** 2
    return float(np.clip(1.0 - left.mean(), 0.0, 1.0))


def motion_since(state: Pose, first: Pose, centre: Array) -> tuple[Array, Array]:
    """(6,) shift of a centre (3,) and rotation vector in degrees, see `MOTION`, and (6, 6) by ``exp(delta) @ state``.

    ``first``: the motion that it is relative to.
    """
    turn = np.degrees(log_so3((state @ first.inverse()).rotation))
    out = np.concatenate([state.apply(centre) - first.apply(centre), turn])
    j = np.zeros((6, 6))
    j[:3, :3], j[:3, 3:], j[3:, :3] = -hat(state.apply(centre)), np.eye(3), np.degrees(np.eye(3))
    return out, j


def motion_point(markers: MarkerSet) -> Array:
    """(3,) the point of the model whose shift is reported: the mean place of its markers."""
    return np.asarray(markers.xyz[markers.role != "wall"].mean(axis=0))


def discs_of(states: Sequence[Deformation]) -> OtherDiscs | None:
    """What other discs change in the laws' parameters and the motion (K + 6,) of wind-off states; None for nothing."""
    known = [(s, s.other_discs) for s in states if s.other_discs is not None]
    if not known or len({d.chosen for _, d in known}) > 1:
        return None
    every = np.zeros((len(known), len(known[0][0].q) + 6))
    for row, (state, discs) in zip(every, known, strict=True):
        to, of = _law_and_motion(state)
        row[to] = discs.follow[of]
    return replace(known[0][1], follow=every.sum(axis=0) / len(states))


def since_wind_off(state: Deformation, first: OtherDiscs | None, unit: str) -> Deformation:
    """A state whose covariance is that of its difference from the wind-off one, in which discs of another size change
    the same but for what the model moved since (`discs_of`). ``unit`` of lengths.
    """
    own = state.other_discs
    if own is None or first is None or own.chosen != first.chosen:
        return state
    to, of = _law_and_motion(state)
    left = own.follow.copy()
    left[of] -= first.follow[to]
    more, cov = np.outer(left, left) - np.outer(own.follow, own.follow), state.cov_of_own_discs
    unchecked = own.unchecked(unit, sigmas_of(left, cov))
    others = tuple(d for d in state.unchecked if d.cause != "radii")
    return replace(
        state, cov=state.cov + more, set_up=None if state.set_up is None else state.set_up + more,
        other_discs=replace(own, follow=left), unchecked=(*others, *unchecked),
    )  # fmt: skip


def _law_and_motion(state: Deformation) -> tuple[Ints, Ints]:
    """Which of the K parameters of the laws and 6 of the motion are free, and where they stand in all that is."""
    size = len(state.q)
    where = [np.arange(size)[: len(range(*s.indices(len(state.names))))] if name == "law" else size + np.arange(6)
             for name, s in state.slices.items() if name in ("law", "motion")]  # fmt: skip
    free = [np.arange(len(state.names))[s] for name, s in state.slices.items() if name in ("law", "motion")]
    none = [np.zeros(0, np.int64)]
    return np.concatenate(where or none), np.concatenate(free or none)


def _own_cov(state: Deformation) -> Array:
    """(K + 6, K + 6) covariance of the laws' parameters and the motion; 0 of what is not free.

    What discs of another size would change leaves with the difference.
    """
    to, of = _law_and_motion(state)
    out = np.zeros((len(state.q) + 6, len(state.q) + 6))
    out[np.ix_(to, to)] = state.cov_of_own_discs[np.ix_(of, of)]
    return out


def _scatter(
    states: Sequence[Deformation], q: Array, motion: Pose, cov: Array, noise: Array, markers: MarkerSet
) -> tuple[Array | None, tuple[str, float, float] | None, Array | None]:  # fmt: skip
    """What `Zero` has of frames that differ, and the covariance of their mean by that where it is beyond chance.

    ``cov``, ``noise`` : of one of them, with and without what the places of all markers have in common for all frames
    """
    n = len(states)
    if n < 2:
        return None, None, None
    centre = motion_point(markers)
    by = np.eye(len(noise))
    by[len(q) :, len(q) :] = motion_since(motion, motion, centre)[1]
    sigma, own = (np.sqrt(np.diag(by @ cov @ by.T)) for cov in (noise, cov))
    named = np.array([np.r_[s.q - q, motion_since(s.tunnel_from_model, motion, centre)[0]] for s in states])
    # n numbers with the same sigma: each is off their mean by sqrt(1 - 1 / n) of it.
    size, none = np.abs(named).max(axis=0) / np.sqrt(1.0 - 1.0 / n), np.zeros(len(sigma))
    off = np.divide(size, sigma, out=none.copy(), where=sigma > 0)
    apart = np.divide(np.ptp(named, axis=0), own, out=none, where=own > 0)
    k = int(off.argmax())
    if off[k] < SCATTER:
        return apart, None, None
    away = np.array([np.r_[s.q - q, (s.tunnel_from_model @ motion.inverse()).log()] for s in states])
    name = (*states[0].volumes.names, *MOTION)[k]
    return apart, (name, float(np.ptp(named[:, k])), float(apart[k])), away.T @ away / (n * (n - 1))


def _farthest(states: Sequence[Deformation], markers: MarkerSet) -> tuple[str, float, float]:
    """The marker that the laws move farthest in the mean of the states: its name, how far, and the sigma of it."""
    model = np.flatnonzero(markers.role != "wall")
    xyz, volume = markers.xyz[model], markers.volume[model]
    places = [state.place(xyz, volume, frame="model") for state in states]
    change = np.mean([place for place, _ in places], axis=0) - xyz
    size = np.linalg.norm(change, axis=1)
    k = int(size.argmax())
    along = change[k] / size[k] if size[k] > 0 else np.full(3, 3.0**-0.5)
    cov = np.mean([cov[k] for _, cov in places], axis=0) / len(states)
    return str(markers.name[model[k]]), float(size[k]), float(np.sqrt(max(along @ cov @ along, 0.0)))


def _mean(values: Sequence[SpanValues], scattered: bool) -> SpanValues:
    """The mean of n; its covariance by theirs, and by their scatter where they are ``scattered``."""
    n = len(values)
    every = np.array([np.r_[v.bending, v.twist_deg] for v in values])
    cov = np.sum([v.cov for v in values], axis=0) / n**2
    if scattered:
        off = every - every.mean(axis=0)
        cov = cov + off.T @ off / (n * (n - 1))
    return SpanValues(values[0].eta, np.mean([v.bending for v in values], axis=0),
                      np.mean([v.twist_deg for v in values], axis=0), cov)  # fmt: skip
