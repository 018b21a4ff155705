"""The surface grid of the model: triangles, and the structured blocks they came from."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from windmark.geometry.described import described

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Block:
    """One structured surface block: ``ni * nj`` consecutive vertices from ``first``, i fastest.

    ``shape_ijk`` is the block's shape in the file (one of the three is 1), so results can be
    written back in the file's own order.
    """

    name: str
    shape_ijk: tuple[int, int, int]
    first: int

    @property
    def size(self) -> int:
        """Number of vertices."""
        return int(np.prod(self.shape_ijk))


@described(lambda m: {
    "nodes": len(m.vertices), "triangles": len(m.triangles),
    "volumes": ", ".join(map(str, dict.fromkeys(m.volume.tolist()))) or "none", "unit": m.length_unit or "no unit",
})  # fmt: skip
@dataclass(frozen=True)
class Mesh:
    """A triangulated surface.

    Parameters
    ----------
    vertices : (V, 3) nodes in the project's length unit; node values are arrays (V,) in this order
    triangles : (T, 3) int32 vertex indices, counter-clockwise seen from outside
    volume : (T,) str, the volume each triangle belongs to
    blocks : structured blocks the vertices came from, empty for unstructured meshes
    blanked : (V,) bool, True for nodes the file marks as unused (IBLANK = 0); they are in no triangle
    length_unit : of the vertices: in, ft, mm, cm or m; "" where nothing says it

    Examples
    --------
    >>> import windmark as wm
    >>> corners = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 0.0], [0.0, 1.0, 0.0]]
    >>> plate = wm.Mesh.make(corners, [[0, 1, 2], [0, 2, 3]], "plate")
    >>> plate
    Mesh(nodes=4, triangles=2, volumes=plate, unit=no unit)
    >>> plate.triangle_normals().tolist()  # of twice the triangles' area
    [[0.0, 0.0, 2.0], [0.0, 0.0, 2.0]]
    >>> plate.moved(plate.vertices + [0.0, 0.0, 0.1]).vertices[0].tolist()
    [0.0, 0.0, 0.1]
    """

    vertices: Array
    triangles: NDArray[np.int32]
    volume: NDArray[np.str_]
    blocks: tuple[Block, ...] = ()
    blanked: NDArray[np.bool_] | None = field(default=None)
    length_unit: str = ""

    def __post_init__(self) -> None:
        v, t = np.shape(self.vertices), np.shape(self.triangles)
        if len(v) != 2 or v[1] != 3:
            raise ValueError(f"Mesh: vertices must be (V, 3), got {v}")
        if len(t) != 2 or t[1] != 3:
            raise ValueError(f"Mesh: triangles must be (T, 3), got {t}")
        if len(self.volume) != t[0]:
            raise ValueError(f"Mesh: volume must have {t[0]} entries, got {len(self.volume)}")
        if t[0] and (self.triangles.min() < 0 or self.triangles.max() >= v[0]):
            raise ValueError(f"Mesh: triangles must index the {v[0]} vertices")
        if self.blanked is not None and np.shape(self.blanked) != (v[0],):
            raise ValueError(f"Mesh: blanked must be ({v[0]},), got {np.shape(self.blanked)}")

    @staticmethod
    def make(vertices: Array, triangles: NDArray[np.int32], volume: str | NDArray[np.str_] = "model") -> Mesh:
        """An unstructured mesh."""
        t = np.asarray(triangles, dtype=np.int32).reshape(-1, 3)
        names = np.full(len(t), volume) if isinstance(volume, str) else np.asarray(volume, dtype=np.str_)
        return Mesh(np.asarray(vertices, dtype=float).reshape(-1, 3), t, names)

    def moved(self, vertices: Array) -> Mesh:
        """The same surface with its nodes elsewhere (V, 3); what hangs together in it is not looked for again."""
        out = replace(self, vertices=vertices)
        if len(self.triangles):
            out.__dict__["_parts"] = self._parts
            out.__dict__["_still"] = self.__dict__.get("_still", self)
        return out

    def triangle_normals(self) -> Array:
        """(T, 3) outward normals, length = twice the area (zero for a degenerate triangle)."""
        a, b, c = (self.vertices[self.triangles[:, k]] for k in range(3))
        return np.cross(b - a, c - a)

    def vertex_normals(self) -> Array:
        """(V, 3) unit normals, area-weighted mean of the triangles; NaN for a vertex in no triangle.

        Nodes that several blocks share by position, but not by index, get the normal of their own block.
        """
        n = self.triangle_normals()
        total = np.zeros_like(self.vertices)
        for k in range(3):
            for axis in range(3):
                total[:, axis] += np.bincount(self.triangles[:, k], weights=n[:, axis], minlength=len(self.vertices))
        length = np.linalg.norm(total, axis=1, keepdims=True)
        return np.divide(total, length, out=np.full_like(total, np.nan), where=length > 0)

    @cached_property
    def used(self) -> NDArray[np.intp]:
        """(U,) the nodes that are a corner of a triangle, in order. Others may hold anything: NaN, another zone."""
        mark = np.zeros(len(self.vertices), dtype=bool)
        mark[self.triangles.ravel()] = True
        return np.flatnonzero(mark)

    @property
    def box(self) -> tuple[Array, Array]:
        """Lowest and highest coordinates (3,) of the nodes in use; NaN where there is none."""
        corners = self._box
        return corners[0].copy(), corners[1].copy()

    @cached_property
    def _box(self) -> Array:
        nodes = self.vertices[self.used]
        nodes = nodes[np.isfinite(nodes).all(axis=1)]
        return np.stack([nodes.min(axis=0), nodes.max(axis=0)]) if len(nodes) else np.full((2, 3), np.nan)

    @cached_property
    def diagonal(self) -> float:
        """Length of the diagonal of `box`, 0 for a mesh without triangles; see `sizes` for the scale of tolerances."""
        low, high = self._box
        return float(np.nan_to_num(np.linalg.norm(high - low)))

    @cached_property
    def sizes(self) -> Array:
        """(T,) the size of what each triangle is a part of: the scale of tolerances that ask what hides what.

        That of the whole mesh (`diagonal`), unless a part of it is so much larger than all smaller parts together (a
        far field, a tunnel) that these would be lost in its tolerance; then theirs is the box of their own, but no less
        than the coordinates are, which are as rounded as they are large. Parts are the connected pieces (by
        common nodes) of each run of triangles of one volume and one block.
        """
        if not len(self.triangles):
            return np.zeros(0)
        part = self._parts
        order = np.argsort(part, kind="stable")
        first = np.flatnonzero(np.append(True, np.diff(part[order]) != 0))
        if len(first) == 1:
            return np.full(len(self.triangles), self.diagonal)
        known = np.isfinite(self.vertices).all(axis=1, keepdims=True)
        corners = np.where(known, self.vertices, np.nan)[self.triangles[order]]
        low = np.fmin.reduceat(np.fmin.reduce(corners, axis=1), first)
        high = np.fmax.reduceat(np.fmax.reduce(corners, axis=1), first)
        out = np.empty(len(order))
        out[order] = np.repeat(_part_sizes(low, high), np.diff(np.append(first, len(order))))
        return out

    @cached_property
    def _parts(self) -> NDArray[np.int64]:
        """(T,) the part, see `sizes`, that each triangle belongs to, as any number."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        block = np.searchsorted([b.first for b in self.blocks], self.triangles[:, 0], side="right")
        run = np.cumsum(np.append(False, (self.volume[1:] != self.volume[:-1]) | (np.diff(block) != 0)))
        a, b, c = self.triangles.T
        edges = np.concatenate([a, b]), np.concatenate([b, c])
        count = len(self.vertices)
        graph = coo_array((np.ones(len(edges[0]), dtype=np.int8), edges), shape=(count, count))
        pieces, piece = connected_components(graph, directed=False)
        return np.asarray(run * np.int64(pieces) + piece[a])

    @property
    def parts(self) -> NDArray[np.int64]:
        """(T,) the connected piece, by common nodes of the file, of each run of triangles of one volume and one block:
        any number.
        """
        return self._parts

    @property
    def pieces(self) -> NDArray[np.int64]:
        """(T,) number of the piece of surface that each triangle belongs to: pieces have no node in common.

        Nodes at the borders of blocks that lie together are one. A wing that runs into a body without a common node is
        a piece of its own.
        """
        still: Mesh = self.__dict__.get("_still", self)
        return still._pieces

    @cached_property
    def _pieces(self) -> NDArray[np.int64]:
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components
        from scipy.spatial import cKDTree

        if not len(self.triangles):
            return np.zeros(0, np.int64)
        count = np.int64(len(self.vertices))
        sides = np.sort(self.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64), axis=1)
        side, times = np.unique(sides[:, 0] * count + sides[:, 1], return_counts=True)
        border = np.unique(np.stack(np.divmod(side[times == 1], count)))
        border = border[np.isfinite(self.vertices[border]).all(axis=1)]
        near = cKDTree(self.vertices[border]).query_pairs(TOGETHER * self.size, output_type="ndarray")
        ends = np.concatenate([np.stack(np.divmod(side, count)), border[near].T], axis=1)
        graph = coo_array((np.ones(ends.shape[1], np.int8), (ends[0], ends[1])), shape=(count, count))
        return np.asarray(connected_components(graph, directed=False)[1][self.triangles[:, 0]], np.int64)

    @cached_property
    def size(self) -> float:
        """The size that most triangles are of, 0 without any: `diagonal`, but where a far field is in the grid, too."""
        return float(np.median(self.sizes)) if len(self.triangles) else 0.0


