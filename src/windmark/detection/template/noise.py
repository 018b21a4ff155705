"""Noise of a frame from the residuals of its template fits, and the covariance of centres in it.

How strong: sensor noise, shot noise and the paint's own texture make a residual variance that grows with the light as
c0 + c1 v + c2 v^2 (the photon transfer curve); its three numbers come from markers in light and shade.

How correlated: paint is not smooth, and sensors have columns. What is left after a fit is correlated from pixel to
pixel, and where paint multiplies the light its texture fades in a dark marker. Least squares stays unbiased, but its
usual covariance is too small, up to five times. The noise of a marker is modelled as a sum of covariances of unknown
strengths >= 0: white noise, columns and rows, and noise correlated over several lengths, either in proportion to the
image's brightness (paint) or of constant strength (infrared, sensor). The strengths come from quadratic forms of the
residuals. A fit takes ten degrees of freedom out of a window of 150 to 500 pixels, and from correlated noise the more
the longer it is correlated; the expectation of each form is computed with the projection Q = 1 - U U^T that the fit
applies, E[e^T Q S Q e] = sum_b c_b tr(S Q C_b Q), so the strengths are unbiased (variance components by quadratic
forms: C. R. Rao, J. Multivariate Analysis 1, 1971). The covariance of a centre is then a^T C a with a the influence of
each pixel on it. How strong the noise is the marker's own residuals say; but correlated noise has few independent
pieces in a window. Where markers do not differ by more than such chance (the variance of e^T Q e, 2 tr (Q C)^2), the
frame says it.

All correlations are products of one over rows and one over columns, so that C f is two small matrix products.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

LENGTHS_PX = (0.5, 0.8, 1.2, 1.8, 2.7)  # standard deviations of filters on white noise: correlation exp(-d^2 / (4 l^2))
PARTS = 3 + len(LENGTHS_PX)  # white, columns, rows, lengths
EVIDENCE = 0.7  # constant correlations are believed where they leave less than this of the misfit of proportional ones
OUTVOTED = 3.0  # a marker's residuals count at most so many times the median: a line or a bent background is no noise
TESTED = slice(1, 6)  # forms that hardly depend on the marker's shape: columns, rows, the shorter lengths
UNLIKELY = 4.0  # noise is called white unless one of them differs by so many standard deviations
SAME = 0.08  # ... or where that changes the variance of a centre by less
OWN = 2.5  # chances by which a marker's residuals may be above the frame's before they are its own
NOTHING = 1e-12  # a correlation: what is nearly 0 but not quite makes products ten times as slow
DIFFER = 3.0  # standard deviations of the markers' scatter by which they differ by more than chance


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
    chance : standard deviation of the logarithm of one marker's residual variance in noise that is the same for all; 0
        where noise is white or the markers differ by more: each marker's own residuals count
    usual : mean residual variance of the clean markers over `curve`, which is made without the largest
    odd : of white noise, variance of a centre over what least squares makes it from the residuals (`template.odd`)
    """

    curve: Array
    constant: Array
    paint: Array
    kept: float
    texture: float = 0.0
    chance: float = 0.0
    usual: float = 1.0
    odd: float = 1.0

    @staticmethod
    def white(sigma: float) -> FrameNoise:
        """White noise of a standard deviation in grey levels."""
        return FrameNoise(np.array([sigma**2, 0.0, 0.0]), np.eye(PARTS)[0], np.zeros(PARTS), 1.0)

    @property
    def is_white(self) -> bool:
        """Whether the usual covariance of least squares holds, but for the factor `odd`."""
        return not (self.constant[1:].any() or self.paint.any())

    def variance(self, level: ArrayLike) -> Array:
        """Residual variance to be expected at grey levels."""
        v = np.abs(np.asarray(level, dtype=float))
        return np.asarray(self.curve[0] + v * (self.curve[1] + v * self.curve[2]))

    def factor(self, variance: Array, level: ArrayLike) -> Array:
        """Noise of markers (B,) over their residual variances, which are too small or too large by chance.

        What is above the frame's noise at a grey level by far more than chance is the marker's own.
        """
        if self.chance == 0.0:
            return np.full(len(variance), self.odd)
        with np.errstate(divide="ignore", invalid="ignore"):
            above = np.log(variance / (self.usual * self.variance(level)))
        by_chance = np.where(np.isfinite(above), np.minimum(above, OWN * self.chance), 0.0)
        return np.asarray(self.odd * np.exp(-by_chance))

    def covariance(self, images: Array, variance: Array) -> Array:
        """Covariance (B, 2, 2) of the centres of fits with images `Batch.images` and residual variances (B,)."""
        bright = brightness(images)
        pixels = np.maximum((bright != 0).sum((1, 2)), 1)
        total = self.constant.sum() + self.paint.sum() * (bright**2).sum((1, 2)) / pixels
        cov = _of_centres(images, self.constant, self.paint)
        return np.asarray(cov * (variance / (self.kept * total))[:, None, None])


