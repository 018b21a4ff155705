"""How a surface bends where markers lie on it: the image of a disc on a curved surface is not centred on the disc."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

Array = NDArray[np.float64]

REACH = 3.0
"""Radii of a marker within which nodes tell how its surface bends; farther ones only where there are too few."""
FEWEST, MOST = 12, 100
"""Nodes for the six numbers of a quadric: at least, and as many as are asked where a grid is fine."""
SAME_SIDE = 0.5
"""Cosine between normals from which on a node is on the marker's own side of a thin part."""
UNTOLD = 0.25
"""Part of the nodes' root mean square distance from a plane that a quadric may leave: beyond it the surface is creased
or rough, not curved (a crease in the middle leaves 0.29 of its own)."""


def surface_curvature(
    vertices: Array, triangles: NDArray[np.int32], xyz: ArrayLike, normal: ArrayLike, radius: ArrayLike
) -> Array:
    """Second fundamental form of a surface at markers.

    A quadric over the marker's tangent plane, fitted to the nodes around it, which lie on the surface; its facets do
    not.

    Parameters
    ----------
    vertices, triangles : (V, 3), (T, 3) of the surface, as `Mesh` has them
    xyz, normal : (N, 3) markers on it and their outward normals, in its frame and unit
    radius : (N,) of their discs

    Returns
    -------
    (N, 3, 3) one over the length unit, see `MarkerSet.curvature`: positive where the surface falls away from its
    tangent plane. Zero where normal or radius is NaN, where no surface is within a radius, and where a quadric does
    not describe the nodes: on a crease, on a grid that is rough by more than it is curved, and where it would turn by
    more than a radian within a disc.

    Raises
    ------
    UsageError
        For shapes that do not fit each other.

    Examples
    --------
    >>> import numpy as np
    >>> from windmark.geometry import surface_curvature
    >>> around = np.radians(np.arange(0, 181, 5))  # half a cylinder of radius 4 along y
    >>> along, nodes = np.arange(9.0), np.zeros((len(around), 9, 3))
    >>> nodes[..., 0], nodes[..., 1], nodes[..., 2] = 4 * np.cos(around)[:, None], along, 4 * np.sin(around)[:, None]
    >>> k = (9 * np.arange(len(around) - 1)[:, None] + np.arange(8)).ravel()
    >>> halves = np.stack([k, k + 9, k + 1], axis=1), np.stack([k + 1, k + 9, k + 10], axis=1)
    >>> form = surface_curvature(nodes.reshape(-1, 3), np.concatenate(halves), [[0, 4.2, 4]], [[0, 0, 1]], [0.6])
    >>> bool(abs(form[0, 0, 0] - 1 / 4) < 0.01 and abs(form[0, 1, 1]) < 0.01)
    True
    """
    place, up, r = (np.asarray(a, dtype=float) for a in (xyz, normal, radius))
    if place.ndim != 2 or place.shape[1] != 3 or up.shape != place.shape or r.shape != (len(place),):
        raise UsageError(
            f"surface_curvature: expected xyz (N, 3), normal (N, 3) and radius (N,), got {place.shape}, {up.shape} and "
            f"{r.shape}"
        )
    from scipy.spatial import cKDTree

    out = np.zeros((len(place), 3, 3))
    asked = np.flatnonzero(np.isfinite(np.column_stack([place, up, r])).all(axis=1) & (r > 0))
    used = np.flatnonzero(np.bincount(triangles.ravel(), minlength=len(vertices)))  # others may hold anything
    if not len(asked) or len(used) < FEWEST:
        return out
    tree = cKDTree(vertices[used], balanced_tree=False, compact_nodes=False)
    near = [_around(tree, place[k], r[k]) for k in asked]
    normals = _normals(vertices, triangles, used[np.concatenate(near)])
    for k, some in zip(asked.tolist(), near, strict=True):
        nodes = used[some]
        facing = normals[nodes] @ up[k]
        nodes = nodes[facing * np.sign(facing[0]) > SAME_SIDE]  # a grid may be inside out
        out[k] = _bend(vertices[nodes] - place[k], up[k], r[k])
    return out


def _around(tree: cKDTree, place: Array, radius: float) -> NDArray[np.int64]:
    """The nodes that tell how the surface bends at a place, the nearest first."""
    near = np.asarray(tree.query_ball_point(place, REACH * radius), dtype=np.int64)
    few = np.asarray(tree.query(place, FEWEST)[1])
    if len(near) <= FEWEST:
        return few
    # Drawn: each tenth node of a structured grid may be a row of it.
    return np.append(few[0], np.random.default_rng(len(near)).permutation(near)[:MOST])


def _normals(vertices: Array, triangles: NDArray[np.int32], nodes: NDArray[np.intp]) -> Array:
    """(V, 3) unit normals of some of the nodes, zero for the others."""
    asked = np.zeros(len(vertices), dtype=bool)
    asked[nodes] = True
    corners = triangles[asked[triangles].any(axis=1)]
    a, b, c = (vertices[corners[:, k]] for k in range(3))
    out, area = np.zeros_like(vertices), np.cross(b - a, c - a)
    for k in range(3):
        np.add.at(out, corners[:, k], area)
    out[~asked] = 0.0
    length = np.linalg.norm(out, axis=1, keepdims=True)
    return np.divide(out, length, out=out, where=length > 0)


def _bend(apart: Array, normal: Array, radius: float) -> Array:
    """Second fundamental form (3, 3) from nodes (K, 3), seen from the marker; zero where they do not tell it."""
    flat = np.zeros((3, 3))
    if len(apart) < FEWEST // 2:
        return flat
    axes = np.linalg.svd(normal[None])[2][1:]
    size = np.abs(apart).max()
    # What is near counts most: a quadric is the beginning of a series.
    distance = np.linalg.norm(apart, axis=1)
    weight = 1.0 / (1.0 + (distance / max(radius, np.median(distance) / 2)) ** 2)
    (u, v), z = axes @ apart.T / size, weight * (apart @ normal) / size
    plane = weight[:, None] * np.column_stack([np.ones_like(u), u, v])
    curved = np.column_stack([plane, weight * 0.5 * u * u, weight * u * v, weight * 0.5 * v * v])
    fit = np.linalg.lstsq(curved, z, rcond=1e-9)[0]
    bare = z - plane @ np.linalg.lstsq(plane, z, rcond=1e-9)[0]
    if abs(fit[0]) * size > radius or np.linalg.norm(z - curved @ fit) >= UNTOLD * np.linalg.norm(bare):
        return flat
    # The normal may be a little beside the surface's own: heights over its plane, by the slopes there.
    form = -np.array([[fit[3], fit[4]], [fit[4], fit[5]]]) / (size * np.sqrt(1.0 + fit[1] ** 2 + fit[2] ** 2))
    if np.abs(np.linalg.eigvalsh(form)).max() * radius > 1.0:
        return flat
    return np.asarray(axes.T @ form @ axes)
