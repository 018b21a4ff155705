"""The surface point nearest to a point in space, on the side that is meant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import DataError, UsageError
from windmark.scene import Mesh

Array = NDArray[np.float64]

OTHER_SIDE = 3.0
"""Without a normal, a surface that faces the other way within so many times the distance makes the side unclear."""
_ROUNDING = 1e-5
"""Part of the mesh's size: a point this near to the surface lies on it, whatever is behind (five-digit files)."""


@dataclass(frozen=True)
class SurfacePoints:
    """Points on the surface.

    Parameters
    ----------
    xyz : (N, 3) NaN where there is none
    triangle : (N,) int32 the triangle that holds each, -1 for none
    barycentric : (N, 2) weights of its second and third vertex
    normal : (N, 3) unit normal of that triangle
    distance : (N,) from the point asked for; NaN for none
    either_side : (N,) bool, as near to the opposite side of a thin part, and no normal says which is meant
    """

    xyz: Array
    triangle: NDArray[np.int32]
    barycentric: Array
    normal: Array
    distance: Array
    either_side: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.triangle)

    def on(self, mesh: Mesh) -> Array:
        """(N, 3) the same points on the same grid in another shape (deformed under load)."""
        nodes, weights = self.corners(mesh)
        return np.where((self.triangle >= 0)[:, None], np.einsum("nk,nkj->nj", weights, mesh.vertices[nodes]), np.nan)

    def corners(self, mesh: Mesh) -> tuple[NDArray[np.int32], Array]:
        """(N, 3) nodes of the triangle that holds each, and their weights; of a point without one all weights are 0."""
        on = self.triangle >= 0
        weights = np.column_stack([1 - self.barycentric.sum(axis=1), self.barycentric])
        return mesh.triangles[np.where(on, self.triangle, 0)], np.where(on[:, None], weights, 0.0)


def nearest_on_surface(
    mesh: Mesh,
    xyz: ArrayLike,
    *,
    normal: ArrayLike | None = None,
    volume: NDArray[np.str_] | None = None,
    max_distance: float | None = None,
) -> SurfacePoints:
    """The nearest point of the surface to each of a set of points: pressure taps, a rake, places from a drawing.

    Parameters
    ----------
    mesh : the surface
    xyz : (N, 3); NaN points have no nearest one
    normal : (N, 3) outward normals, NaN rows where unknown: only surface that faces the same way is looked at, so a tap
        on the upper side of a thin trailing edge cannot land on the lower one
    volume : (N,) the volume each point belongs to, "" for any
    max_distance : points farther than this from the surface have none; 0.002 of `Mesh.size` by default

    Returns
    -------
    SurfacePoints

    Raises
    ------
    ValueError
        For a wrong shape, a distance that is not positive, a mesh without triangles.
    """
    points = np.asarray(xyz, dtype=float)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"nearest_on_surface: xyz must be (N, 3), got {points.shape}")
    normals = np.full(points.shape, np.nan) if normal is None else np.asarray(normal, dtype=float)
    if normals.shape != points.shape:
        raise ValueError(f"nearest_on_surface: normal must be {points.shape} as xyz, got {normals.shape}")
    if volume is not None and np.shape(volume) != (len(points),):
        raise ValueError(f"nearest_on_surface: volume must be ({len(points)},), got {np.shape(volume)}")
    limit = reach(mesh, max_distance)
    search = Search(mesh)
    n = len(points)
    out = SurfacePoints(
        np.full((n, 3), np.nan), np.full(n, -1, np.int32), np.full((n, 2), np.nan), np.full((n, 3), np.nan),
        np.full(n, np.nan), np.zeros(n, bool),
    )  # fmt: skip
    for k in np.flatnonzero(np.isfinite(points).all(axis=1)):
        of = "" if volume is None else str(volume[k])
        found = search.nearest(points[k], normals[k], of, limit)
        if found is None:
            continue
        out.triangle[k], out.barycentric[k], out.xyz[k], out.distance[k] = found
        out.normal[k] = search.normal[found[0]]
        if not np.isfinite(normals[k]).all():
            out.either_side[k] = search.two_sided(points[k], found, of)
    return out


def reach(mesh: Mesh, max_distance: float | None) -> float:
    """The distance within which a point belongs to the surface."""
    if max_distance is None:
        return 2e-3 * mesh.size
    if not 0 < max_distance < np.inf:
        raise UsageError(f"nearest_on_surface: max_distance must be a length > 0, got {max_distance}")
    return float(max_distance)


Found = tuple[int, Array, Array, float]


