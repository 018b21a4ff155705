"""Spots of a camera between its pictures: each marker's track in the image, interpolated to another instant.

A marker's image moves smoothly. With pictures up to h apart its straight track is off by a h^2 / 8 at most (a: its
acceleration in the image), against v h / 2 for the nearest picture; the polynomial through up to four pictures leaves
(omega h)^2 of that again. How much it leaves is not known from the tracks alone: what the last picture added by adding
a degree is taken for 1 sigma. It is common to all markers of a picture, so that it may not average away over them: as
a covariance of single spots it is larger by their number.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from windmark.errors import WindmarkError
from windmark.tasks.deform.spots import Labelled
from windmark.tasks.deform.task import Image, Reader, Shot, Station

Array = NDArray[np.float64]

UNKNOWN = 0.25
"""Two pictures show no acceleration: this part of the motion between them is taken for its effect, 1 sigma."""


@dataclass
class Shots:
    """A camera's pictures round an instant, and what was seen in them.

    Parameters
    ----------
    time : (S,) when they were taken, increasing; the last one after ``instant``, the others before it
    image : those that are not known yet, by time
    seen : spots of pictures that earlier frames have looked at, by time
    instant : that is asked for
    """

    time: tuple[float, ...]
    image: Mapping[float, Image]
    seen: dict[float, Labelled]
    instant: float
    _new: dict[float, Labelled] = field(default_factory=dict)

    def look(self, at: Callable[[Image, float], Labelled], *, again: bool) -> Labelled:
        """Spots at the instant; ``at`` looks at one picture, ``again`` also at those that were looked at before."""
        self._new = {}
        for t in self.time:
            if t in self.seen and not (again and t in self.image):
                self._new[t] = self.seen[t]
            elif t in self.image:
                self._new[t] = at(self.image[t], t)
        return interpolated(self._new, self.instant)

    def keep(self) -> None:
        """What was seen last is right."""
        self.seen.update(self._new)


def open_shots(
    shots: tuple[Shot, ...], station: Station, instant: float, nearest: Image, seen: Mapping[float, Labelled] | None,
    read: Reader,
) -> Shots | str:  # fmt: skip
    """The pictures round an instant, those read that were not looked at before; or why that cannot be done.

    ``nearest`` is the image of the one nearest to the instant, which is read already.
    """
    images: dict[float, Image] = {}
    closest = min(shots, key=lambda s: abs(s.instant - instant))
    known = {s.instant: seen[s.instant] for s in shots if seen is not None and s.instant in seen}
    for shot in shots:
        if shot.instant in known:
            continue
        try:
            images[shot.instant] = nearest if shot is closest else read(shot.image, station)
        except WindmarkError as error:
            if shot in shots[-2:]:  # one of the two that the instant is between
                return str(error)
    times = tuple(s.instant for s in shots if s.instant in images or s.instant in known)
    return Shots(times, images, known, instant)


def interpolated(seen: Mapping[float, Labelled], instant: float) -> Labelled:
    """Spots of one camera at an instant from those of pictures round it: markers seen just before and just after.

    Parameters
    ----------
    seen : time -> spots; the last one after the instant, the others before it
    """
    times = sorted(seen)
    before, after = times[-2], times[-1]
    nearest = seen[min((before, after), key=lambda t: abs(t - instant))]
    marker = np.intersect1d(seen[before].marker, seen[after].marker)
    if not len(marker):
        why = seen[before].reason or seen[after].reason or "no marker was seen both before and after"
        return replace(Labelled.none(why), expected=nearest.expected)
    xy, cov = np.zeros((len(marker), 2)), np.zeros((len(marker), 2, 2))
    change = np.full((len(marker), 2), np.nan)
    for pattern in _patterns(seen, times, marker):
        use = [t for t, there in zip(times, pattern.there, strict=True) if there]
        own = marker[pattern.rows]
        place = [_rows(seen[t], own) for t in use]
        points = np.stack([seen[t].xy[k] for t, k in zip(use, place, strict=True)])
        weight, lower = lagrange(use, instant), lagrange(use[1:], instant)
        xy[pattern.rows] = np.tensordot(weight, points, 1)
        cov[pattern.rows] = sum(w**2 * seen[t].cov[k] for w, t, k in zip(weight, use, place, strict=True))
        if len(use) > 2:
            change[pattern.rows] = xy[pattern.rows] - np.tensordot(lower, points[1:], 1)
        else:
            change[pattern.rows] = UNKNOWN * (points[1] - points[0])
    rows = _rows(nearest, marker)
    # One error of all spots of a camera: as a covariance of each it counts with their number.
    common = float((change**2).mean()) * len(marker) * np.eye(2)
    ecc = None if nearest.eccentricity_px is None else nearest.eccentricity_px[rows]
    last = seen[after]
    return Labelled(
        marker, xy, cov, nearest.axes_px[rows], nearest.angle[rows], nearest.by_table[rows], nearest.expected,
        last.known, nearest.radius_px, "", nearest.pose, max(seen[before].off_px, last.off_px), ecc,
        np.broadcast_to(common, cov.shape).copy(), nearest.not_found,
    )  # fmt: skip


def lagrange(times: list[float], instant: float) -> Array:
    """Weights of values at distinct times in the polynomial through them, at an instant."""
    t = np.asarray(times)
    return np.array([np.prod([(instant - u) / (s - u) for u in t if u != s]) for s in t])


@dataclass(frozen=True)
class _Pattern:
    """Markers (by row) that the same pictures show; the last two always do."""

    there: tuple[bool, ...]
    rows: NDArray[np.int64]


def _patterns(seen: Mapping[float, Labelled], times: list[float], marker: NDArray[np.int64]) -> list[_Pattern]:
    """Markers by the pictures without a gap up to the instant in which they were seen."""
    there = np.array([np.isin(marker, seen[t].marker) for t in times])
    for k in range(len(times) - 3, -1, -1):
        there[k] &= there[k + 1]
    kinds, kind = np.unique(there, axis=1, return_inverse=True)
    return [_Pattern(tuple(kinds[:, n].tolist()), np.flatnonzero(kind.reshape(-1) == n)) for n in range(kinds.shape[1])]


def _rows(spots: Labelled, marker: NDArray[np.int64]) -> NDArray[np.int64]:
    """Where markers are among the spots, each of which has another one."""
    order = np.argsort(spots.marker, kind="stable")
    return order[np.searchsorted(spots.marker[order], marker)]