def _of_centres(images: Array, constant: Array, paint: Array) -> Array:
    """(B, 2, 2) covariance of the centres for noise of these strengths."""
    influence, bright = images[:, :2], brightness(images)
    cov = np.zeros((len(images), 2, 2))
    for strengths, weighted in ((constant, influence), (paint, influence * bright[:, None])):
        for strength, (rows, columns) in zip(strengths, _tables(images.shape[-1]), strict=True):
            if strength > 0.0:
                cov += strength * np.einsum("kiab,kjab->kij", weighted, rows @ weighted @ columns)
    return cov


def brightness(images: Array) -> Array:
    """Model images (B, S, S) relative to the brightest place of their window, 0 where a pixel was not used."""
    model = images[:, 3]
    return np.asarray(model / np.maximum(np.abs(model).max((1, 2), keepdims=True), 1e-300))


def frame_noise(images: Array, jacobian: Array, variance: Array, level: Array, multiplicative: bool) -> FrameNoise:
    """Noise of a frame from some of its clean markers.

    Parameters
    ----------
    images : (B, 4, S, S), `Batch.images` of the markers; the first must be a typical one
    jacobian : (10, S, S) derivatives of the model of the first marker, 0 where its pixels were not used
    variance, level : (B,) residual variance of the fits, largest grey level of the windows
    multiplicative : whether paint multiplies the light, so that its texture is proportional to the brightness
    """
    curve = _transfer(variance, level)
    residual = images[:, 2] / np.sqrt(variance)[:, None, None]
    used, tables = (images[:, 3] != 0).astype(float), _tables(images.shape[-1])
    pixels = used.sum((1, 2))
    each, plain = _limited(_forms(residual * used) / pixels), FrameNoise(curve, np.eye(PARTS)[0], np.zeros(PARTS), 1.0)
    # Whether it is white the first forms say, and what white noise makes of them: the rest is asked where it is not.
    forms = each.mean(axis=1)
    expected = _expectations([used[0]], tables, jacobian, float(pixels[0]), TESTED.stop)[0]
    unlike = np.abs(forms[: TESTED.stop] - expected[:, 0] * forms[0] / expected[0, 0])[TESTED]
    if (unlike < UNLIKELY * each[TESTED].std(axis=1) / np.sqrt(len(images))).all():
        return plain
    from scipy.optimize import nnls  # a twentieth of the time of a first picture, whose noise is white as a rule

    bright = brightness(images)
    contrast = np.abs(np.sign(images[:, 3]) - bright)
    each = np.concatenate([each, *(_limited(_forms(residual * w) / pixels) for w in (bright, contrast))])
    forms = each.mean(axis=1)
    expected, size = _expectations([used[0], bright[0], contrast[0]], tables, jacobian, float(pixels[0]))
    scaled, target = expected / size[:, None], forms / size
    unit = np.linalg.norm(scaled, axis=0)
    lengths, best, misfit = list(range(3, PARTS)), np.zeros(2 * PARTS), np.inf
    paint = [0, 1, 2, PARTS, *(PARTS + k for k in lengths)] if multiplicative else list(range(PARTS))
    for family, trust in ((paint, 1.0), (list(range(PARTS)), EVIDENCE)):
        strengths = np.zeros(2 * PARTS)
        strengths[family], left = nnls((scaled / unit)[:, family], target)
        if left < trust * misfit:
            best, misfit = strengths / unit, left
    total = best[:PARTS].sum() + best[PARTS:].sum() * float((bright[0] ** 2).sum() / pixels[0])
    kept = float(expected[0] @ best) * pixels[0] / (pixels[0] - len(jacobian)) / total
    grain = np.where(np.arange(PARTS) < 3, 0.0, best[PARTS:])
    texture = [np.trace(_of_centres(images, *c), axis1=1, axis2=2).sum()
               for c in ((np.zeros(PARTS), grain), (best[:PARTS], best[PARTS:]))]  # fmt: skip
    found = FrameNoise(curve, best[:PARTS], best[PARTS:], kept, float(texture[0] / texture[1]))
    # tr (Q C Q)^2 and tr Q C Q, of which the variance of the residuals' sum of squares is made.
    chance = float(np.sqrt(2.0 * best @ expected[: 2 * PARTS] @ best / pixels[0]) / (expected[0] @ best))
    ratio = variance / found.variance(level)
    if np.log(ratio).std() < chance * np.sqrt(1.0 + DIFFER * np.sqrt(2.0 / len(ratio))):
        found = replace(found, chance=chance, usual=float(ratio.mean()))
    size_of = [np.trace(noise.covariance(images[:1], variance[:1])[0]) for noise in (found, plain)]
    return plain if abs(size_of[0] - size_of[1]) < SAME * size_of[1] else found


