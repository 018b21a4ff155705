"""The Laplacian of a noisy temperature on the surface, over several lengths: each node's own, and over wider discs.

The noise of a Laplacian over a disc goes with the nodes' spacing over the cube of the disc's radius: that over a node's
neighbours alone says the less the finer the grid is. What flows along the surface is spread over the length that heat
goes in the time; so wider discs are asked as well, and of each node the widest one is taken that no narrower one
contradicts (O. V. Lepski, Theory of Probability and its Applications 35, 1991).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.paint.surface import joined_surface
from windmark.scene import Mesh

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

NARROWEST = 2.3
"""Radius of the narrowest disc, in spacings of the nodes: some sixteen nodes."""
STEP = 2.0**0.5
"""From one radius to the next."""
ACROSS = 4
"""Cells that a radius is cut into: what lies in one of them goes in as one mean."""
LEAST = 9
"""Cells from which a quadric of six terms is fitted."""
CENTRED = 0.25
"""Part of the radius by which the middle of a disc's cells may lie beside its own: beyond, at borders, terms of the
third order would pass for a Laplacian."""


@dataclass(frozen=True, eq=False)
class LateralScale:
    """The Laplacian over discs of one radius.

    Parameters
    ----------
    radius : length unit of the mesh
    rows : (C, V) sparse, the Laplacian at C cells from the values of V nodes, per length unit squared
    cell : (V,) the nearest cell to a node, within a radius; -1 without one
    """

    radius: float
    rows: Any
    cell: NDArray[np.int64]

    def laplacian(self, value: ArrayLike) -> Array:
        """(V,) of values (V,); NaN where a disc has a value that is not known."""
        return self._at_nodes(self.rows @ np.asarray(value, dtype=float))

    def noise(self, variance: ArrayLike) -> Array:
        """(V,) standard deviation of that from variances (V,) that are independent between nodes."""
        return self._at_nodes(np.sqrt(np.maximum(self.rows.multiply(self.rows) @ np.asarray(variance, dtype=float), 0)))

    def _at_nodes(self, of: Array) -> Array:
        if not len(of):
            return np.full(len(self.cell), np.nan)
        return np.where(self.cell >= 0, of[self.cell], np.nan)


def lateral_scales(mesh: Mesh, known: Mask, widest: float) -> tuple[LateralScale, ...]:
    """The scales of a grid, narrowest first.

    Parameters
    ----------
    known : (V,) nodes that have values
    widest : radius up to which discs are made, beyond the narrowest one

    Notes
    -----
    A least-squares quadric in the tangent plane of a cell, whose nodes' mean counts as one value. The other side of a
    thin wing is no neighbour: places are compared together with the normals, in six dimensions.
    """
    surface = joined_surface(mesh)
    known = known & (surface.place >= 0)
    area = surface.laplacian[1]
    if known.sum() < LEAST or not (area > 0).any():
        return ()
    radius = NARROWEST * float(np.sqrt(np.median(area[area > 0])))
    out: list[LateralScale] = []
    while not out or (radius <= widest and out[-1].rows.shape[0]):
        out.append(_scale(mesh, known, radius))
        radius *= STEP
    return tuple(out)


def _scale(mesh: Mesh, known: Mask, radius: float) -> LateralScale:
    from scipy.sparse import csr_array
    from scipy.spatial import cKDTree

    normals = mesh.vertex_normals()
    nodes = np.flatnonzero(known & np.isfinite(normals).all(axis=1))
    six = np.concatenate([mesh.vertices, radius * normals], axis=1)
    key = np.floor(six[nodes] * (ACROSS / radius)).astype(np.int64)
    _, cell, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    mean = csr_array((1 / count[cell.ravel()], (cell.ravel(), nodes)), shape=(len(count), len(known)))
    middle = mean @ six
    tree = cKDTree(middle)
    pairs = tree.query_pairs(radius, output_type="ndarray")
    each = np.arange(len(count))
    i = np.concatenate([pairs[:, 0], pairs[:, 1], each])
    j = np.concatenate([pairs[:, 1], pairs[:, 0], each])
    weights, good = _quadric(middle, i, j, radius)
    keep = good[i]
    number = np.cumsum(good) - 1
    rows = csr_array((weights[keep], (number[i[keep]], j[keep])), shape=(int(good.sum()), len(count))) @ mean
    nearest = np.full(len(known), -1, np.int64)
    if good.any():
        far, own = cKDTree(middle[good]).query(np.nan_to_num(six), distance_upper_bound=radius)
        nearest = np.where(np.isfinite(far), own, -1)
    return LateralScale(radius, rows.tocsr(), nearest)


def _quadric(middle: Array, i: NDArray[np.int64], j: NDArray[np.int64], radius: float) -> tuple[Array, Mask]:
    """(P,) weights of cells j in the Laplacian at cells i, and (C,) cells whose disc is full enough for one."""
    count = len(middle)
    normal = middle[:, 3:] / np.maximum(np.linalg.norm(middle[:, 3:], axis=1, keepdims=True), 1e-30)
    # Any two directions across the normal do: the axis that is least along it gives the first.
    axis = np.eye(3)[np.argmin(np.abs(normal), axis=1)]
    first = np.cross(normal, axis)
    first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-30)
    second = np.cross(normal, first)
    apart = (middle[j, :3] - middle[i, :3]) / radius
    u, v = np.einsum("pk,pk->p", apart, first[i]), np.einsum("pk,pk->p", apart, second[i])
    terms = np.stack([np.ones(len(u)), u, v, u * u, u * v, v * v])
    normals = np.zeros((count, 6, 6))
    for a in range(6):
        for b in range(a, 6):
            normals[:, a, b] = normals[:, b, a] = np.bincount(i, terms[a] * terms[b], minlength=count)
    full = normals[:, 0, 0]
    beside = np.hypot(normals[:, 0, 1], normals[:, 0, 2]) / full
    good = (full >= LEAST) & (beside <= CENTRED) & (np.linalg.matrix_rank(normals, tol=1e-6) == 6)
    wanted = np.array([0, 0, 0, 2.0, 0, 2.0]) / radius**2
    solved = np.zeros((count, 6))
    if good.any():
        solved[good] = np.linalg.solve(normals[good], np.broadcast_to(wanted[:, None], (int(good.sum()), 6, 1)))[..., 0]
    return np.einsum("pk,kp->p", solved[i], terms), good


def widest_agreed(values: Sequence[Array], noises: Sequence[Array], times: float) -> tuple[Array, Array]:
    """(V,) the value of the widest scale that agrees with all narrower ones, and its noise; NaN where none has one.

    Parameters
    ----------
    values, noises : (V,) of each scale, narrowest first; NaN where it has none
    times : standard deviations within which two scales agree
    """
    best, noise = np.array(values[0]), np.array(noises[0])
    agreed = np.ones(len(best), bool)
    for s in range(1, len(values)):
        with np.errstate(invalid="ignore"):
            for k in range(s):
                apart = np.abs(values[s] - values[k]) > times * np.hypot(noises[s], noises[k])
                agreed &= ~apart
        take = agreed & np.isfinite(values[s])
        best, noise = np.where(take, values[s], best), np.where(take, noises[s], noise)
    return best, noise
