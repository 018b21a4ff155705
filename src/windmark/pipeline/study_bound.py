"""The Cramer-Rao bound of the study's own images: an ellipse, pixels, averages over 3 x 3 pixels, white noise.

The bound belongs to the images, not to a method: the derivatives are those of the study's images, not of the detector's
model; only the inverse of the information is `windmark.detection.template.crlb`'s. By Green's theorem a pixel's
share of an ellipse, and the share's derivatives by the centre, are sums over the boundary (u, v)(t):

    d share / dx = integral w(u, v) dv,   d share / dy = -integral w(u, v) du,   share = integral left(u, v) dv

with w one inside the pixel and left the part of the pixel that lies left of u, in the pixel's own row. Blur filters
derivatives as it filters the image.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.detection.template.crlb import covariance_bound
from windmark.synth import SheetTruth

Array = NDArray[np.float64]

POINTS = 2000  # of the boundary; each counts for the one pixel that it is in, an error of about 1 % of one pixel


def variance_bound(truth: SheetTruth, *, blur_passes: int, level: float, noise: float) -> Array:
    """Least variance of an unbiased estimate of each centre along x and y.

    Unknown are centre, depth, level and slope of the light (multiplicative, as on paint). Ellipse and blur are taken as
    known: this bounds every method, also one that is told the radius. Not to know them costs 0.1 ... 0.6 % at radii
    from 2 px with a blur pass, up to 2 % without, by symmetry; a disc seen 1.5 px wide has practically no bound if
    nothing is known of its shape. What counts is the square of pixels that reaches r + 4.5 blur + 1 from the
    centre; further out the light of a real surface is no plane. Twice that reach would lower the bound by 1 ... 2 % at
    one blur pass, 3 ... 4 % at none.

    Parameters
    ----------
    truth : N markers on one sheet
    blur_passes : averages over 3 x 3 pixels
    level : light without markers, grey levels
    noise : standard deviation of white noise, grey levels

    Returns
    -------
    (N, 2) px^2
    """
    blur = np.sqrt(2.0 / 3.0 * blur_passes)
    half = int(np.ceil(truth.axes_px.max() + 4.5 * blur + 1))
    margin = blur_passes  # the filter mirrors at the border of the patch
    along_x, along_y, share = _disc(truth, half + margin)
    place = np.arange(-half - margin, half + margin + 1.0)
    light = level - truth.depth * share
    images = [truth.depth * along_x, truth.depth * along_y, share, np.ones_like(share),
              place / half * light, place[:, None] / half * light]  # fmt: skip
    side = slice(margin, margin + 2 * half + 1)
    jacobian = np.stack([_averaged(image, blur_passes)[:, side, side] for image in images], axis=1)
    jacobian = jacobian.reshape(len(truth), len(images), -1)
    return np.einsum("nkk->nk", covariance_bound(jacobian, noise))[:, :2]


def _disc(truth: SheetTruth, half: int) -> tuple[Array, Array, Array]:
    """Derivatives of the covered shares by x and y, and the shares; each (N, 2 half + 1, 2 half + 1).

    Patches are centred on the pixel nearest to the marker's centre.
    """
    n, side = len(truth), 2 * half + 1
    t = (np.arange(POINTS) + 0.5) * (2 * np.pi / POINTS)
    c, s = np.cos(truth.angle)[:, None], np.sin(truth.angle)[:, None]
    a, b = truth.axes_px[:, :1], truth.axes_px[:, 1:]
    p, q, dp, dq = a * np.cos(t), b * np.sin(t), -a * np.sin(t), b * np.cos(t)
    middle = half + truth.xy - np.rint(truth.xy)
    u, v = middle[:, :1] + c * p - s * q, middle[:, 1:] + s * p + c * q
    du, dv = (c * dp - s * dq) * (2 * np.pi / POINTS), (s * dp + c * dq) * (2 * np.pi / POINTS)
    column, row = np.rint(u).astype(int), np.rint(v).astype(int)
    cell = ((np.arange(n)[:, None] * side + row) * side + column).ravel()

    def sums(weight: Array) -> Array:
        total = np.bincount(cell, weights=weight.ravel(), minlength=n * side * side).astype(float)
        return total.reshape(n, side, side)

    crossed = sums(dv)
    # Boundary in a pixel further right has the whole pixel on its left.
    right = np.flip(np.cumsum(np.flip(crossed, 2), axis=2, dtype=float), 2) - crossed
    return crossed, -sums(du), sums((u - column + 0.5) * dv) + right


def _averaged(patches: Array, passes: int) -> Array:
    """The paper's blur of (N, H, W) patches."""
    from scipy.ndimage import uniform_filter

    for _ in range(passes):
        patches = uniform_filter(patches, size=(1, 3, 3), mode="reflect")
    return patches
