"""Noise of a frame from the residuals of its template fits, and the covariance of centres in it.

How strong: sensor noise, shot noise and the paint's own texture make a residual variance that grows with the light as
c0 + c1 v + c2 v^2 (the photon transfer curve); its three numbers come from markers in light and shade.

How correlated: paint is not smooth, and sensors have columns. What is left after a fit is correlated from pixel to
pixel, and where paint multiplies the light its texture fades in a dark marker. Least squares stays unbiased, but its
usual covariance is too small, up to five times. The noise of a marker is modelled as a sum of covariances of unknown
strengths >= 0: white noise, columns and rows, and noise correlated over several lengths, either in proportion to the
image's brightness (paint) or of constant strength (infrared, sensor); `noise_learnt` finds them. The covariance of a
centre is then a^T C a with a the influence of each pixel on it.

All correlations are products of one over rows and one over columns, so that C f is two small matrix products.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

LENGTHS_PX = (0.5, 0.8, 1.2, 1.8, 2.7)  # standard deviations of filters on white noise: correlation exp(-d^2 / (4 l^2))
PARTS = 3 + len(LENGTHS_PX)  # white, columns, rows, lengths


@dataclass(frozen=True)
class FrameNoise:
    """Noise of a frame.

    Parameters
    ----------
    curve : (3,) residual variance of a fit by the largest grey level v in its window: curve . (1, v, v^2)
    constant : (8,) relative strengths of white noise, columns, rows, and noise correlated over each of `LENGTHS_PX`
    paint : (8,) the same of noise in proportion to the brightness, relative to the window's brightest place
    kept : part of such noise's variance that a typical fit leaves in its residuals
    texture : part of the variance of a typical centre that the paint's texture makes. It goes with the surface: the
        same marker is off by the same in every frame, and for every camera
    weights : (16,) `constant` and `paint` of the noise by which centres are weighed: what the surface shows where no
        disc is, as a disc's model is never quite right and its errors are correlated too. None for least squares
    photons : strength of white noise whose variance is in proportion to the brightness, relative as `paint`'s
    """

    curve: Array
    constant: Array
    paint: Array
    kept: float
    texture: float = 0.0
    weights: Array | None = None
    photons: float = 0.0

    @staticmethod
    def white(sigma: float) -> FrameNoise:
        """White noise of a standard deviation in grey levels."""
        return FrameNoise(np.array([sigma**2, 0.0, 0.0]), np.eye(PARTS)[0], np.zeros(PARTS), 1.0)

    @property
    def is_white(self) -> bool:
        """Whether the usual covariance of least squares holds."""
        return not (self.constant[1:].any() or self.paint.any() or self.photons)

    def variance(self, level: ArrayLike) -> Array:
        """Residual variance to be expected at grey levels."""
        v = np.abs(np.asarray(level, dtype=float))
        return np.asarray(self.curve[0] + v * (self.curve[1] + v * self.curve[2]))

    def covariance(self, images: Array, variance: Array) -> Array:
        """Covariance (B, 2, 2) of the centres of fits with images `Batch.images` and residual variances (B,)."""
        bright = brightness(images)
        pixels = np.maximum((bright != 0).sum((1, 2)), 1)
        total = self.constant.sum() + self.paint.sum() * (bright**2).sum((1, 2)) / pixels
        total += self.photons * bright.sum((1, 2)) / pixels
        cov = of_centres(images, self.constant, self.paint)
        cov += self.photons * np.einsum("kiab,kab,kjab->kij", images[:, :2], bright, images[:, :2])
        return np.asarray(cov * (variance / (self.kept * total))[:, None, None])

    def pixels(self, model: Array, variance: float) -> Array:
        """By `weights`, variances (P,) or covariance (P, P) of the P pixels that are not 0 in a model image (S, S).

        Their mean variance is as given.
        """
        assert self.weights is not None
        j, i = np.nonzero(model)
        bright = model[j, i] / np.abs(model).max()
        constant, paint = self.weights[:PARTS], self.weights[PARTS:]
        if not (constant[1:].any() or paint[1:].any()):
            own = constant[0] + self.photons * bright + paint[0] * bright**2
            return np.asarray(own * (variance / own.mean()))
        first = [(rows[0], columns[0]) for rows, columns in tables_of(len(model))]  # all that two pixels' distance says
        apart = np.abs(j[:, None] - j) * len(model) + np.abs(i[:, None] - i)
        total = np.zeros(apart.shape)
        for strengths, light in ((constant, None), (paint, bright)):
            if strengths.any():
                like = sum(s * np.outer(*one) for s, one in zip(strengths, first, strict=True) if s > 0.0)
                part = np.ravel(like)[apart]
                total += part if light is None else light[:, None] * part * light
        return np.asarray(total * (variance / np.trace(total) * len(total)))


def of_centres(images: Array, constant: Array, paint: Array) -> Array:
    """(B, 2, 2) covariance of the centres for noise of these strengths."""
    influence, bright = images[:, :2], brightness(images)
    cov = np.zeros((len(images), 2, 2))
    for strengths, weighted in ((constant, influence), (paint, influence * bright[:, None])):
        for strength, (rows, columns) in zip(strengths, tables_of(images.shape[-1]), strict=True):
            if strength > 0.0:
                cov += strength * np.einsum("kiab,kjab->kij", weighted, rows @ weighted @ columns)
    return cov


def brightness(images: Array) -> Array:
    """Model images (B, S, S) relative to the brightest place of their window, 0 where a pixel was not used."""
    model = images[:, 3]
    return np.asarray(model / np.maximum(np.abs(model).max((1, 2), keepdims=True), 1e-300))


@cache
def tables_of(size: int) -> tuple[tuple[Array, Array], ...]:
    """Correlations (S, S) along columns and along rows of pixels: white, columns, rows, then `LENGTHS_PX`."""
    gap2 = (np.arange(size)[:, None] - np.arange(size)[None, :]) ** 2
    alone, together = np.eye(size), np.ones((size, size))
    lengths = [np.exp(-gap2 / (4.0 * length**2)) for length in LENGTHS_PX]
    return (alone, alone), (together, alone), (alone, together), *((t, t) for t in lengths)
