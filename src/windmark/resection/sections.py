"""Cuts of the mesh with a plane."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError
from windmark.resection.chains import chain_segments, weld
from windmark.resection.visibility import checked_tolerance
from windmark.scene import Mesh
from windmark.scene.shown import ARRAY, check_kinds

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Section:
    """Where a plane cuts the surface: one or more ordered lines, the longest first.

    Parameters
    ----------
    xyz : (N, 3) points in order along their line; a closed line repeats its first point at its end
    line : (N,) int32 number of the line each point belongs to
    arc : (N,) length along the line from its first point
    triangle : (N,) int32 a triangle that holds the point: the one the line goes on in
    barycentric : (N, 2) weights of that triangle's second and third vertex
    closed : (L,) bool per line

    Notes
    -----
    Seen from the tip of the plane's normal, closed lines run counter-clockwise from their point of least
    (x, y, z); open lines run from the end of lesser (x, y, z). False when the plane misses the mesh.
    """

    xyz: Array
    line: NDArray[np.int32]
    arc: Array
    triangle: NDArray[np.int32]
    barycentric: Array
    closed: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.line)

    def lines(self) -> list[slice]:
        """The slice of points of each line."""
        ends = np.searchsorted(self.line, np.arange(len(self.closed) + 1)).tolist()
        return [slice(a, b) for a, b in pairwise(ends)]


def section(mesh: Mesh, point: ArrayLike, normal: ArrayLike, *, spacing: float | None = None) -> Section:
    """Cut the mesh with a plane: the chord at a span station, the ring at a body station.

    Parameters
    ----------
    mesh : in model coordinates; orientation does not matter
    point, normal : (3,) of the plane; the normal of any length
    spacing : distance between points along the lines (adjusted to divide each line in whole steps; the
        points are still on the surface); None for one point at every mesh edge

    Returns
    -------
    Section, empty if the plane misses the mesh. Lines go on across blocks that meet (within 1e-5 of the
    least of `Mesh.sizes`), and end at borders and where more than two sheets meet.

    Raises
    ------
    ValueError
        For a zero normal or a spacing that is not positive.

    Examples
    --------
    >>> import windmark as wm
    >>> plate = wm.Mesh.make([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    >>> cut = wm.section(plate, [0.0, 0.5, 0.0], [0.0, 1.0, 0.0])
    >>> sorted(cut.xyz[:, 0].tolist())  # a point at every edge of the mesh
    [0.0, 1.0, 2.0]
    >>> float(cut.arc[-1]), cut.closed.tolist()
    (2.0, [False])
    """
    check_kinds("section", mesh=(mesh, Mesh), point=(point, ARRAY), normal=(normal, ARRAY))
    origin, n = three_numbers(point, "section: point"), three_numbers(normal, "section: normal")
    if not np.linalg.norm(n) > 0:
        raise UsageError(f"section: normal must not be zero, got {n.tolist()}")
    if spacing is not None and not 0 < spacing < np.inf:
        raise UsageError(f"section: spacing must be a length > 0, got {spacing}")
    n = n / np.linalg.norm(n)
    ends, triangle = _cut_triangles(mesh, (mesh.vertices - origin) @ n)
    if not len(ends):
        return _as_section(mesh, [])
    node, xyz = weld(ends.reshape(-1, 3), checked_tolerance(None, mesh, "section"))
    chains = [_oriented(c, s, xyz, n) for c, s in chain_segments(node.reshape(-1, 2))]
    lines = [_Line(xyz[c], arc_lengths(xyz[c]), triangle[np.append(s, s[-1])], c[0] == c[-1]) for c, s in chains]
    lines.sort(key=lambda line: -line.arc[-1])
    return _as_section(mesh, lines if spacing is None else [_respaced(line, spacing) for line in lines])


def three_numbers(value: ArrayLike, name: str) -> Array:
    """A point or direction (3,), checked."""
    v = np.asarray(value, dtype=float)
    if v.shape != (3,) or not np.isfinite(v).all():
        raise UsageError(f"{name} must be three finite numbers, got {value!r}")
    return v


def _cut_triangles(mesh: Mesh, height: Array) -> tuple[Array, NDArray[np.int32]]:
    """Ends (S, 2, 3) of the segments in which the triangles are cut, and the triangles (S,).

    A vertex in the plane counts as above it, so every cut triangle is crossed in exactly two edges and
    a surface that lies in the plane or touches it from above gives nothing.
    """
    above = height[mesh.triangles] >= 0
    count = above.sum(axis=1)
    which = np.flatnonzero((count == 1) | (count == 2))
    # The vertex that is alone on its side, then the two others.
    alone = np.argmax(above[which] == (count[which] == 1)[:, None], axis=1)
    corner = mesh.triangles[which[:, None], (alone[:, None] + np.arange(3)) % 3]
    tip, others = corner[:, :1], corner[:, 1:]
    # Each edge from its lower to its upper vertex number: both its triangles find the very same point.
    low, high = np.minimum(tip, others), np.maximum(tip, others)
    t = height[low] / (height[low] - height[high])
    ends = mesh.vertices[low] + t[..., None] * (mesh.vertices[high] - mesh.vertices[low])
    return ends, which.astype(np.int32)


def _oriented(chain: NDArray[np.int64], segments: NDArray[np.int64], xyz: Array, n: Array
              ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:  # fmt: skip
    """The chain in the direction, and a closed one from the point, that `Section` promises."""
    points = xyz[chain]
    if chain[0] != chain[-1]:
        backwards = tuple(points[-1]) < tuple(points[0])
    else:
        first = int(np.lexsort(points[:-1, ::-1].T)[0])
        chain = np.append(np.roll(chain[:-1], -first), chain[first])
        segments = np.roll(segments, -first)
        p = xyz[chain] - xyz[chain[0]]
        backwards = np.cross(p[:-1], p[1:]).sum(axis=0) @ n < 0
    return (chain[::-1], segments[::-1]) if backwards else (chain, segments)


def arc_lengths(points: Array) -> Array:
    """Length along a polyline (N, 3) from its first point, (N,)."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))


class _Line(NamedTuple):
    """One line of a section; a point's triangle is that of the segment that begins there."""

    points: Array
    arc: Array
    triangle: NDArray[np.int32]
    closed: bool


def _respaced(line: _Line, spacing: float) -> _Line:
    """Points in equal steps along a line."""
    new = np.linspace(0.0, line.arc[-1], max(1, round(line.arc[-1] / spacing)) + 1)
    segment = np.clip(np.searchsorted(line.arc, new, side="right") - 1, 0, len(line.arc) - 2)
    return _Line(at_arc(line.points, line.arc, new), new, line.triangle[segment], line.closed)


def at_arc(points: Array, arc: Array, stations: Array) -> Array:
    """Points of a polyline at arc lengths."""
    return np.stack([np.interp(stations, arc, points[:, k]) for k in range(3)], axis=1)


def _as_section(mesh: Mesh, lines: list[_Line]) -> Section:
    xyz = np.concatenate([np.zeros((0, 3)), *(line.points for line in lines)])
    triangle = np.concatenate([np.zeros(0, np.int32), *(line.triangle for line in lines)])
    arc = np.concatenate([np.zeros(0), *(line.arc for line in lines)])
    number = np.repeat(np.arange(len(lines), dtype=np.int32), [len(line.arc) for line in lines])
    closed = np.array([line.closed for line in lines], dtype=bool)
    return Section(xyz, number, arc, triangle, _weights(mesh, triangle, xyz), closed)


def _weights(mesh: Mesh, triangle: NDArray[np.int32], xyz: Array) -> Array:
    """Weights (N, 2) of the second and third vertex for points in the planes of their triangles."""
    a, b, c = (mesh.vertices[mesh.triangles[triangle, k]] for k in range(3))
    e, f, p = b - a, c - a, xyz - a
    n = np.cross(e, f)
    nn = np.einsum("nk,nk->n", n, n)
    w1 = np.einsum("nk,nk->n", np.cross(p, f), n)
    w2 = np.einsum("nk,nk->n", np.cross(e, p), n)
    return np.stack([w1, w2], axis=1) / np.where(nn > 0, nn, np.nan)[:, None]
