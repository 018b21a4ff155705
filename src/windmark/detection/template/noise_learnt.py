"""Noise of a frame learnt from the residuals of its clean markers.

The strengths of the parts of `noise` come from quadratic forms of the residuals. A fit takes ten degrees of freedom out
of a window of 150 to 500 pixels, and from correlated noise the more the longer it is correlated; the expectation of
each form is computed with the projection Q = 1 - U U^T that the fit applies, E[e^T Q S Q e] = sum_b c_b tr(S Q C_b Q),
so the strengths are unbiased (variance components by quadratic forms: C. R. Rao, J. Multivariate Analysis 1, 1971).

Two answers are given. What a covariance must cover is learnt from whole windows: also the model's error, which on many
discs is alike. What pixels are weighed by (`weigh`) is learnt where no disc is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.detection.template.noise import PARTS, FrameNoise, brightness, of_centres, tables_of

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

EVIDENCE = 0.7  # constant correlations are believed where they leave less than this of the misfit of proportional ones
OUTVOTED = 3.0  # a marker's residuals count at most so many times the median: a line or a bent background is no noise
TESTED = slice(1, 6)  # forms that hardly depend on the marker's shape: columns, rows, the shorter lengths
UNLIKELY = 4.0  # noise is called white unless one of them differs by so many standard deviations
NOT_BESIDE = 3 * PARTS  # forms of the whole windows; those of the surface beside the discs follow
EXPLAINED = 1.5  # by which variances, on discs and beside, may differ from what one noise for both explains
LEVEL_MATTERS = 1.5  # constant variance over the one that grows, up to which it is worth it
SAME = 0.08  # ... or where that changes the variance of a centre by less


def frame_noise(
    images: Array, jacobian: Array, variance: Array, level: Array, beside: Array, multiplicative: bool
) -> FrameNoise:
    """Noise of a frame from some of its clean markers.

    Parameters
    ----------
    images : (B, 4, S, S), `Batch.images` of the markers; the first must be a typical one
    jacobian : (10, S, S) derivatives of the model of the first marker, 0 where its pixels were not used
    variance, level : (B,) residual variance of the fits, largest grey level of the windows
    beside : (B, S, S) where no disc is: its blurred rim neither
    multiplicative : whether paint multiplies the light, so that its texture is proportional to the brightness
    """
    curve = _transfer(variance, level)
    forms = _measure(images, jacobian, variance, None)
    plain, correlated = FrameNoise(curve, np.eye(PARTS)[0], np.zeros(PARTS), 1.0), forms.unlike(0)
    strengths, photons = np.eye(PARTS * 2)[0], 0.0
    if correlated:
        forms = _measure(images, jacobian, variance, beside)
        strengths, family = _correlated(forms, multiplicative)
        weights = _beside(forms, family)
    else:
        strengths[0], photons = _by_level(forms)
        weights = strengths
    if not (correlated or photons):
        return plain
    total = strengths[:PARTS].sum() + strengths[PARTS:].sum() * forms.bright2 + photons * forms.bright1
    found_in_fits = float(forms.expected[0] @ strengths) + photons * forms.of_photons[0]
    kept = found_in_fits * forms.pixels / (forms.pixels - len(jacobian)) / total
    texture = _texture(images, strengths) if correlated else 0.0
    found = FrameNoise(curve, strengths[:PARTS], strengths[PARTS:], kept, texture, weights, photons)
    size_of = [np.trace(noise.covariance(images[:1], variance[:1])[0]) for noise in (found, plain)]
    same = correlated and abs(size_of[0] - size_of[1]) < SAME * size_of[1]
    return plain if same else found


def _texture(images: Array, strengths: Array) -> float:
    """Part of the centres' variance that is of the paint's texture: in proportion to the light and correlated."""
    grain = np.where(np.arange(PARTS) < 3, 0.0, strengths[PARTS:])
    of_grain, of_all = (np.trace(of_centres(images, *c), axis1=1, axis2=2).sum()
                        for c in ((np.zeros(PARTS), grain), (strengths[:PARTS], strengths[PARTS:])))  # fmt: skip
    return float(of_grain / of_all)


@dataclass(frozen=True)
class _Forms:
    """Quadratic forms of the residuals per pixel, four kinds of `PARTS`: weighted by 1, brightness, contrast, beside.

    `mean`, `unsure` (32,) over the markers; `expected` (32, 16) for each part of strength 1, and `of_photons` (3,) of
    the white ones for photons; `size` (32,) their own; of the typical marker the number of pixels, the mean of its
    brightness and of its square.
    """

    mean: Array
    unsure: Array
    expected: Array
    of_photons: Array
    size: Array
    pixels: float
    bright1: float
    bright2: float

    def unlike(self, first: int) -> bool:
        """Whether the forms of the kind that starts there contradict white noise."""
        kind = slice(first, first + PARTS)
        white = self.expected[kind, 0] * self.mean[first] / self.expected[first, 0]
        return bool((np.abs(self.mean[kind] - white) >= UNLIKELY * self.unsure[kind])[TESTED].any())

    def fitted(self, rows: slice | Ints, family: list[int]) -> tuple[Array, float]:
        """Strengths (16,) >= 0 of a family of parts that explain some of the forms best, and the misfit."""
        from scipy.optimize import nnls

        scaled, strengths = self.expected[rows] / self.size[rows, None], np.zeros(2 * PARTS)
        unit = np.linalg.norm(scaled, axis=0)
        strengths[family], misfit = nnls((scaled / unit)[:, family], self.mean[rows] / self.size[rows])
        return strengths / unit, float(misfit)


def _measure(images: Array, jacobian: Array, variance: Array, beside: Array | None) -> _Forms:
    """The forms of `frame_noise`'s markers; those of what is beside the discs only where that is given."""
    residual = images[:, 2] / np.sqrt(variance)[:, None, None]
    used, bright = (images[:, 3] != 0).astype(float), brightness(images)
    contrast = np.abs(np.sign(images[:, 3]) - bright)
    weights, tables = [used, bright, contrast], tables_of(images.shape[-1])
    if beside is not None:
        weights.append(used * beside)
    pixels = float(used[0].sum())
    # Discs differ in size and tilt: a form counts by how much of the window its weights see in the typical one.
    share = np.array([np.square(w).sum((1, 2)) for w in weights])
    share = share[:, :1] / np.maximum(share, 1e-300) / pixels
    each = np.array([
        np.einsum("kab,kab->k", residual * w, rows @ (residual * w) @ columns) * per
        for w, per in zip(weights, share, strict=True) for rows, columns in tables
    ])  # fmt: skip
    each = np.minimum(each, OUTVOTED * np.median(each, axis=1, keepdims=True))
    expected, size = _expectations([w[0] for w in weights], tables, jacobian, pixels)
    unsure = each.std(axis=1) / np.sqrt(len(images))
    photons = _expected_of_photons([w[0] for w in weights[:3]], bright[0], jacobian) / pixels
    powers = (float((bright[0] ** n).sum() / pixels) for n in (1, 2))
    return _Forms(each.mean(axis=1), unsure, expected, photons, size, pixels, *powers)


