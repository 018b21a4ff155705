"""Surface that is in a grid more than once: triangles that lie upon others facing the same way."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark.scene.mesh import Mesh
from windmark.scene.triangle_tree import LEAF, TriangleTree

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

UPON = 0.05
"""Part of its height within which a triangle's middle lies upon another: chords of one round surface, 15 degrees of it
long, are a thirtieth of their length from each other and from it."""
ALIKE = 0.9
"""Cosine of the angle up to which two triangles face the same way. The sides of a thin part face opposite ways."""
TWICE = 0.01
"""Part of an area that may be in the grid twice, as where zones meet that do not match: it counts twice in the loads,
which is about so much of them, and is said. More is a zone that is there twice, or a grid of overset zones."""
EDGE = 1e-6
"""Weight of a corner of a triangle below which a place is on the edge across from it."""


@dataclass(frozen=True, eq=False)
class Doubled:
    """What of a surface is in its grid more than once.

    Parameters
    ----------
    extra : (T,) area of each triangle that is too much: of two layers each has half of its own too much
    upon : (T,) a triangle that it lies upon, -1 for none
    """

    extra: Array
    upon: Ints

    def __bool__(self) -> bool:
        return bool((self.upon >= 0).any())


def doubled(mesh: Mesh) -> Doubled:
    """What of a surface is there twice: a zone that is twice in the file, zones of an overset grid that overlap.

    A triangle lies upon another that faces the same way where its middle is over that one's face, within a small part
    of their height. Whether it does is not changed by bending the surface, and is looked for once (`Mesh.moved`).
    """
    still: Mesh = mesh.__dict__.get("_still", mesh)
    found: Doubled | None = still.__dict__.get("_doubled")
    if found is None:
        found = _found(still)
        still.__dict__["_doubled"] = found
    return found


def part_of(mesh: Mesh, triangles: NDArray[np.bool_]) -> Mesh:
    """Some triangles (T,) of a surface; where nothing of the whole is there twice, its part is not looked at."""
    part = replace(mesh, triangles=mesh.triangles[triangles], volume=mesh.volume[triangles])
    if not doubled(mesh):
        part.__dict__["_doubled"] = Doubled(np.zeros(len(part.triangles)), np.full(len(part.triangles), -1, np.int64))
    return part


def _found(mesh: Mesh) -> Doubled:
    extra, upon = np.zeros(len(mesh.triangles)), np.full(len(mesh.triangles), -1, np.int64)
    normals = mesh.triangle_normals()
    twice = np.linalg.norm(normals, axis=1)
    real = np.flatnonzero(np.isfinite(twice) & (twice > 0))
    if len(real) < 2:
        return Doubled(extra, upon)
    from windmark.scene._doubled_kernels import lie_upon

    tree = TriangleTree.of(Mesh.make(mesh.vertices, mesh.triangles[real]))
    own = real[tree.order]
    faces = _Faces.of(tree, normals[own] / twice[own][:, None])
    layers, last = np.zeros(len(own)), np.full(len(own), -1, np.int64)
    lie_upon(tree.boxes, faces.highest(tree.leaves), tree.leaves, LEAF, faces.middle, faces.first, faces.normal,
             faces.weights, faces.height, UPON, ALIKE, EDGE, layers, last)  # fmt: skip
    found = last >= 0
    upon[own[found]] = own[last[found]]
    extra[own] = 0.5 * twice[own] * layers / (1 + layers)
    return Doubled(extra, upon)


@dataclass(frozen=True, eq=False)
class _Faces:
    """In the order of a tree's leaves: middles and first corners (T, 3) of triangles, their unit normals, two columns
    (T, 3, 2) whose products with a place from the first corner are its weights at the others, and heights (T,).
    """

    middle: Array
    first: Array
    normal: Array
    weights: Array
    height: Array

    @staticmethod
    def of(tree: TriangleTree, normal: Array) -> _Faces:
        corner = tree.corners.reshape(-1, 3, 3)
        e, f = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
        twice = np.linalg.norm(np.cross(e, f), axis=1)
        across = np.stack([np.cross(f, normal), np.cross(normal, e)], axis=2) / twice[:, None, None]
        longest = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max(axis=1)
        return _Faces(corner.mean(axis=1), corner[:, 0], normal, across, twice / longest)

    def highest(self, leaves: int) -> Array:
        """Greatest height of a triangle in each node of a tree."""
        out = np.zeros(2 * leaves - 1)
        per_leaf = np.maximum.reduceat(self.height, np.arange(0, len(self.height), LEAF))
        out[leaves - 1 : leaves - 1 + len(per_leaf)] = per_leaf
        for k in range(leaves.bit_length() - 2, -1, -1):
            width = 1 << k
            out[width - 1 : 2 * width - 1] = out[2 * width - 1 : 4 * width - 1].reshape(-1, 2).max(axis=1)
        return out


def zone_of(mesh: Mesh, triangle: int) -> str:
    """What a triangle is of, in words: its block, where the mesh has blocks, and its volume."""
    volume = str(mesh.volume[triangle])
    block = int(np.searchsorted([b.first for b in mesh.blocks], mesh.triangles[triangle, 0], side="right")) - 1
    name = mesh.blocks[block].name if block >= 0 else volume
    return name if name == volume else f"{name} of {volume}"


def doubled_zones(mesh: Mesh, found: Doubled) -> str:
    """The two zones that have most of what is there twice, in words."""
    blocks = np.searchsorted([b.first for b in mesh.blocks], mesh.triangles[:, 0], side="right")
    zone = np.unique(mesh.volume, return_inverse=True)[1] * np.int64(len(mesh.blocks) + 1) + blocks
    on = np.flatnonzero(found.upon >= 0)
    two = np.sort(np.stack([zone[on], zone[found.upon[on]]], axis=1), axis=1)
    pairs, which = np.unique(two, axis=0, return_inverse=True)
    which = which.ravel()
    area = np.bincount(which, found.extra[on], minlength=len(pairs))
    one = int(on[which == int(np.argmax(area))][0])
    names = sorted({zone_of(mesh, one), zone_of(mesh, int(found.upon[one]))})
    more = f" (and so do {len(pairs) - 1} more pairs of zones)" if len(pairs) > 1 else ""
    if len(names) == 1:
        return f"triangles of {names[0]} lie upon others of it{more}"
    return f"{names[1]} lies upon {names[0]}{more}"
