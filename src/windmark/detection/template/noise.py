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
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.detection.template.forms import PARTS, expectations, forms_of, tables_of
from windmark.detection.template.stripes import no_stripes, of_stripes, unsure, with_stripes

Array = NDArray[np.float64]

EVIDENCE = 0.7  # constant correlations are believed where they leave less than this of the misfit of proportional ones
OUTVOTED = 3.0  # a marker's residuals count at most so many times the median: a line or a bent background is no noise
COLUMNS, SHARE = slice(1, 3), 0.05  # columns and rows; of all strengths, from which they may be stripes
TESTED = slice(1, 6)  # forms that hardly depend on the marker's shape: columns, rows, the shorter lengths
UNLIKELY = 4.0  # noise is called white unless one of them differs by so many standard deviations
SAME = 0.08  # ... or where that changes the variance of a centre by less
OWN = 2.5  # chances by which a marker's residuals may be above the frame's before they are its own
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
    stripes : (2, K) relative strengths of vertical and of horizontal stripes of each of `stripes.frequencies`
    """

    curve: Array
    constant: Array
    paint: Array
    kept: float
    texture: float = 0.0
    chance: float = 0.0
    usual: float = 1.0
    odd: float = 1.0
    stripes: Array = field(default_factory=no_stripes)

    @staticmethod
    def white(sigma: float) -> FrameNoise:
        """White noise of a standard deviation in grey levels."""
        return FrameNoise(np.array([sigma**2, 0.0, 0.0]), np.eye(PARTS)[0], np.zeros(PARTS), 1.0)

    @property
    def is_white(self) -> bool:
        """Whether the usual covariance of least squares holds, but for the factor `odd`."""
        return not (self.constant[1:].any() or self.paint.any() or self.stripes.any())

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
        total = self.constant.sum() + self.stripes.sum() + self.paint.sum() * (bright**2).sum((1, 2)) / pixels
        cov = _of_centres(images, self.constant, self.paint) + of_stripes(images[:, :2], self.stripes)
        return np.asarray(cov * (variance / (self.kept * total))[:, None, None])


def _of_centres(images: Array, constant: Array, paint: Array) -> Array:
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
    used, tables = (images[:, 3] != 0).astype(float), tables_of(images.shape[-1])
    pixels = used.sum((1, 2))
    each = _limited(forms_of(residual * used) / pixels)
    plain = FrameNoise(curve, np.eye(PARTS)[0], np.zeros(PARTS), 1.0)
    # Whether it is white the first forms say, and what white noise makes of them: the rest is asked where it is not.
    forms = each.mean(axis=1)
    expected = expectations([used[0]], tables, jacobian, float(pixels[0]), TESTED.stop)[0]
    unlike = np.abs(forms[: TESTED.stop] - expected[:, 0] * forms[0] / expected[0, 0])[TESTED]
    if (unlike < UNLIKELY * each[TESTED].std(axis=1) / np.sqrt(len(images))).all():
        return plain
    bright = brightness(images)
    parts = _components(residual, used, bright, np.abs(np.sign(images[:, 3]) - bright), each, jacobian, multiplicative)
    constant, paint, stripes = parts.constant, parts.paint, parts.stripes
    total = constant.sum() + stripes.sum() + paint.sum() * float((bright[0] ** 2).sum() / pixels[0])
    kept = parts.once * pixels[0] / (pixels[0] - len(jacobian)) / total
    grain = np.where(np.arange(PARTS) < 3, 0.0, paint)
    of_grain, of_all = _of_centres(images, np.zeros(PARTS), grain), _of_centres(images, constant, paint)
    of_all += of_stripes(images[:, :2], stripes)
    texture = [np.trace(cov, axis1=1, axis2=2).sum() for cov in (of_grain, of_all)]
    found = FrameNoise(curve, constant, paint, kept, float(texture[0] / texture[1]), stripes=stripes)
    chance = float(np.sqrt(2.0 * parts.twice / pixels[0]) / parts.once)
    ratio = variance / found.variance(level)
    if np.log(ratio).std() < chance * np.sqrt(1.0 + DIFFER * np.sqrt(2.0 / len(ratio))):
        found = replace(found, chance=chance, usual=float(ratio.mean()))
    size_of = [np.trace(noise.covariance(images[:1], variance[:1])[0]) for noise in (found, plain)]
    alike = not stripes.any() and abs(size_of[0] - size_of[1]) < SAME * size_of[1]  # of stripes it is no circle
    return plain if alike else found


@dataclass(frozen=True)
class _Components:
    """Strengths of the parts as `FrameNoise` has them, and tr Q C Q and tr (Q C Q)^2 per pixel: what the sum of squared
    residuals is, and its variance.
    """

    constant: Array
    paint: Array
    stripes: Array
    once: float
    twice: float


def _components(
    residual: Array, used: Array, bright: Array, contrast: Array, each: Array, jacobian: Array, multiplicative: bool
) -> _Components:
    """Strengths of the parts by the forms of residuals, ``each`` the unweighted ones (PARTS, B) of the markers."""
    from scipy.optimize import nnls  # a twentieth of the time of a first picture, whose noise is white as a rule

    pixels, weights = used.sum((1, 2)), [used[0], bright[0], contrast[0]]
    each = np.concatenate([each, *(_limited(forms_of(residual * w) / pixels) for w in (bright, contrast))])
    forms = each.mean(axis=1)
    expected, size = expectations(weights, tables_of(residual.shape[-1]), jacobian, float(pixels[0]))
    scaled, target = expected / size[:, None], forms / size
    unit = np.linalg.norm(scaled, axis=0)
    lengths, best, misfit, parts = list(range(3, PARTS)), np.zeros(2 * PARTS), np.inf, list[int]()
    paint = [0, 1, 2, PARTS, *(PARTS + k for k in lengths)] if multiplicative else list(range(PARTS))
    for family, trust in ((paint, 1.0), (list(range(PARTS)), EVIDENCE)):
        strengths = np.zeros(2 * PARTS)
        strengths[family], left = nnls((scaled / unit)[:, family], target)
        if left < trust * misfit:
            best, misfit, parts = strengths / unit, left, family
    off = np.abs(expected[:PARTS] @ best - forms[:PARTS])
    across = each[1] - each[2]  # alike where nothing tells columns from rows
    striped = abs(across.mean()) > UNLIKELY * across.std() / np.sqrt(len(across))
    asked = best[COLUMNS] > SHARE * best.sum()
    if asked.any() and (striped or (off > UNLIKELY * unsure(each[:PARTS])).any()):
        found = with_stripes(residual, used, jacobian, weights, each, expected, best, parts, asked)
        if found is not None:
            (best, stripes), *squares = found
            return _Components(best[:PARTS], best[PARTS:], stripes, *squares)
    squares = [float(expected[0] @ best), float(best @ expected[: 2 * PARTS] @ best)]
    return _Components(best[:PARTS], best[PARTS:], no_stripes(), *squares)


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
