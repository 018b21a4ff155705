"""Where the markers of a prediction are: exhaustive search round each place, shape known; and what is round them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark.detection.template.request import Request, Scene

Array = NDArray[np.float64]

RING = 12, 16  # windows of the inner and the outer ring round a marker
LEAST_RING = 8  # windows that say something about the surface


@dataclass(frozen=True)
class Surroundings:
    """The disc's filter on the surface round K places, where no marker is.

    Parameters
    ----------
    depth, spread : (K,) median and robust standard deviation of the depth that the filter finds there; NaN where
        fewer than 8 windows lie in the image
    variance : (K,) median residual variance of a window
    count : (K,) number of windows
    """

    depth: Array
    spread: Array
    variance: Array
    count: Array


def search(scene: Scene, request: Request, search_px: int) -> tuple[Request, Array]:
    """The request placed where its discs correlate best, with states to start the fit from.

    Returns
    -------
    request : placed
    found : (K, 7) columns `_kernels.search.FOUND`; NaN where more than half of all windows is missing
    """
    from windmark.detection.template._kernels.search import FOUND, search_discs

    assert request.shape is not None
    found = np.zeros((len(request.xy), len(FOUND)))
    pixel = np.rint(request.xy).astype(np.int64)
    search_discs(*scene.pixels(), pixel, _discs(request), request.reach(), search_px, found)
    found[:, :2] += pixel
    states = np.zeros((len(found), 10))
    xx, xy, yy = request.shape.T
    states[:, 6], states[:, 7] = found[:, 3] * (xx * yy - xy * xy), found[:, 4]
    return replace(request, xy=found[:, :2].copy(), states=np.where(np.isfinite(found[:, 2:3]), states, np.nan)), found


def surroundings(scene: Scene, request: Request) -> Surroundings:
    """The filter of each disc in two rings of windows round it, none of which sees the disc itself."""
    from windmark.detection.template._kernels.search import WINDOW, ring_windows

    assert request.shape is not None
    pixels = scene.pixels()
    out = np.full((4, len(request.xy)), np.nan)
    turns = [2.0 * np.pi * np.arange(n) / n for n in RING]
    ways = [np.column_stack([np.cos(t), np.sin(t)]) for t in turns]
    for k in range(len(request.xy)):
        one = request.take(np.array([k]))
        reach, size = float(one.reach()[0]), float(one.radius[0])
        far = reach + size + 3.0 * float(one.blur[0])
        places = np.rint(one.xy + np.concatenate([ways[0] * far, ways[1] * (far + 2.0 * size)])).astype(np.int64)
        rows = np.empty((len(places), len(WINDOW)))
        ring_windows(*pixels, places, _discs(one)[0], reach, rows)
        rows = rows[np.isfinite(rows[:, 1])]
        out[3, k] = len(rows)
        if len(rows) >= LEAST_RING:
            out[0, k] = np.median(rows[:, 1])
            out[1, k] = 1.4826 * np.median(np.abs(rows[:, 1] - out[0, k]))
            out[2, k] = np.median(rows[:, 3])
    return Surroundings(*out)


def _discs(request: Request) -> Array:
    """Discs centred on a pixel, as the kernels want them (K, 6)."""
    assert request.shape is not None
    return np.column_stack([np.zeros_like(request.xy), request.shape, request.blur])
