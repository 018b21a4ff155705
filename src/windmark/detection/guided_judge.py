"""Whether a marker is where it was predicted: what speaks for it, against the surface round it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.detection.pairs import close_pairs
from windmark.detection.template.request import Request, Scene
from windmark.detection.template.result import TemplateFits
from windmark.detection.template.search import surroundings

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

SHAPE_MIN = 0.75  # correlation of disc and window but for noise: discs have 0.88 half a pixel off, an edge 0.52
CLEAR, CLEAR_SHAPE = 25.0, 0.85  # depth over its sigma and correlation: such markers need no proof by the surface
BEYOND_PX = 1.0  # a fit may end so far outside the searched square

FOUND, UNSEEN, CHANCE, OTHER, LOST, SAME = range(6)
ANSWERS = {
    FOUND: "found",
    UNSEEN: "out of sight: outside the image, masked or saturated",
    CHANCE: "nothing there: the surface round it looks the same as often",
    OTHER: "something else there: no disc of this shape",
    LOST: "no place: the fit did not settle within the searched square",
    SAME: "the same marker as another prediction that is nearer to it",
}
"""Meaning of the codes of `Guided.answer`."""


def judge(
    scene: Scene, asked: Request, placed: Request, found: Array, fits: TemplateFits, steps: int, false_alarms: float
) -> tuple[Ints, Array, Array]:
    """Answers (K,), standard deviations of the depth and log10 of the false-alarm number."""
    with np.errstate(invalid="ignore", divide="ignore"):
        z = fits.depth / fits.depth_sigma
    sigma, nfa = fits.depth_sigma.copy(), _log10_tail(z, np.inf)
    # Steep light times disc is an edge, so the fit's own correlation does not tell edges from discs.
    shape = np.fmin(fits.correlation, found[:, 2])
    doubt = np.flatnonzero(~((z >= CLEAR) & (shape >= CLEAR_SHAPE)) & np.isfinite(found[:, 2]))
    if doubt.size:
        settled = np.isfinite(fits.xy[doubt])
        there = surroundings(scene, replace(placed.take(doubt), xy=np.where(settled, fits.xy[doubt], placed.xy[doubt])))
        known = np.isfinite(there.spread)
        sigma[doubt] = np.where(known, np.fmax(sigma[doubt], there.spread), sigma[doubt])
        # The median of n scatters of a normal law is known as well as the variance of 0.37 n of its values.
        freedom = np.where(known, 0.37 * there.count, np.inf)
        with np.errstate(invalid="ignore", divide="ignore"):
            above = (fits.depth[doubt] - np.where(known, there.depth, 0.0)) / sigma[doubt]
            noise2 = np.where(known, there.variance, np.nan_to_num(fits.noise[doubt] ** 2 / fits.chi2[doubt]))
        shape[doubt] = np.fmin(
            _but_for_noise(found[doubt, 2], found[doubt, 6], noise2),
            _but_for_noise(fits.correlation[doubt], fits.noise[doubt] ** 2, noise2),
        )
        nfa[doubt] = _log10_tail(above, freedom)
    nfa += 2.0 * np.log10(2 * steps + 1)
    away = np.abs(fits.xy - asked.xy).max(axis=1)
    answer = np.full(len(z), FOUND, dtype=np.int64)
    with np.errstate(invalid="ignore"):
        answer[~(shape >= SHAPE_MIN)] = OTHER
        answer[~fits.converged | ~np.isfinite(fits.cov).all(axis=(1, 2)) | ~(away <= steps + BEYOND_PX)] = LOST
        answer[~(nfa <= np.log10(false_alarms)) | ~(fits.depth > 0.0)] = CHANCE
        answer[~np.isfinite(found[:, 2])] = UNSEEN
    _same(answer, fits, asked)
    return answer, sigma, nfa


def _but_for_noise(correlation: Array, misfit: Array, noise2: Array) -> Array:
    """Correlation of disc and window if the window had no noise; `misfit` is the residual variance with noise."""
    r2 = np.clip(correlation, 0.0, 1.0) ** 2
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.sqrt(r2 / (r2 + np.clip(1.0 - noise2 / misfit, 0.0, 1.0) * (1.0 - r2))))


def _log10_tail(z: Array, freedom: Array | float) -> Array:
    """Log10 of the probability that Student's t exceeds z; normal where the degrees of freedom are infinite."""
    from scipy.special import log_ndtr, stdtr

    above = np.where(np.isnan(z), 0.0, z)
    if not np.isfinite(freedom).any():
        return np.asarray(log_ndtr(-above) / np.log(10.0))
    with np.errstate(divide="ignore"):
        return np.asarray(np.log10(stdtr(np.where(np.isfinite(freedom), freedom, 1e9), -above)))


def _same(answer: Ints, fits: TemplateFits, asked: Request) -> None:
    """Where two predictions found one marker the nearer one has it."""
    index = np.flatnonzero(answer == FOUND)
    if len(index) < 2:
        return
    pairs = close_pairs(fits.xy[index], float(asked.radius[index].max()))
    if not len(pairs):
        return
    away = np.hypot(*(fits.xy - asked.xy).T)
    for i, j in index[pairs].tolist():
        if np.hypot(*(fits.xy[i] - fits.xy[j])) < min(asked.radius[i], asked.radius[j]):
            answer[i if away[i] > away[j] else j] = SAME