def _correlated(forms: _Forms, multiplicative: bool) -> tuple[Array, list[int]]:
    """Strengths (16,) of all parts by the whole windows, and the family of parts that they are of."""
    best, misfit, chosen = np.zeros(2 * PARTS), np.inf, list(range(PARTS))
    paint = [0, 1, 2, *range(PARTS, 2 * PARTS)] if multiplicative else chosen
    paint = [k for k in paint if k not in (PARTS + 1, PARTS + 2)]
    for family, trust in ((paint, 1.0), (list(range(PARTS)), EVIDENCE)):
        strengths, left = forms.fitted(slice(0, NOT_BESIDE), family)
        if left < trust * misfit:
            best, misfit, chosen = strengths, left, family
    return best, chosen


def _beside(forms: _Forms, family: list[int]) -> Array | None:
    """Strengths (16,) by what no disc touches; None where that is white or does not explain what is on the discs.

    What the discs show beyond it is the model's error (a hard rim, pixels that see less than their square), common to
    all markers, or noise of other kinds (a compressed file has none on even ground): no weights can be right then.
    """
    if not (forms.expected[NOT_BESIDE, 0] > 0.0 and forms.unlike(NOT_BESIDE)):  # windows may be full of discs
        return None
    # White noise that fades with the light and such that does not are one where no disc is; how much of it there is in
    # the dark, where texture has faded, the discs have to say.
    level = [0, PARTS, 2 * PARTS]
    rows = np.array([*level, *range(NOT_BESIDE, NOT_BESIDE + PARTS)])
    strengths, _ = forms.fitted(rows, [k for k in family if k != PARTS])
    level.append(NOT_BESIDE)
    if not strengths.any():
        return None
    explained = forms.mean[level] / (forms.expected @ strengths)[level]
    return None if explained.max() > EXPLAINED or explained.min() < 1.0 / EXPLAINED else strengths


