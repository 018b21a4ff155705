"""Wrong pairs: those that even the most flexible transformation through the others does not explain."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.stats import f as f_distribution

from windmark.geometry.errors import DegenerateGeometry
from windmark.geometry.planar.fit import PlanarFit, fit_planar
from windmark.geometry.planar.transform import NEEDED

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

CHANCE = 1e-5
"""A good pair looks so wrong as rarely as this."""
LEAST_PX, SIGMAS = 0.1, 5.0
"""And by less than this nothing is called wrong, nor within so many sigma of its own marks."""
MOST = 0.3
"""Part of the pairs that may be wrong."""
NEIGHBOURS = 6


def sound_pairs(x: Array, y: Array, cov_x: Array, cov_y: Array) -> Mask:
    """Which pairs (N,) of places are sound.

    A pair is wrong if leaving it out lowers the weighted sum of squares of the others' fit by more than chance does
    (the externally studentised residual; a mark with much leverage cannot hide, for its residual is judged by a fit
    without it). The fit is the most flexible one that the number of pairs allows, so that deformation is not taken for
    a wrong pair. Pairs go one after the other, or together where they are no neighbours.
    """
    kept = np.ones(len(x), dtype=bool)
    spread = np.sqrt((np.trace(cov_x, axis1=1, axis2=2) + np.trace(cov_y, axis1=1, axis2=2)) / 2)
    while kept.sum() > max(3, (1 - MOST) * len(x)):
        at = np.flatnonzero(kept)
        fit = _flexible(x[at], y[at], cov_x[at], cov_y[at])
        if fit is None:
            break
        free = 2 * len(at) - fit.freedom - 2
        if free < 1:
            break
        rest = np.maximum(fit.weighted - fit.evidence, 1e-12 * max(fit.weighted, 1e-300))
        chance = f_distribution.sf(fit.evidence / 2 / (rest / free), 2, free)
        off = np.hypot(*fit.held_out.T)
        wrong = (chance < CHANCE) & (off > LEAST_PX) & (off > SIGMAS * np.nan_to_num(spread[at]))
        if not wrong.any():
            break
        near = cKDTree(x[at]).query(x[at], min(NEIGHBOURS + 1, len(at)))[1]
        worst = wrong & (fit.evidence >= fit.evidence[near].max(axis=1))
        if not worst.any():
            worst = np.arange(len(at)) == int(np.argmax(np.where(wrong, fit.evidence, -1)))
        kept[at[worst]] = False
    return kept


def _flexible(x: Array, y: Array, cov_x: Array, cov_y: Array) -> PlanarFit | None:
    """The most flexible fit that has pairs to spare."""
    for kind in ("spline", "affine", "similarity"):
        if len(x) > NEEDED[kind]:
            try:
                return fit_planar(kind, x, y, cov_x, cov_y)
            except DegenerateGeometry:
                continue
    return None
