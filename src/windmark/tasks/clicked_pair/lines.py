"""Lines and labels of two pictures' matches, for their picture and for `reconstruct`."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Camera
from windmark.geometry.two_view import epipolar_curve, epipolar_lines
from windmark.scene import Detections
from windmark.tasks.clicked_pair.clicks import Clicks
from windmark.tasks.clicked_pair.result import ClickedPair
from windmark.tasks.reconstruct.pair import PairLines, Side

Array = NDArray[np.float64]


def lines_of(
    result: ClickedPair, clicks: Clicks, names: tuple[str, str], spots: tuple[Detections, Detections],
    sizes: Sequence[tuple[int, int]], cameras: tuple[Camera, Camera] | None,
) -> PairLines:  # fmt: skip
    """Both pictures with the lines of all matches, for the picture of a pair (Fig. 12)."""
    label = tuple(clicks.name[c] if c >= 0 else f"m{k + 1}" for k, c in enumerate(result.click.tolist()))
    here = (spots[0].xy[result.spot_a], spots[1].xy[result.spot_b])
    sides = []
    for s in (0, 1):
        other = here[1 - s]
        if cameras is not None and result.pose is not None:
            step = result.pose if s == 1 else result.pose.inverse()
            curves = tuple(epipolar_curve(p, cameras[1 - s], cameras[s], step) for p in other)
        else:
            matrix = result.fundamental if s == 1 else result.fundamental.T
            curves = tuple(_segment(line, sizes[s]) for line in epipolar_lines(matrix, other))
        rest = np.setdiff1d(np.arange(len(spots[s])), (result.spot_a, result.spot_b)[s])
        sides.append(Side(names[s], here[s], curves, result.distance_px, spots[s].xy[rest], ()))
    return PairLines(label, sides[0], sides[1])


def _segment(line: Array, size_px: tuple[int, int]) -> Array:
    """The part (2, 2) of a straight line within a picture; (0, 2) where it does not pass through."""
    w, h = size_px[0] - 0.5, size_px[1] - 0.5
    a, b, c = line
    ends = [(x, -(a * x + c) / b) for x in (-0.5, w) if b] + [(-(b * y + c) / a, y) for y in (-0.5, h) if a]
    inside = [p for p in ends if -0.5 - 1e-9 <= p[0] <= w + 1e-9 and -0.5 - 1e-9 <= p[1] <= h + 1e-9]
    if len(inside) < 2:
        return np.empty((0, 2))
    points = np.array(inside)
    far = np.linalg.norm(points - points[0], axis=1).argmax()
    return points[[0, far]]


def relabelled(
    result: ClickedPair, clicks: Clicks, names: tuple[str, str], spots: tuple[Detections, Detections]
) -> dict[str, Array]:
    """All matches as a table ``image,name,x,y``, which `reconstruct` takes as labels; names of the user's stay."""
    given = [clicks.name[c] if clicks.named and c >= 0 else "" for c in result.click.tolist()]
    free = (name for k in count(1) if (name := f"m{k:03d}") not in given)
    label = [name or next(free) for name in given]
    xy = np.concatenate([spots[0].xy[result.spot_a], spots[1].xy[result.spot_b]])
    return {"image": np.repeat(names, len(label)), "name": np.array(label * 2), "x": xy[:, 0], "y": xy[:, 1]}
