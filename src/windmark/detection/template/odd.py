"""What moves a centre: the part of the residuals that is odd about it, weighed as the pixels move the centre.

A centre's covariance takes one residual variance for a whole window. That is too little where the noise is stronger in
the disc and at its rim, which the centre hangs on, than beside it (a gamma lifts the dark), and too much where it fades
in the dark (photons) or where a part of what is left is no noise: a hard rim, a motion's trace and pixels that see less
than their square leave residuals that are even about the centre, and such move no centre.

So the residual e of each pixel is compared with that of the point across the centre c, o(x) = e(x) - e(2 c - x), by
bilinear interpolation. In white noise, of which the fit has taken what is odd among its unknowns, E[o^2] is known; the
ratio of sum w o^2 to its expectation, w = a^T (sum a a^T)^-1 a with a the influence of a pixel on the centre, is by how
much a centre's variance is larger: the sandwich for unequal variances (White, Econometrica 48, 1980) of the odd part.

Correlated residuals say no such thing. The lumps of a printed rim are odd and belong to the surface as its texture
does: no other picture would show that centre elsewhere. But a file that was compressed in blocks (`blocks`) has smooth
errors which are larger where there is something to round, at the disc. Interpolation keeps more of what is smooth; so
there the ratio counts beside that of all pixels alike.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.geometry.order import median

Array = NDArray[np.float64]

OUTVOTED = 3.0  # a marker counts at most so many times the median
DOUBTED = 2.0  # a ratio that differs from 1 by less than so many of its standard deviations is 1
LEAST = 0.25  # of a centre's variance: pictures drawn without noise leave residuals that are even and nothing else
FEW = 5  # markers whose scatter says how well the ratio is known


def odd_ratio(images: Array, centre: Array, variance: Array, *, smooth: bool = False) -> float:
    """Variance of centres over what least squares makes it from white residuals; 1 where nothing shows another one.

    Parameters
    ----------
    images : (B, 4, S, S), `fit.Batch.images` of a frame's clean markers
    centre : (B, 2) from the middle of the images, px
    variance : (B,) residual variance of the fits
    smooth : the residuals are correlated: how strong they are is asked of all pixels alike, and may only be too little
    """
    from windmark.detection.template._kernels.odd import odd_sums

    size = images.shape[-1]
    x = np.arange(size) - size // 2
    influence = images[:, :2].reshape(len(images), 2, -1)
    slopes = np.stack([images[:, 3] * x, images[:, 3] * x[:, None]], axis=1).reshape(influence.shape)
    taken = np.concatenate([influence, slopes], axis=1)
    weigh, known = (_inverse(rows @ rows.swapaxes(1, 2)) for rows in (influence, taken))
    sums = np.empty((len(images), 4))
    odd_sums(images, centre + size // 2, weigh, known, sums)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = sums[:, 0] / (sums[:, 1] * (sums[:, 2] / sums[:, 3] if smooth else variance))
    ratio = ratio[np.isfinite(ratio)]
    if len(ratio) < FEW:
        return 1.0
    ratio = np.minimum(ratio, OUTVOTED * median(ratio))
    off, doubt = ratio.mean() - 1.0, DOUBTED * ratio.std() / np.sqrt(len(ratio))
    if abs(off) <= doubt:
        return 1.0
    # What is stated too well does harm, what is stated too badly little: sigmas get smaller only as far as is sure.
    least = 1.0 if smooth else LEAST
    return float(1.0 + off * (1.0 - (doubt / off) ** 2) if off > 0.0 else max(1.0 + off + doubt, least))


def _inverse(matrix: Array) -> Array:
    """Inverse of normal matrices (B, N, N) of unknowns in different units."""
    unit = np.sqrt(np.maximum(np.diagonal(matrix, axis1=1, axis2=2), 1e-300))
    unit = unit[:, :, None] * unit[:, None, :]
    return np.asarray(np.linalg.pinv(matrix / unit, hermitian=True) / unit)
