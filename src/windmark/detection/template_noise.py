"""Noise of a frame from the residuals of its template fits, and the covariance of centres in it.

Paint is not smooth: what is left after a fit is correlated from pixel to pixel, and where paint multiplies the light
its
texture fades in a dark marker. Least squares stays unbiased, but its usual covariance is too small, up to five times.

The noise is modelled as a sum of a few covariances with unknown strengths c >= 0: white noise; white noise and Gaussian
correlations of several lengths proportional to the image's brightness (paint); or Gaussian correlations of constant
strength (sensor, or infrared). The strengths come from quadratic forms of the residuals. A fit takes ten degrees of
freedom
out of a window of 150 to 500 pixels, and from correlated noise the more the longer it is correlated; the expectation
of each
form is computed with the projection Q = 1 - U U^T that the fit applies, E[e^T Q S Q e] = sum_b c_b tr(S Q C_b Q), so
the
strengths are unbiased (estimation of variance components: Rao's MINQUE; C. R. Rao, J. Multivariate Anal. 1, 1971).
The covariance of a centre is then a^T C a with a the influence of each pixel on it.

All correlations are products of one over rows and one over columns, so that C f is two small matrix products.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LENGTHS_PX = (0.5, 0.8, 1.2, 1.8, 2.7)  # standard deviations of filters on white noise: correlation exp(-d^2 / (4 l^2))
EVIDENCE = 0.7  # constant correlations are believed where they leave less than this of the misfit of proportional ones
SAME = 0.08  # noise is called white where that changes the variance of a centre by less
SAMPLE = 48  # markers that are enough for the noise of a frame


@dataclass(frozen=True)
class FrameNoise:
    """Noise of a frame: strengths of its parts, in grey levels squared.

    Parameters
    ----------
    constant : (6,) variance of white noise and of noise correlated over each of `LENGTHS_PX`
    paint : (6,) the same of noise proportional to brightness, where the brightness is `scale`
    scale : grey level
    kept : share of the variance that is left in the residuals; fits take the slowly varying part of a texture for light
    """

    constant: Array
    paint: Array
    scale: float
    kept: float = 1.0

    @staticmethod
    def white(sigma: float) -> FrameNoise:
        """White noise of a standard deviation."""
        return FrameNoise(np.array([sigma**2, 0.0, 0.0, 0.0, 0.0, 0.0]), np.zeros(6), 1.0)

    @property
    def is_white(self) -> bool:
        """Whether the usual covariance of least squares holds."""
        return not (self.constant[1:].any() or self.paint.any())

    @property
    def sigma(self) -> float:
        """Standard deviation of one pixel on the paint."""
        return float(np.sqrt(self.constant.sum() + self.paint.sum()))

    def variance(self, images: Array) -> Array:
        """Mean variance (B,) of the pixels that were used in fits with `Batch.images`."""
        model, n = images[:, 3], np.maximum((images[:, 3] != 0).sum((1, 2)), 1)
        return np.asarray(self.constant.sum() + self.paint.sum() * (model**2).sum((1, 2)) / n / self.scale**2)

    def covariance(self, images: Array) -> Array:
        """Covariance (B, 2, 2) of the centres of fits with `Batch.images`."""
        influence, brightness = images[:, :2], images[:, 3:] / self.scale
        cov = np.zeros((len(images), 2, 2))
        for strengths, weighted in ((self.constant, influence), (self.paint, influence * brightness)):
            for strength, table in zip(strengths, _tables(images.shape[-1]), strict=True):
                if strength > 0.0:
                    cov += strength * np.einsum("kiab,kjab->kij", weighted, _filtered(table, weighted))
        return cov


def frame_noise(images: Array, jacobian: Array, multiplicative: bool) -> FrameNoise:
    """Noise of a frame from some of its clean markers.

    Parameters
    ----------
    images : (B, 4, S, S), `Batch.images` of the markers; the first must be a typical one
    jacobian : (10, S, S) derivatives of the model of the first marker, 0 where its pixels were not used
    multiplicative : whether paint multiplies the light, so that its texture is proportional to the brightness
    """
    from scipy.optimize import nnls

    residual, used = images[:, 2], (images[:, 3] != 0).astype(float)
    scale = float(np.abs(images[0, 3]).max())
    brightness = images[:, 3] / scale
    edge = np.abs(np.sign(images[:, 3].sum((1, 2)))[:, None, None] * used - brightness)  # large in the marker
    weights, tables = (used, brightness, edge), _tables(images.shape[-1])
    pixels = used.sum((1, 2))
    forms = np.array([
        (np.einsum("kab,kab->k", residual * w, _filtered(t, residual * w)) / pixels).mean() for w in weights for t in
        tables
    ])  # fmt: skip
    expected, size = _expectations([w[0] for w in weights], tables, jacobian, float(pixels[0]))
    scaled, forms = expected / size[:, None], forms / size
    unit = np.linalg.norm(scaled, axis=0)
    n = len(tables)
    paint = [0, *range(n, 2 * n)] if multiplicative else list(range(n))
    best, misfit = np.zeros(2 * n), np.inf
    for family, trust in ((paint, 1.0), (list(range(n)), EVIDENCE)):
        strengths = np.zeros(2 * n)
        strengths[family], left = nnls((scaled / unit)[:, family], forms)
        if left < trust * misfit:
            best, misfit = strengths / unit, left
    found = FrameNoise(best[:n], best[n:], scale)
    plain = FrameNoise.white(float(np.sqrt(found.variance(images[:1])[0])))
    change = np.trace(found.covariance(images[:1])[0]) / np.trace(plain.covariance(images[:1])[0])
    return plain if abs(change - 1.0) < SAME else found


def _tables(size: int) -> list[Array]:
    """Correlations along a row of pixels, (S, S) each: white, then `LENGTHS_PX`."""
    gap2 = (np.arange(size)[:, None] - np.arange(size)[None, :]) ** 2
    return [np.eye(size), *(np.exp(-gap2 / (4.0 * length**2)) for length in LENGTHS_PX)]


def _filtered(table: Array, images: Array) -> Array:
    """The correlation applied to images (..., S, S)."""
    return np.asarray(table @ images @ table)


def _expectations(weights: list[Array], tables: list[Array], jacobian: Array, pixels: float) -> tuple[Array, Array]:
    """Expectations (forms, parts) of the forms per pixel for each part of strength 1, and the forms' own size.

    With S = w T w and C = v T' v: tr(S Q C Q) = tr(S C) - 2 tr(U^T S C U) + tr(U^T S U U^T C U), and
    tr(S C) = (w v)^T (T * T') (w v) because T * T' is again a correlation of rows times one of columns.
    """
    shape = jacobian.shape
    basis = np.linalg.qr(jacobian.reshape(shape[0], -1).T)[0].T.reshape(shape)
    sandwiches = [w * _filtered(t, w * basis) for w in weights for t in tables]
    inner = [np.einsum("iab,jab->ij", basis, s) for s in sandwiches]
    forms = [(w, t) for w in weights for t in tables]
    out = np.empty((len(forms), 2 * len(tables)))
    for f, (w, t) in enumerate(forms):
        for p, (v, u) in enumerate(forms[: 2 * len(tables)]):
            both = w * v
            total = (both * _filtered(t * u, both)).sum() - 2.0 * (sandwiches[f] * sandwiches[p]).sum()
            out[f, p] = total + (inner[f] * inner[p].T).sum()
    size = np.array([np.sqrt((w**2 * _filtered(t * t, w**2)).sum()) for w, t in forms])
    return out / pixels, size / pixels
