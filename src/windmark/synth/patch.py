"""Parametric surface patches: the structured blocks of a mesh, and exact places on them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.scene import Block, Mesh, structured_triangles

Array = NDArray[np.float64]

_STEP = 1e-5  # of the parameter range; central differences in float64 then give normals to about 1e-9


@dataclass(frozen=True)
class Patch:
    """One smooth surface ``point(s, t)``, s and t in [0, 1], and the grid that samples it.

    Parameters
    ----------
    name : name of the block
    volume : volume the block belongs to
    point : (..., ), (...) -> (..., 3), vectorised
    ni, nj : nodes along s (fastest) and t
    reverse : the outward normal is d/ds x d/dt, or its opposite where True
    """

    name: str
    volume: str
    point: Callable[[Array, Array], Array]
    ni: int
    nj: int
    reverse: bool = False

    def __post_init__(self) -> None:
        if self.ni < 2 or self.nj < 2:
            raise ValueError(f"Patch {self.name}: ni and nj must be at least 2, got {self.ni} and {self.nj}")

    def nodes(self) -> Array:
        """(ni * nj, 3) nodes, i fastest."""
        s, t = np.meshgrid(np.linspace(0, 1, self.ni), np.linspace(0, 1, self.nj))
        return self.point(s, t).reshape(-1, 3)

    def place(self, s: ArrayLike, t: ArrayLike) -> tuple[Array, Array]:
        """Points that lie on the patch's triangles, and the smooth surface's normals there.

        Parameters
        ----------
        s, t : (N,) in [0, 1]

        Returns
        -------
        xyz : (N, 3) on the flat triangle that holds (s, t), split as `scene.structured_triangles` splits cells
        normal : (N, 3) unit outward normal of the smooth surface
        """
        s, t = np.broadcast_arrays(np.asarray(s, dtype=float), np.asarray(t, dtype=float))
        if ((s < 0) | (s > 1) | (t < 0) | (t > 1)).any():
            raise ValueError(f"Patch {self.name}: s and t must be in [0, 1]")
        i = np.minimum((s * (self.ni - 1)).astype(int), self.ni - 2)
        j = np.minimum((t * (self.nj - 1)).astype(int), self.nj - 2)
        fs, ft = (s * (self.ni - 1) - i)[:, None], (t * (self.nj - 1) - j)[:, None]
        s0, s1 = i / (self.ni - 1), (i + 1) / (self.ni - 1)
        t0, t1 = j / (self.nj - 1), (j + 1) / (self.nj - 1)
        a, b, c, d = self.point(s0, t0), self.point(s1, t0), self.point(s1, t1), self.point(s0, t1)
        low = a + fs * (b - a) + ft * (c - b)  # triangle a, b, c
        high = a + ft * (d - a) + fs * (c - d)  # triangle a, c, d
        return np.where(fs >= ft, low, high), self.normal(s, t)

    def normal(self, s: ArrayLike, t: ArrayLike) -> Array:
        """(N, 3) unit outward normals of the smooth surface at (s, t)."""
        s, t = np.asarray(s, dtype=float), np.asarray(t, dtype=float)
        s0, s1 = np.maximum(s - _STEP, 0), np.minimum(s + _STEP, 1)
        t0, t1 = np.maximum(t - _STEP, 0), np.minimum(t + _STEP, 1)
        n = np.cross(self.point(s1, t) - self.point(s0, t), self.point(s, t1) - self.point(s, t0))
        n = n / np.linalg.norm(n, axis=-1, keepdims=True)
        return -n if self.reverse else n


def assemble(patches: Sequence[Patch]) -> Mesh:
    """The mesh of several patches: blocks in the order given, vertices not shared between blocks."""
    vertices, triangles, volumes, blocks, first = [], [], [], [], 0
    for p in patches:
        vertices.append(p.nodes())
        triangles.append(structured_triangles(p.ni, p.nj, first, p.reverse))
        volumes.append(np.full(len(triangles[-1]), p.volume))
        blocks.append(Block(p.name, (p.ni, p.nj, 1), first))
        first += p.ni * p.nj
    return Mesh(np.concatenate(vertices), np.concatenate(triangles), np.concatenate(volumes), tuple(blocks))


def rectangle(
    name: str, volume: str, corner: ArrayLike, edge_s: ArrayLike, edge_t: ArrayLike, ni: int, nj: int
) -> Patch:
    """A flat panel from a corner and two edges; the outward normal is edge_s x edge_t."""
    c, a, b = (np.array(v, dtype=float) for v in (corner, edge_s, edge_t))
    return Patch(name, volume, lambda s, t: c + s[..., None] * a + t[..., None] * b, ni, nj)