TOGETHER = 1e-6
"""Nodes nearer than this part of the mesh's size are one place (blocks that meet)."""
LARGER = 10.0
"""A part that is so many times larger than all smaller ones together is of another scale."""


def _part_sizes(low: Array, high: Array) -> Array:
    """(P,) see `Mesh.sizes`, of parts with boxes ``low`` to ``high`` (P, 3), NaN for one without a known place."""
    own = np.linalg.norm(high - low, axis=1)
    order = np.argsort(-own, kind="stable")
    below = np.fmin.accumulate(low[order][::-1])[::-1], np.fmax.accumulate(high[order][::-1])[::-1]
    together = np.linalg.norm(below[1] - below[0], axis=1)  # each part with all that are smaller
    begins = np.append(True, own[order][:-1] > LARGER * together[1:])
    size = together[np.maximum.accumulate(np.where(begins, np.arange(len(own)), 0))]
    out = np.empty(len(own))
    out[order] = size
    reach = np.maximum(np.abs(low), np.abs(high)).max(axis=1)
    return np.asarray(np.fmin(np.fmax(out, reach), together[0]))


def structured_triangles(ni: int, nj: int, first: int = 0, reverse: bool = False) -> NDArray[np.int32]:
    """Triangles of an ``ni`` by ``nj`` block, i fastest: two per cell, (2 (ni-1)(nj-1), 3).

    The normal is d/di x d/dj; ``reverse`` turns it round.
    """
    i, j = np.meshgrid(np.arange(ni - 1), np.arange(nj - 1), indexing="xy")
    a = (first + i + ni * j).ravel()
    b, c, d = a + 1, a + 1 + ni, a + ni
    t = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]).astype(np.int32)
    return t[:, ::-1].copy() if reverse else t
