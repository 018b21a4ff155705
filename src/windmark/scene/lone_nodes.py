"""Nodes of a grid that lie far away from all their neighbours: fill values and typing errors.

The triangles of such a node are a spike that hides what is behind it and takes values of what it is not. A sharp tip is
none: its neighbours are about as far from each other, or from theirs, as it is from them; or, of a slender cone made of
one fan of triangles, it stands above the middle of a ring of many.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.scene.mesh import Mesh

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

FAR = 4.0
"""So many times as far from its nearest neighbour as these are from each other and from all others of theirs. Cells
grow by less than twice from one to the next."""
FAN, ALIKE, UPRIGHT = 6, 0.1, 0.98
"""A cone's tip: least neighbours, difference of their distances as a part, and cosine to the normal of their ring."""
RING = 3
"""Neighbours of a node within a surface; a corner of a structured block has two."""


@dataclass(frozen=True)
class LoneNode:
    """One such node.

    Parameters
    ----------
    node : its number
    away : distance from its nearest neighbour
    around : radius of its neighbours
    """

    node: int
    away: float
    around: float


def lone_nodes(mesh: Mesh) -> list[LoneNode]:
    """Nodes that are `FAR` from their neighbours, the farthest first; nodes at one place count as one."""
    if not len(mesh.triangles):
        return []
    known = np.asarray(np.isfinite(mesh.vertices).all(axis=1))
    triangles = mesh.triangles[known[mesh.triangles].all(axis=1)].astype(np.int64)
    if not len(_beside(mesh.vertices, triangles)):
        return []
    # In a soup of triangles, and at a pole, a node has its neighbours at other nodes of its place.
    # One number of each place: sorting rows takes twenty times as long.
    x, y, z = np.where(known[:, None], mesh.vertices, 0.0).T
    _, first, of = np.unique(x + np.sqrt(2.0) * y + np.pi * z, return_index=True, return_inverse=True)
    nodes, a, b = _far(mesh.vertices, _beside(mesh.vertices, first[of.ravel()][triangles]))
    found = (_lone(mesh.vertices, int(n), a, b, RING - 1 if mesh.blocks else RING) for n in nodes)
    return sorted((one for one in found if one is not None), key=lambda one: -one.away)


def where(mesh: Mesh, node: int) -> str:
    """A node as its file has it: its indices in its block, or its number, from 0."""
    block = next((b for b in mesh.blocks if b.first <= node < b.first + b.size), None)
    if block is None:
        volume = mesh.volume[(mesh.triangles == node).any(axis=1)]
        return f"node {node}{f' of {volume[0]}' if len(volume) else ''} (from 0)"
    ni, nj, _ = block.shape_ijk
    at = node - block.first
    return f"node i={at % ni}, j={at // ni % nj}, k={at // (ni * nj)} (from 0) of {block.name}"


def _beside(xyz: Array, triangles: Ints) -> Ints:
    """Triangles (T, 3) at and next to nodes whose edges are `FAR` times the opposite sides of all their triangles."""
    shortest, most = np.full(len(xyz), np.inf), np.zeros(len(xyz))
    with np.errstate(over="ignore"):
        side = [np.sqrt(np.square(xyz[triangles[:, k - 2]] - xyz[triangles[:, k - 1]]).sum(axis=1)) for k in range(3)]
    for k in range(3):
        np.maximum.at(most, triangles[:, k], side[k])
        np.minimum.at(shortest, triangles[:, k], np.minimum(side[k - 1], side[k - 2]))
    near = shortest > FAR * most
    near[np.isinf(shortest)] = False
    for _ in range(2):
        chosen = near[triangles].any(axis=1)
        near[triangles[chosen]] = True
    return triangles[chosen]


def _far(xyz: Array, triangles: Ints) -> tuple[Ints, Ints, Ints]:
    """Nodes whose shortest edge is `FAR` times every other edge of all their neighbours; and the edges, both ways."""
    count = len(xyz)
    if not len(triangles):
        return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0, np.int64)
    sides = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    sides = sides[sides[:, 0] != sides[:, 1]]
    code = np.sort(np.concatenate([sides[:, 0] * count + sides[:, 1], sides[:, 1] * count + sides[:, 0]]))
    a, b = np.divmod(code[np.append(True, code[1:] != code[:-1])], count)
    with np.errstate(over="ignore"):
        length = np.sqrt(np.square(xyz[a] - xyz[b]).sum(axis=1))
    start = np.flatnonzero(np.append(True, a[1:] != a[:-1]))
    longest, to, second, shortest = np.zeros(count), np.full(count, -1), np.zeros(count), np.full(count, np.nan)
    longest[a[start]] = np.maximum.reduceat(length, start)
    shortest[a[start]] = np.minimum.reduceat(length, start)
    at = np.flatnonzero(length == longest[a])
    to[a[at]] = b[at]
    second[a[start]] = np.maximum.reduceat(np.where(to[a] == b, 0.0, length), start)
    # Of the neighbour b of a, the longest edge that does not lead to a.
    other = np.where(to[b] == a, second[b], longest[b])
    most = np.zeros(count)
    most[a[start]] = np.maximum.reduceat(other, start)
    return np.flatnonzero(shortest > FAR * most), a, b


def _lone(xyz: Array, node: int, a: Ints, b: Ints, least: int) -> LoneNode | None:
    """A node of `_far`, unless its neighbours stand round it, or are all that there is beside it."""
    ring = b[a == node]
    beyond = np.setdiff1d(b[np.isin(a, ring)], np.append(ring, node))
    if len(ring) < least or not len(beyond):
        return None
    place = xyz[ring]
    around = float(np.linalg.norm(place - np.median(place, axis=0), axis=1).max())
    edges = np.linalg.norm(place - xyz[node], axis=1)
    away = float(edges.min())
    # Of a cone's tip all edges are alike, and far more alike than chance makes those to a ring that lies anywhere.
    if len(ring) >= FAN and np.ptp(edges) < ALIKE * away and _is_tip(place, xyz[node], xyz[beyond]):
        return None
    return LoneNode(node, away, around) if away > FAR * around else None


def _is_tip(ring: Array, tip: Array, beyond: Array) -> bool:
    """Whether a node stands above the middle of its neighbours, and the surface does not go on outside of their ring.

    A cone's goes on behind it, or closes it. A node that was moved out of a surface has that all round.
    """
    middle = ring.mean(axis=0)
    _, _, axes = np.linalg.svd(ring - middle, full_matrices=False)
    height = tip - middle
    up = axes[2] * np.sign(axes[2] @ height)
    if not up @ height > UPRIGHT * np.linalg.norm(height):
        return False
    off, radius = beyond - middle, float(np.linalg.norm(ring - middle, axis=1).max())
    along = off @ up
    outside = np.linalg.norm(off - along[:, None] * up, axis=1) > 1.2 * radius
    return bool(not (outside & (along > -0.5 * radius)).any())
