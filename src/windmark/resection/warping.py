"""A picture recomputed through a smooth map of its plane."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.resection.sampling import Image, checked_image

Array = NDArray[np.float64]

STEPS = (32, 16, 8, 4, 2, 1)
"""Distances of the nodes at which the map is computed, pixels; the first that is exact enough is taken."""
_PROBES = 2048
"""Places at which that is measured."""


def warp_image(
    image: ArrayLike, place: Callable[[Array], Array], size_px: tuple[int, int], *, tolerance_px: float = 1e-3
) -> Image:
    """Recompute a picture: pixel xy of the result has the value that the image has at ``place(xy)``.

    Values as `interpolate_image` with "cubic". The map is computed on nodes and is cubic between them; how far apart
    these may be is measured against the map itself.

    Parameters
    ----------
    image : (H, W) or (H, W, C), any real type
    place : (N, 2) pixels of the result -> (N, 2) pixels of the image; NaN where there is nothing
    size_px : (width, height) of the result
    tolerance_px : largest error of a place between the nodes

    Returns
    -------
    (height, width[, C]) float32, NaN where the place is outside the image, or within a cell of a NaN node

    Raises
    ------
    ValueError
        For a wrong shape, a size that is not positive.
    """
    from windmark.resection._warp_kernels import warp_rows

    pixels = checked_image(image, None, "warp_image")
    width, height = (int(n) for n in size_px)
    if min(width, height) < 1:
        raise ValueError(f"warp_image: size_px must be positive, got {size_px}")
    nodes, step = _nodes(place, width, height, tolerance_px)
    channels = pixels[..., None] if pixels.ndim == 2 else pixels
    out = np.empty((channels.shape[2], height, width), np.float32)
    for k in range(channels.shape[2]):
        warp_rows(np.ascontiguousarray(channels[:, :, k : k + 1]), nodes, step, 0, out[k])
    return out[0] if pixels.ndim == 2 else np.ascontiguousarray(np.moveaxis(out, 0, -1))


def _nodes(place: Callable[[Array], Array], width: int, height: int, tolerance_px: float) -> tuple[Array, int]:
    """Places on nodes (J, I, 2) and their distance in pixels."""
    # A fixed sequence without a period of the cells', all over the picture (Roberts' R2).
    n = np.arange(_PROBES)
    probe = np.outer(n, [0.7548776662466927, 0.5698402909980532]) % 1.0 * [width - 1, height - 1]
    exact = place(probe)
    for step in STEPS:
        columns = (np.arange((width - 1) // step + 4) - 1.0) * step
        rows = (np.arange((height - 1) // step + 4) - 1.0) * step
        at = np.stack(np.meshgrid(columns, rows), axis=-1)
        nodes = np.ascontiguousarray(place(at.reshape(-1, 2)).reshape(*at.shape))
        if step == STEPS[-1]:
            break
        off = np.abs(_between(nodes, step, probe) - exact)
        # Places without a value at their nodes stay without one; a finer step would lose fewer: no measure.
        if not (off > tolerance_px).any():
            break
    return nodes, step


def _between(nodes: Array, step: int, xy: Array) -> Array:
    """What `warp_rows` takes for the places of pixels (N, 2)."""
    cell = np.floor(xy / step).astype(int)
    t = xy / step - cell
    wx, wy = (_weights(t[:, k]) for k in (0, 1))
    out = np.zeros_like(xy)
    for j in range(4):
        for i in range(4):
            out += (wy[j] * wx[i])[:, None] * nodes[cell[:, 1] + j, cell[:, 0] + i]
    return out


def _weights(f: Array) -> tuple[Array, ...]:
    g = 1.0 - f
    return -0.5 * f * g * g, 1.0 + f * f * (1.5 * f - 2.5), 1.0 + g * g * (1.5 * g - 2.5), -0.5 * g * f * f
