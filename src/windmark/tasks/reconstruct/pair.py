"""Two pictures of a reconstruction with the epipolar lines of their markers (AIAA 2005-5007, Fig. 12)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.errors import UsageError
from windmark.geometry import Camera, Pose
from windmark.geometry.two_view import epipolar_curve
from windmark.tasks.reconstruct.result import Reconstruction

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Side:
    """One of the two pictures.

    Parameters
    ----------
    name : of the picture
    spots, curves : (K, 2) spots of the markers that both pictures have, and the line of each one's spot in the other
        picture, as it is seen here
    distance_px : (K,) from each spot to its line; NaN where the line does not pass through the picture
    alone : (M, 2) spots of markers that the other picture has not
    missed : lines of markers of the other picture that have no spot here
    """

    name: str
    spots: Array
    curves: tuple[Array, ...]
    distance_px: Array
    alone: Array
    missed: tuple[Array, ...]


@dataclass(frozen=True)
class PairLines:
    """Both pictures; ``names`` (K,) are those of the markers in both."""

    names: tuple[str, ...]
    a: Side
    b: Side

    @property
    def rms_px(self) -> float:
        """Root mean square distance of the spots of both pictures from their lines; NaN where there are none."""
        both = np.concatenate([self.a.distance_px, self.b.distance_px])
        both = both[np.isfinite(both)]
        return float(np.sqrt((both**2).mean())) if len(both) else float("nan")


def pair_lines(result: Reconstruction, a: str, b: str, spots_a: Array, spots_b: Array) -> PairLines:
    """Epipolar lines of all markers that are seen in one or both of two pictures.

    Parameters
    ----------
    a, b : names of two views
    spots_a, spots_b : (N, 2) all spots of the two pictures, as `reconstruct` had them

    Raises
    ------
    ValueError
        For a view that is unknown or has no pose.
    """
    index = {v.name: k for k, v in enumerate(result.views)}
    for name in (a, b):
        if name not in index:
            raise UsageError(f"pair_lines: no view is called {name!r}; there are {', '.join(list(index)[:5])}")
        if result.views[index[name]].cam_from_model is None:
            raise UsageError(f"pair_lines: {name} has no pose: {result.dropped[name]}")
    of = [_spots_of(result, index[name]) for name in (a, b)]
    both = sorted(of[0].keys() & of[1].keys())
    in_a, in_b = ([of[k][m] for m in both] for k in (0, 1))
    only_a, only_b = ([s for m, s in sorted(of[k].items()) if m not in of[1 - k]] for k in (0, 1))
    names = tuple(str(result.markers.name[m]) for m in both)
    return PairLines(
        names, _side(result, index[b], index[a], spots_b, spots_a, in_b, in_a, only_b, only_a),
        _side(result, index[a], index[b], spots_a, spots_b, in_a, in_b, only_a, only_b),
    )  # fmt: skip


def _spots_of(result: Reconstruction, view: int) -> dict[int, int]:
    """{marker: spot} of a view."""
    mine = result.tracks.view == view
    return dict(zip(result.tracks.track[mine].tolist(), result.tracks.detection[mine].tolist(), strict=True))


def _side(
    result: Reconstruction, other: int, here: int, spots_other: Array, spots_here: Array, in_other: list[int],
    in_here: list[int], only_other: list[int], only_here: list[int],
) -> Side:  # fmt: skip
    """What one picture shows: its spots, and the lines of the other one's."""
    cameras = [result.cameras[result.views[v].camera] for v in (other, here)]
    step = _pose(result, here) @ _pose(result, other).inverse()
    curves = _curves(spots_other[in_other], cameras[0], cameras[1], step)
    xy = spots_here[in_here].reshape(-1, 2)
    distance = np.array([_distance(p, c) for p, c in zip(xy, curves, strict=True)])
    missed = _curves(spots_other[only_other], cameras[0], cameras[1], step)
    return Side(result.views[here].name, xy, curves, distance, spots_here[only_here].reshape(-1, 2), missed)


def _pose(result: Reconstruction, view: int) -> Pose:
    pose = result.views[view].cam_from_model
    assert pose is not None
    return pose


def _curves(xy: Array, camera_from: Camera, camera_to: Camera, to_from_from: Pose) -> tuple[Array, ...]:
    return tuple(epipolar_curve(p, camera_from, camera_to, to_from_from) for p in xy)


def _distance(p: Array, line: Array) -> float:
    """From a point to a polyline; a row of NaN separates its parts."""
    start, step = line[:-1], np.diff(line, axis=0)
    good = np.isfinite(step).all(axis=1)
    if not good.any():
        return float("nan")
    start, step = start[good], step[good]
    along = np.clip(((p - start) * step).sum(axis=1) / (step**2).sum(axis=1), 0, 1)[:, None]
    return float(np.linalg.norm(start + along * step - p, axis=1).min())
