"""Where the markers of a prediction are: exhaustive search round each place, shape known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.detection.template_fit import BATCH_PIXELS, Request, Scene, cut_patches

Array = NDArray[np.float64]


def search(scene: Scene, request: Request, search_px: int) -> Request:
    """The request placed where its discs correlate best, with states to start the fit from."""
    assert request.shape is not None
    found = np.zeros((len(request.xy), 5))
    half = np.ceil(request.reach()).astype(np.int64)
    for size in np.unique(half):
        mine = np.flatnonzero(half == size)
        count = -(-mine.size * (2 * int(size + search_px) + 1) ** 2 // BATCH_PIXELS)
        for index in np.array_split(mine, count):
            found[index] = _search_batch(scene, request.take(index), int(size), search_px)
    states = np.zeros((len(found), 10))
    xx, xy, yy = request.shape.T
    states[:, 6], states[:, 7] = found[:, 3] * (xx * yy - xy * xy), found[:, 4]
    return replace(request, xy=found[:, :2], states=states)


def _search_batch(scene: Scene, request: Request, half: int, search_px: int) -> Array:
    from windmark.detection._kernels_template_search import search_discs

    assert request.shape is not None
    pixel = np.rint(request.xy).astype(np.int64)
    patches, weights, _, _ = cut_patches(scene, pixel, half + search_px)
    level = patches.sum((1, 2)) / np.maximum(weights.sum((1, 2)), 1.0)
    patches = np.where(weights > 0, patches - level[:, None, None], 0.0)
    discs = np.column_stack([request.xy - pixel, request.shape, request.blur])
    out = np.zeros((len(pixel), 5))
    search_discs(patches, discs, request.reach(), search_px, out)
    out[:, :2] += pixel
    out[:, 4] += level
    return out