def _limited(forms: Array) -> Array:
    """Forms (PARTS, B) of which none counts more than a marker's may."""
    return np.asarray(np.minimum(forms, OUTVOTED * np.median(forms, axis=1, keepdims=True)))


def _transfer(variance: Array, level: Array) -> Array:
    """Coefficients >= 0 of variance = c0 + c1 v + c2 v^2, by relative errors, without markers far above it."""
    from scipy.optimize import nnls

    design = np.abs(level)[:, None] ** np.arange(3)
    good, curve = np.ones(len(variance), dtype=bool), np.array([np.median(variance), 0.0, 0.0])
    for _ in range(3):
        weight = 1.0 / np.maximum(design @ curve, 1e-300)
        scale = np.maximum(np.abs(design[good] * weight[good, None]).max(axis=0), 1e-300)
        curve = nnls(design[good] * weight[good, None] / scale, variance[good] * weight[good])[0] / scale
        ratio = variance / np.maximum(design @ curve, 1e-300)
        good = ratio < 2.0 * max(1.0, float(np.median(ratio[good])))
    return np.asarray(curve)


def _forms(images: Array) -> Array:
    """Quadratic forms (PARTS, B) of images (B, S, S), one for each of `_tables`; to 1e-6: chance moves them by 1e-2."""
    count, size = images.shape[:2]
    rows = images.astype(np.float32).reshape(-1, size)
    turned = np.ascontiguousarray(rows.reshape(images.shape).swapaxes(1, 2)).reshape(count, -1)
    out = [np.square(images).sum((1, 2)), np.square(images.sum(1)).sum(1), np.square(images.sum(2)).sum(1)]
    for _, table in _tables(size)[3:]:
        along = table.astype(np.float32)
        half = np.ascontiguousarray((rows @ along).reshape(images.shape).swapaxes(1, 2))
        out.append(np.einsum("ka,ka->k", (half.reshape(-1, size) @ along).reshape(count, -1), turned))
    return np.array(out, dtype=np.float64)


@cache
def _tables(size: int) -> tuple[tuple[Array, Array], ...]:
    """Correlations (S, S) along columns and along rows of pixels: white, columns, rows, then `LENGTHS_PX`."""
    gap2 = (np.arange(size)[:, None] - np.arange(size)[None, :]) ** 2
    alone, together = np.eye(size), np.ones((size, size))
    lengths = [np.exp(-gap2 / (4.0 * length**2)) for length in LENGTHS_PX]
    lengths = [np.where(t > NOTHING, t, 0.0) for t in lengths]
    return (alone, alone), (together, alone), (alone, together), *((t, t) for t in lengths)


def _expectations(
    weights: list[Array], tables: tuple[tuple[Array, Array], ...], jacobian: Array, pixels: float, count: int = PARTS
) -> tuple[Array, Array]:
    """Expectations (forms, parts) of the forms per pixel for each part of strength 1, and the forms' own size.

    Of each weight the first `count` of the tables make forms; the first two weights, parts. To 1e-6, as the forms.

    With S = w T w and C = v T' v: tr(S Q C Q) = tr(S C) - 2 tr(U^T S C U) + tr(U^T S U U^T C U), and
    tr(S C) = (w v)^T (T * T') (w v) because T * T' is again a correlation along columns times one along rows.
    """
    shape = jacobian.shape
    basis = np.linalg.qr(jacobian.reshape(shape[0], -1).T)[0].T.reshape(shape).astype(np.float32)
    weights = [w.astype(np.float32) for w in weights]
    rows, columns = np.array(tables[:count], dtype=np.float32).swapaxes(0, 1)
    parts = count * len(weights[:2])
    sandwich = np.concatenate([w * (rows[:, None] @ (w * basis) @ columns[:, None]) for w in weights])
    inner = np.einsum("iab,fjab->fij", basis, sandwich, optimize=True)
    flat = sandwich.reshape(len(sandwich), -1)
    out = np.tensordot(inner, inner[:parts].swapaxes(1, 2), axes=((1, 2), (1, 2))) - 2.0 * flat @ flat[:parts].T
    a, b = np.triu_indices(count)
    both_rows, both_columns, block = rows[a] * rows[b], columns[a] * columns[b], np.empty((count, count))
    for i, w in enumerate(weights):
        for j, v in enumerate(weights[:2]):
            block[a, b] = block[b, a] = ((w * v) * (both_rows @ (w * v) @ both_columns)).sum((1, 2))
            out[i * count : (i + 1) * count, j * count : (j + 1) * count] += block
    size = np.concatenate([np.sqrt((w**2 * (rows**2 @ w**2 @ columns**2)).sum((1, 2))) for w in weights])
    return np.asarray(out, np.float64) / pixels, np.asarray(size, np.float64) / pixels
