"""Bodies of a grid that bear no marker: nothing says that they are where the grid has them, or that they are there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.resection.nearest import Search
from windmark.scene import Mesh

Array = NDArray[np.float64]

ALIKE = 1e-5
"""Part of the grid's size within which a mirrored node is another node (files of five digits)."""
MOST_ASKED = 400
"""Nodes of a body that are asked for a partner, evenly taken from more."""


@dataclass(frozen=True)
class Unborne:
    """A body without markers that touches none that bears some.

    Parameters
    ----------
    triangles : (K,) of the mesh
    of : a triangle of the body whose mirror image it is, -1 for none
    axis, about : the coordinate that is mirrored and its value at the plane, where there is such a body
    """

    triangles: NDArray[np.int64]
    of: int = -1
    axis: int = 0
    about: float = 0.0


def unborne(
    mesh: Mesh, xyz: Array, within: float, searched: Callable[[], Search] | None = None
) -> list[Unborne]:
    """Bodies of the grid that bear none of the points (N, 3) within a distance, and touch none that bears some.

    ``searched`` makes the search of the grid, where something else wants it, too.

    Bodies are `Mesh.pieces`. A wing that runs into a body without a common node touches it: their nodes are nearer than
    the longest edges there. Empty where no body bears a point, or all do.
    """
    piece = mesh.pieces
    names = np.unique(piece)
    if len(names) < 2 or not len(xyz):
        return []
    search, nowhere = Search(mesh) if searched is None else searched(), np.full(3, np.nan)
    found = [search.nearest(p, nowhere, "", within) for p in xyz]
    bearing = {int(piece[f[0]]) for f in found if f is not None}
    if not bearing or len(bearing) == len(names):
        return []
    alone = _apart(mesh, piece, bearing)
    return [_of(mesh, piece, k, sorted(bearing)) for k in names.tolist() if k in alone]


def _apart(mesh: Mesh, piece: NDArray[np.int64], bearing: set[int]) -> set[int]:
    """Pieces that touch none of those that bear points, nor one that touches such a one."""
    from scipy.spatial import cKDTree

    node, edge = np.full(len(mesh.vertices), -1, np.int64), np.zeros(len(mesh.vertices))
    corners = mesh.vertices[mesh.triangles]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    for k in range(3):
        node[mesh.triangles[:, k]] = piece
        np.maximum.at(edge, mesh.triangles[:, k], longest)
    known = (node >= 0) & np.isfinite(mesh.vertices).all(axis=1)
    joined, fresh = set(bearing), set(bearing)
    while fresh:
        theirs = np.flatnonzero(known & np.isin(node, list(fresh)))
        rest = np.flatnonzero(known & ~np.isin(node, list(joined)))
        if not len(rest) or not len(theirs):
            break
        away, at = cKDTree(mesh.vertices[theirs]).query(mesh.vertices[rest])
        fresh = set(node[rest[away <= edge[rest] + edge[theirs[at]]]].tolist())
        joined |= fresh
    return set(piece.tolist()) - joined


def _of(mesh: Mesh, piece: NDArray[np.int64], name: int, others: list[int]) -> Unborne:
    """With the body whose mirror image it is, node for node, about a plane across an axis."""
    from scipy.spatial import cKDTree

    mine = np.flatnonzero(piece == name)
    small = ALIKE * mesh.size
    own = mesh.vertices[np.unique(mesh.triangles[mine])]
    for other in others:
        first = np.flatnonzero(piece == other)
        nodes = mesh.vertices[np.unique(mesh.triangles[first])]
        if len(nodes) != len(own):
            continue
        middle = np.stack([(p.min(axis=0) + p.max(axis=0)) / 2 for p in (own, nodes)])
        beside = np.abs(middle[1] - middle[0]) > 2 * small
        if beside.sum() != 1:
            continue
        axis = int(np.argmax(beside))
        about = float(middle[:, axis].mean())
        image = own[:: -(-len(own) // MOST_ASKED)].copy()
        image[:, axis] = 2 * about - image[:, axis]
        if (cKDTree(nodes).query(image)[0] < small).all():
            return Unborne(mine, int(first[0]), axis, about)
    return Unborne(mine)