class Search:
    """Triangles in classes of size, each with a tree of middles: what may touch a ball is found without all others."""

    def __init__(self, mesh: Mesh) -> None:
        from scipy.spatial import cKDTree

        self.corners = mesh.vertices[mesh.triangles]
        n = mesh.triangle_normals()
        length = np.linalg.norm(n, axis=1, keepdims=True)
        self.normal = np.divide(n, length, out=np.zeros_like(n), where=length > 0)
        self.volume, self.small = np.asarray(mesh.volume), _ROUNDING * mesh.size
        real = np.flatnonzero((length[:, 0] > 0) & np.isfinite(self.corners).all(axis=(1, 2)))
        if not len(real):
            raise DataError("nearest_on_surface: the mesh has no triangles")
        middle = self.corners.mean(axis=1)
        radius = np.linalg.norm(self.corners - middle[:, None], axis=2).max(axis=1)
        size = np.floor(np.log2(radius[real])).astype(int)
        self.classes = []
        for s in np.unique(size):
            mine = real[size == s]
            self.classes.append((mine, cKDTree(middle[mine]), float(radius[mine].max())))

    def nearest(self, p: Array, normal: Array, volume: str, limit: float) -> Found | None:
        """Triangle, weights, place and distance of the nearest surface within ``limit``; None where there is none.

        ``normal`` (3,): only triangles that face its way; NaN for all.
        """
        ball = min(limit, max(1e-3 * limit, self.small))
        while True:
            found = self._within(p, normal, volume, ball)
            if found is not None and found[3] <= ball:  # nothing nearer can have been left out
                return found
            if ball >= limit:
                return None
            ball = min(limit, 4 * ball)

    def _within(self, p: Array, normal: Array, volume: str, ball: float) -> Found | None:
        mine = np.concatenate([m[tree.query_ball_point(p, ball + radius)] for m, tree, radius in self.classes])
        mine = mine.astype(np.int64)
        if np.isfinite(normal).all():
            mine = mine[self.normal[mine] @ normal > 0]
        if volume:
            mine = mine[self.volume[mine] == volume]
        if not len(mine):
            return None
        weights = nearest_weights(self.corners[mine], p)
        place = np.einsum("nk,nkj->nj", np.column_stack([1 - weights.sum(axis=1), weights]), self.corners[mine])
        distance = np.linalg.norm(place - p, axis=1)
        k = int(np.argmin(distance))
        return int(mine[k]), weights[k], place[k], float(distance[k])

    def two_sided(self, p: Array, found: Found, volume: str) -> bool:
        """Whether a surface that faces the other way is about as near."""
        if found[3] <= self.small:
            return False
        other = self._within(p, -self.normal[found[0]], volume, OTHER_SIDE * found[3])
        return other is not None and other[3] <= OTHER_SIDE * found[3]


def nearest_weights(corners: Array, p: Array) -> Array:
    """Weights (N, 2) of the second and third corner of the point of each triangle (N, 3, 3) nearest to ``p``.

    Source: C. Ericson, Real-Time Collision Detection, section 5.1.5: the point is in the face, on an edge or a corner.
    """
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, ac, ap = b - a, c - a, p - a
    aa, bb, cc = (np.einsum("nk,nk->n", u, v) for u, v in ((ab, ab), (ab, ac), (ac, ac)))
    d, e = np.einsum("nk,nk->n", ab, ap), np.einsum("nk,nk->n", ac, ap)
    det = aa * cc - bb * bb
    with np.errstate(divide="ignore", invalid="ignore"):
        v, w = (cc * d - bb * e) / det, (aa * e - bb * d) / det
        inside = (v >= 0) & (w >= 0) & (v + w <= 1) & np.isfinite(v) & np.isfinite(w)
        on_ab = np.clip(d / aa, 0, 1)
        on_ac = np.clip(e / cc, 0, 1)
        bc = aa - 2 * bb + cc
        on_bc = np.clip((aa - bb - d + e) / bc, 0, 1)
    zero = np.zeros(len(corners))
    edges = np.stack([
        np.stack([on_ab, zero], axis=1), np.stack([zero, on_ac], axis=1), np.stack([1 - on_bc, on_bc], axis=1)
    ])  # fmt: skip
    edges = np.nan_to_num(edges)
    off = edges[..., :1] * ab + edges[..., 1:] * ac - ap
    best = np.argmin(np.einsum("enk,enk->en", off, off), axis=0)
    return np.where(inside[:, None], np.stack([np.nan_to_num(v), np.nan_to_num(w)], axis=1),
                    edges[best, np.arange(len(corners))])  # fmt: skip
