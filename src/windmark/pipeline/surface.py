"""The mapped surface seen from anywhere: values and shading per pixel of a virtual camera.

Drawn with windmark's own pixel map, so it needs no graphics driver and no display.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark import resection
from windmark.pipeline.views import frame_view
from windmark.scene import Mesh

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SurfaceView:
    """Value (NaN where not measured) and shade 0..1 (NaN where no surface) of each pixel, float32 (H, W)."""

    value: NDArray[np.float32]
    shade: NDArray[np.float32]


def surface_view(
    mesh: Mesh,
    values: NDArray[np.floating],
    *,
    direction: ArrayLike,
    up: ArrayLike,
    focus: Array | None = None,
    size_px: tuple[int, int] = (1400, 800),
    fov_deg: float = 25.0,
) -> SurfaceView:
    """Node values (V,) on the surface, looked at along ``direction``; ``focus`` (N, 3) is what must be in view."""
    focus = mesh.vertices[mesh.used] if focus is None else focus
    camera, pose = frame_view(focus, direction=direction, up=up, size_px=size_px, fov_deg=fov_deg)
    # Walls and the inside of open surfaces must not stand before what they surround.
    pixels = resection.map_pixels(mesh, camera, pose, cull_backfaces=True)
    normal = mesh.triangle_normals()
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
    # A head light a little to the upper left; two-sided, since grids may be oriented either way.
    light = pose.rotation.T @ np.array([-0.35, -0.45, -1.0])
    shade = np.abs(normal @ (light / np.linalg.norm(light))).astype(np.float32)
    on = pixels.valid
    lit = np.full(on.shape, np.nan, dtype=np.float32)
    lit[on] = shade[pixels.triangle[on]]
    lit /= max(float(np.nanmax(lit, initial=0.0)), 1e-6)
    return SurfaceView(pixels.interpolate(values).astype(np.float32), lit)