def _by_level(forms: _Forms) -> tuple[float, float]:
    """Strengths of white noise and of such whose variance grows with the light: photons. (1, 0) if nothing shows these.

    The variance of what is dark in a window, the form of the contrast, must be clearly smaller than equal variances
    would make it.
    """
    from scipy.optimize import nnls

    white, dark = slice(0, NOT_BESIDE, PARTS), 2 * PARTS
    fall = forms.expected[dark, 0] * forms.mean[0] / forms.expected[0, 0] - forms.mean[dark]
    if fall < UNLIKELY * forms.unsure[dark]:
        return 1.0, 0.0
    parts, size = np.column_stack([forms.expected[white, 0], forms.of_photons]), forms.size[white]
    (constant, light), _ = nnls(parts / size[:, None], forms.mean[white] / size)
    return (float(constant), float(light)) if constant < LEVEL_MATTERS * light else (1.0, 0.0)


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


def _expected_of_photons(weights: list[Array], bright: Array, jacobian: Array) -> Array:
    """Expectations of the white forms, as of `_expectations`, for noise whose variances are the brightness."""
    flat = jacobian.reshape(len(jacobian), -1)
    basis, light = np.linalg.qr(flat.T)[0], bright.ravel()
    inner, out = basis.T @ (light[:, None] * basis), []
    for w in weights:
        square = np.square(w).ravel()
        both = basis.T @ (square[:, None] * basis)
        out.append(square @ light - 2.0 * np.square(basis).sum(axis=1) @ (square * light) + (both * inner).sum())
    return np.array(out)


def _expectations(
    weights: list[Array], tables: tuple[tuple[Array, Array], ...], jacobian: Array, pixels: float
) -> tuple[Array, Array]:
    """Expectations (forms, parts) of the forms per pixel for each part of strength 1, and the forms' own size.

    With S = w T w and C = v T' v: tr(S Q C Q) = tr(S C) - 2 tr(U^T S C U) + tr(U^T S U U^T C U), and
    tr(S C) = (w v)^T (T * T') (w v) because T * T' is again a correlation along columns times one along rows.
    """
    shape = jacobian.shape
    basis = np.linalg.qr(jacobian.reshape(shape[0], -1).T)[0].T.reshape(shape)
    rows, columns = np.array([r for r, _ in tables]), np.array([c for _, c in tables])
    parts = 2 * PARTS
    sandwich = np.concatenate([w * (rows[:, None] @ (w * basis) @ columns[:, None]) for w in weights])
    inner = np.einsum("iab,fjab->fij", basis, sandwich, optimize=True)
    flat = sandwich.reshape(len(sandwich), -1)
    out = np.tensordot(inner, inner[:parts].swapaxes(1, 2), axes=((1, 2), (1, 2))) - 2.0 * flat @ flat[:parts].T
    both_rows, both_columns = rows[:, None] * rows, columns[:, None] * columns
    for i, w in enumerate(weights):
        for j, v in enumerate(weights[:2]):
            block = ((w * v) * (both_rows @ (w * v) @ both_columns)).sum((2, 3))
            out[i * PARTS : (i + 1) * PARTS, j * PARTS : (j + 1) * PARTS] += block
    size = np.concatenate([np.sqrt((w**2 * (rows**2 @ w**2 @ columns**2)).sum((1, 2))) for w in weights])
    return out / pixels, size / pixels
