"""Shapes painted on surfaces: the markers' discs and everything that is not a marker."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.geometry.discs import tangent
from windmark.scene import MarkerSet
from windmark.synth.marks import Marks

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Decals:
    """K marks painted on surfaces: shapes in the tangent plane, laid on the surface, as columns.

    A decal is what a ray meets where it crosses the decal's own smooth surface (`MarkerSet.curvature`), if the surface
    that the ray hits first belongs to the decal's volume and lies near it. So a disc is exactly flat, or curved as it
    says, although the mesh under it has facets.

    Parameters
    ----------
    center, normal, direction : (K, 3) centre, unit normal, unit vector of the shape's first side
    half, outer, inner, contrast : (K, 2), (K,), (K,), (K,) the shape, see `marks.Marks`
    volume : (K,) str
    curvature : (K, 3, 3) as `MarkerSet.curvature`; flat by default
    """

    center: Array
    normal: Array
    direction: Array
    half: Array
    outer: Array
    inner: Array
    contrast: Array
    volume: NDArray[np.str_]
    curvature: Array = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        if not self.curvature.size:
            object.__setattr__(self, "curvature", np.zeros((len(self.center), 3, 3)))

    def __len__(self) -> int:
        return len(self.center)

    @staticmethod
    def of_markers(markers: MarkerSet, contrast: float) -> Decals:
        """The markers' discs. Radius and normal must be known."""
        if not (np.isfinite(markers.radius).all() and np.isfinite(markers.normal).all()):
            raise ValueError("Decals.of_markers: markers must have radius and normal, some are NaN")
        k = len(markers)
        return Decals(
            markers.xyz, markers.normal, tangent(markers.normal), np.zeros((k, 2)), markers.radius,
            np.full(k, -1.0), np.full(k, float(contrast)), markers.volume, markers.curvature,
        )  # fmt: skip

    @staticmethod
    def on_surface(marks: Marks, xyz: ArrayLike, normal: ArrayLike, volume: str) -> Decals:
        """Plane marks laid into the tangent plane at one surface point."""
        k = len(marks)
        n = np.broadcast_to(np.asarray(normal, dtype=float), (k, 3))
        a = tangent(n)
        b = np.cross(n, a)
        c, s = np.cos(marks.angle)[:, None], np.sin(marks.angle)[:, None]
        center = np.asarray(xyz, dtype=float) + marks.center[:, :1] * a + marks.center[:, 1:] * b
        return Decals(center, n.copy(), c * a + s * b, marks.half, marks.outer, marks.inner, marks.contrast,
                      np.full(k, volume))  # fmt: skip

    @staticmethod
    def join(parts: Sequence[Decals]) -> Decals:
        """Several sets as one."""
        if not parts:
            return Decals.on_surface(
                Marks.make(np.zeros((0, 2)), outer=0.0, contrast=0.0), np.zeros(3), [0, 0, 1.0], ""
            )
        return Decals(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Decals)))

    @property
    def reach(self) -> Array:
        """(K,) radius of the sphere round the centre that holds the shape."""
        return np.hypot(self.half[:, 0], self.half[:, 1]) + self.outer
