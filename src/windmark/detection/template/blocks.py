"""Whether a picture has been through a compression in blocks of 8 x 8 pixels, seen in its noise.

JPEG rounds the cosine coefficients of each block by itself. Within a block what is left of the noise is smooth, from
block to block it jumps (the same grid is used to tell double compression: Fan and de Queiroz, IEEE Trans. Image
Processing 12, 2003). The file's type does not say it: pictures are decompressed, cropped and saved again. So what the
fits leave is asked whether steps between neighbouring pixels are larger than those beside them at one place of eight,
along both axes; each marker's window counts once, whatever its noise is correlated like.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

BLOCK_PX = 8
SURE = 5.0  # standard deviations of the windows' mean, along both axes: of 8 places none comes so far by chance
FEW = 12  # windows whose scatter says how sure it is


def in_blocks(residual: Array, used: NDArray[np.bool_], pixel: Ints) -> bool:
    """Whether residuals jump along a grid of 8 x 8 pixels; False where fewer than 12 windows are given.

    Parameters
    ----------
    residual, used : (B, S, S) what fits have left, and the pixels that they have seen
    pixel : (B, 2) the windows' middles in the picture, x and y
    """
    if len(residual) < FEW:
        return False
    return all(
        _most_sure(np.swapaxes(residual, 1, 1 + axis), np.swapaxes(used, 1, 1 + axis), pixel[:, axis]) > SURE
        for axis in range(2)
    )


def _most_sure(residual: Array, used: NDArray[np.bool_], middle: Ints) -> float:
    """Standard deviations by which steps along rows are above those beside them, at the place of eight with most."""
    step = np.abs(np.diff(residual, axis=2))
    beside = 0.5 * (step[:, :, :-2] + step[:, :, 2:])
    seen = used[:, :, :-3] & used[:, :, 1:-2] & used[:, :, 2:-1] & used[:, :, 3:]
    larger = np.where(seen, 0.5 * (1.0 + np.sign(step[:, :, 1:-1] - beside)), 0.0).sum(axis=1)
    count, size = seen.sum(axis=1), residual.shape[2]
    place = (middle[:, None] - size // 2 + 1 + np.arange(size - 3)) % BLOCK_PX
    usual = larger.sum(axis=1) / np.maximum(count.sum(axis=1), 1)
    sure = []
    for k in range(BLOCK_PX):
        here = (place == k) & (count > 0)
        n = np.where(here, count, 0).sum(axis=1)
        more = np.where(here, larger, 0.0).sum(axis=1)[n > 0] / n[n > 0] - usual[n > 0]
        spread = more.std() / np.sqrt(max(len(more), 1))
        sure.append(more.mean() / spread if len(more) >= FEW and spread > 0.0 else 0.0)
    return float(max(sure))
