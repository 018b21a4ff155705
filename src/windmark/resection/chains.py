"""Loose segments to ordered lines: welding of equal points, chaining of segments."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


def weld(points: Array, tolerance: float) -> tuple[Ints, Array]:
    """Number points that coincide alike.

    Parameters
    ----------
    points : (N, 3)
    tolerance : points nearer than this are one (and so are chains of such points)

    Returns
    -------
    number : (N,) from 0 to M - 1
    xyz : (M, 3) the first point of each number
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    pairs = cKDTree(points).query_pairs(tolerance, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), shape=(len(points),) * 2)
    count, number = connected_components(graph, directed=False)
    first = np.full(count, len(points))
    np.minimum.at(first, number, np.arange(len(points)))
    return number.astype(np.int64), points[first]


def chain_segments(ends: Ints) -> list[tuple[Ints, Ints]]:
    """Join segments that share end points into lines.

    Parameters
    ----------
    ends : (S, 2) point numbers; segments of no length and repeated segments are left out

    Returns
    -------
    list of (points (n,), segments (n - 1,)). A closed line repeats its first point. Lines end where a
    point has one segment or more than two.
    """
    segment = _distinct(ends)
    at: dict[int, list[int]] = {}
    for s in segment:
        for p in ends[s].tolist():
            at.setdefault(p, []).append(s)
    left = dict.fromkeys(segment)
    stops = [p for p, touching in at.items() if len(touching) != 2]
    lines = []
    # Open lines first, from their ends; what is left over then is closed.
    for p in stops:
        lines += [_walk(p, s, ends, at, left) for s in at[p] if s in left]
    while left:
        s = next(iter(left))
        lines.append(_walk(int(ends[s, 0]), s, ends, at, left))
    return lines


def _distinct(ends: Ints) -> list[int]:
    key = np.sort(ends, axis=1)
    _, first = np.unique(key, axis=0, return_index=True)
    first = np.sort(first)
    return first[ends[first, 0] != ends[first, 1]].tolist()


def _walk(start: int, segment: int, ends: Ints, at: dict[int, list[int]], left: dict[int, None]) -> tuple[Ints, Ints]:
    """Follow segments from a point until the line stops or closes, taking them from ``left``."""
    points, used = [start], []
    while True:
        del left[segment]
        used.append(segment)
        a, b = ends[segment].tolist()
        points.append(b if a == points[-1] else a)
        onward = [s for s in at[points[-1]] if s in left]
        if points[-1] == start or len(at[points[-1]]) != 2 or not onward:
            return np.array(points), np.array(used)
        segment = onward[0]
