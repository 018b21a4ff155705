"""Markers that do not look like the frame's noise: which they are, and how they are fitted again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.detection.template.fit import TUKEY, Batch, Fitted, fit_all
from windmark.detection.template.noise import FrameNoise
from windmark.detection.template.request import Neighbours, Request, Scene
from windmark.detection.template.stroke import fit_strokes
from windmark.geometry.order import median, quantile

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

CLEAN = 5  # clean markers needed to say something about the frame
WORSE, FAR = 1.4, 4.9  # contaminated: residual variance over the expected one; largest residual in standard deviations
BEST, TOLERATED = 48, 0.75  # of so many markers so large a share is what the frame's markers look like
UNUSUAL = 3.2  # the same, in robust standard deviations of the logarithm over the frame


def trust(noise: FrameNoise | None, done: Fitted, batches: list[Batch]) -> tuple[Array, Array]:
    """Covariance of the centres and the residual variance that the frame's noise lets expect.

    White noise: least squares' own covariance. Else that of the frame's noise, scaled by what is known of the marker's
    noise; where weights are used its residuals say nothing, and the frame's noise counts alone.
    """
    cov = done.cov[:, :2, :2].copy()
    if noise is None:
        return cov, np.full(len(cov), np.nan)
    levels, own = level(done.params), done.column("noise2")
    expected, factor = noise.variance(levels), noise.factor(own, levels)
    cov *= factor[:, None, None]
    if not noise.is_white:
        for b in batches:
            variance = np.where(b.weighted, expected[b.index], (own * factor)[b.index])
            cov[b.index] = noise.covariance(b.images, variance)
    return cov, expected


def level(params: Array) -> Array:
    """Grey level of the brighter of marker and background (K,)."""
    return np.asarray(np.fmax(np.abs(params[:, 7]), np.abs(params[:, 7] - params[:, 6])))


def contaminated(chi2: Array, done: Fitted, expected: Array, flags: Ints) -> Bools:
    """Markers whose residuals are not the frame's noise.

    What more than a quarter of the best markers shows is no dirt but the model's error (a hard rim, a sharpened or
    compressed image): it is let pass, as weights and strokes would only fit the pixels' chance pattern.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        far = done.column("largest") / np.sqrt(expected)
    limit, farthest = WORSE, FAR
    usual = np.isfinite(chi2) & (flags == 0) & (done.column("status") == 1)
    if usual.sum() >= 4 * CLEAN:
        logs = np.log(chi2[usual])
        limit = max(limit, float(np.exp(median(logs) + UNUSUAL * scatter(logs))))
        best = np.flatnonzero(usual)[:BEST]
        limit, farthest = max(limit, quantile(chi2[best], TOLERATED)), max(FAR, quantile(far[best], TOLERATED))
    return np.asarray((chi2 > limit) | (far > farthest))


def median_contrast(done: Fitted, worse: Bools) -> float:
    """Depth over background of the clean markers."""
    with np.errstate(divide="ignore", invalid="ignore"):
        contrast = done.params[:, 6] / np.abs(done.params[:, 7])
    good = ~worse & (done.column("status") == 1) & np.isfinite(contrast)
    return median(contrast[good]) if good.any() else 0.5


def decontaminated(
    scene: Scene,
    request: Request,
    plain: Fitted,
    others: Neighbours,
    variance: Array,
    noise: FrameNoise,
    contrast: float,
    radius: Array,
) -> tuple[Fitted, Array, Bools]:
    """Contaminated markers again: with a stroke across them if there is one, else with weights.

    Returns the fits, the covariances of their centres, and which are with a stroke.
    """
    again, batches = _fit_robustly(scene, request, plain, others, np.sqrt(variance), not noise.is_white)
    cov, believed = trust(noise, again, batches)[0], np.zeros(len(radius), dtype=bool)
    if request.shape is None:
        crossed, believed = fit_strokes(scene, request, plain, others, np.sqrt(variance), contrast, radius)
        with np.errstate(invalid="ignore"):  # as much larger in this noise as without stroke
            coloured = np.trace(cov, axis1=1, axis2=2) / np.trace(again.cov[:, :2, :2], axis1=1, axis2=2)
        again.put(np.flatnonzero(believed), crossed.take(believed))
        coloured = np.where(np.isfinite(coloured), coloured, 1.0)[believed, None, None]
        cov[believed] = crossed.cov[believed, :2, :2] * coloured
    return again, cov, believed


def _fit_robustly(
    scene: Scene, request: Request, plain: Fitted, others: Neighbours, noise: Array, images: bool
) -> tuple[Fitted, list[Batch]]:
    """Fits with Tukey's weights for a given noise, the better of two starts: the plain fit, and a round disc."""
    wide = np.maximum(0.5 * plain.column("largest") / (TUKEY * noise), 1.0)
    weighted = replace(request, scale=noise)
    best, batches = _narrowed(scene, replace(weighted, states=plain.states), others, wide, images)
    if request.shape is None:
        usual = np.zeros_like(plain.states)
        usual[:, 2] = usual[:, 4] = 0.25 * request.radius**2 + request.blur**2
        usual[:, 5], usual[:, 6] = request.blur**2, plain.params[:, 6] * request.radius**2
        usual[:, 7] = plain.states[:, 7]
        second, _ = _narrowed(scene, replace(weighted, states=usual), others, wide, False)
        better = (second.column("status") == 1) & ~(best.column("cost") <= second.column("cost"))
        if better.any():
            states = np.where(better[:, None], second.states, best.states)
            best, batches = fit_all(scene, replace(weighted, states=states), others, images=images)
    return best, batches


def _narrowed(
    scene: Scene, request: Request, others: Neighbours, wide: Array, images: bool
) -> tuple[Fitted, list[Batch]]:
    """Fits with weights that start `wide` times as wide and are halved until they are as asked for."""
    states = request.states.copy()
    while (index := np.flatnonzero(wide > 1.0)).size:
        one = request.take(index)
        one = replace(one, scale=one.scale * wide[index], states=states[index])
        done, _ = fit_all(scene, one, others.take(index), images=False, rough=True)
        fitted = done.column("status") >= 0
        states[index[fitted]] = done.states[fitted]
        wide = np.maximum(0.5 * wide, 1.0)
    return fit_all(scene, replace(request, states=states), others, images=images)


def scatter(values: Array) -> float:
    """Robust standard deviation."""
    return 1.4826 * median(np.abs(values - median(values)))
