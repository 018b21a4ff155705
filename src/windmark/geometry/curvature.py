"""How a surface bends where markers lie on it: the image of a disc on a curved surface is not centred on the disc."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError

Array = NDArray[np.float64]

REACH = 3.0
"""Radii of a marker within which nodes tell how its surface bends; farther ones only where cells are large."""
NEAREST, FEWEST, MOST = 3, 9, 100
"""Nodes whose cells are looked at in any case; nodes for the six numbers of a quadric; as many as a fine grid needs."""
LIKELY, ROUNDING = 0.1, 1e-4
"""Radius of a marker over that of its surface, 1 sigma, before the grid is asked; part of the nodes' heights that may
be rounding."""
SAME_SIDE = 0.5
"""Cosine between normals from which on a node is on the marker's own side of a thin part."""
UNTOLD = 0.25
"""Part of the nodes' root mean square distance from a plane that a quadric may leave: beyond it the surface is creased
or rough, not curved (a crease in the middle leaves 0.29 of its own)."""


def surface_curvature(
    vertices: Array, triangles: NDArray[np.int32], xyz: ArrayLike, normal: ArrayLike, radius: ArrayLike, *,
    reach: float | None = None,
) -> Array:  # fmt: skip
    """Second fundamental form of a surface at markers.

    A quadric over the marker's tangent plane, fitted to the nodes around it, which lie on the surface; its facets do
    not.

    Parameters
    ----------
    vertices, triangles : (V, 3), (T, 3) of the surface, as `Mesh` has them
    xyz, normal : (N, 3) markers on it and their outward normals, in its frame and unit
    radius : (N,) of their discs
    reach : how far from the surface, along its normal, a marker may be that is on it (rough coordinates); None: its
        radius

    Returns
    -------
    (N, 3, 3) one over the length unit, see `MarkerSet.curvature`: positive where the surface falls away from its
    tangent plane. Zero where normal or radius is NaN, where no surface is within reach, and where a quadric does
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
    out = np.zeros((len(place), 3, 3))
    asked = np.flatnonzero(np.isfinite(np.column_stack([place, up, r])).all(axis=1) & (r > 0))
    count = np.bincount(triangles.ravel(), minlength=len(vertices))  # other nodes may hold anything
    used = np.flatnonzero((count > 0) & np.isfinite(vertices).all(axis=1))
    if len(asked) and len(used) >= FEWEST:
        grid = _Nodes(vertices, triangles, used)
        for k in asked.tolist():
            nodes = grid.around(place[k], up[k], r[k])
            out[k] = _bend(vertices[nodes] - place[k], up[k], r[k], r[k] if reach is None else max(reach, r[k]))
    return out


class _Nodes:
    """The nodes of a grid, found by place and by the cells that they share."""

    def __init__(self, vertices: Array, triangles: NDArray[np.int32], used: NDArray[np.intp]) -> None:
        from scipy.spatial import cKDTree

        self.vertices, self.triangles, self.used = vertices, triangles, used
        self.tree = cKDTree(vertices[used], balanced_tree=False, compact_nodes=False)
        flat = triangles.ravel()
        self.corner = np.argsort(flat, kind="stable")  # the triangles' corners, node by node
        self.first = np.searchsorted(flat, np.arange(len(vertices) + 1), sorter=self.corner)

    def around(self, place: Array, normal: Array, radius: float) -> NDArray[np.intp]:
        """The nodes that tell how the surface bends at a place: those within reach, and two rings of cells.

        Rings, since cells may be twenty times as long as they are wide: the nearest nodes are then in one line.
        """
        seed = self.used[self.tree.query(place, NEAREST)[1]]
        near = self.used[self.tree.query_ball_point(place, REACH * radius)]
        near = np.random.default_rng(len(near)).permutation(near)[:MOST]  # each tenth may be a row of the grid
        ring = self._beside(self._beside(seed))
        nodes = np.unique(np.concatenate([seed, near, ring]))
        facing = self._normals(nodes) @ normal
        nearest = facing[np.searchsorted(nodes, seed[0])]
        return np.asarray(nodes[facing * np.sign(nearest) > SAME_SIDE])  # a grid may be inside out

    def _cells(self, nodes: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """(M,) triangles that have a corner at one of some nodes, with the position of that one."""
        count = self.first[nodes + 1] - self.first[nodes]
        which = np.repeat(np.arange(len(nodes)), count)
        at = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count) + self.first[nodes][which]
        return self.corner[at] // 3, which

    def _beside(self, nodes: NDArray[np.intp]) -> NDArray[np.intp]:
        return np.unique(self.triangles[self._cells(nodes)[0]]).astype(np.intp)

    def _normals(self, nodes: NDArray[np.intp]) -> Array:
        """(K, 3) unit normals, area-weighted means of the triangles."""
        cell, which = self._cells(nodes)
        a, b, c = (self.vertices[self.triangles[cell, k]] for k in range(3))
        area = np.cross(b - a, c - a)
        total = np.stack([np.bincount(which, area[:, k], len(nodes)) for k in range(3)], axis=1)
        length = np.linalg.norm(total, axis=1, keepdims=True)
        return np.divide(total, length, out=np.zeros_like(total), where=length > 0)


def _bend(apart: Array, normal: Array, radius: float, reach: float) -> Array:
    """Second fundamental form (3, 3) from nodes (K, 3), seen from the marker; zero where they do not tell it."""
    flat = np.zeros((3, 3))
    if len(apart) < FEWEST:
        return flat
    axes = np.linalg.svd(normal[None])[2][1:]
    # What is near counts most: a quadric is the beginning of a series. In radii of the disc.
    distance = np.linalg.norm(apart, axis=1)
    weight = 1.0 / (1.0 + (distance / max(radius, np.median(distance) / 2)) ** 2)
    (u, v), z = axes @ apart.T / radius, weight * (apart @ normal) / radius
    plane = weight[:, None] * np.column_stack([np.ones_like(u), u, v])
    curved = np.column_stack([plane, weight * 0.5 * u * u, weight * u * v, weight * 0.5 * v * v])
    left = np.linalg.norm(z - curved @ np.linalg.lstsq(curved, z, rcond=None)[0])
    bare = np.linalg.norm(z - plane @ np.linalg.lstsq(plane, z, rcond=None)[0])
    # Likely before the nodes are asked: what they do not tell, spanwise on two rows of them, is flat.
    noise = max(left / np.sqrt(len(z) - 6), ROUNDING * float(np.abs(z).max()))
    likely = np.zeros((3, 6))
    likely[:, 3:] = np.eye(3) * noise / LIKELY
    fit = np.linalg.lstsq(np.vstack([curved, likely]), np.append(z, np.zeros(3)), rcond=None)[0]
    if abs(fit[0]) * radius > reach or np.linalg.norm(z - curved @ fit) >= UNTOLD * bare:
        return flat
    # The normal may be a little beside the surface's own: heights over its plane, by the slopes there.
    form = -np.array([[fit[3], fit[4]], [fit[4], fit[5]]]) / (radius * np.sqrt(1.0 + fit[1] ** 2 + fit[2] ** 2))
    if np.abs(np.linalg.eigvalsh(form)).max() * radius > 1.0:
        return flat
    return np.asarray(axes.T @ form @ axes)
