"""Markers that stand still while the model moves: those on walls and floor, that have no part in its motion."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.geometry.planar import choose

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

STILL_PX, SIGMAS = 0.15, 4.0
"""A marker that moved less, or less than so many sigma of its marks, stands still."""
FEWEST = 4
"""Moving markers that are needed to tell."""
BETTER = 0.7
"""Without those that stand still the others must be predicted so much better: else they are part of the same motion."""
OFF = 3.0
"""And each is off by so many times the held-out residual of the others."""


def have_not_moved(x: Array, y: Array, cov_x: Array, cov_y: Array) -> Mask:
    """Which pairs (N,) are at the same place in both pictures."""
    noise = np.sqrt((np.trace(cov_x, axis1=1, axis2=2) + np.trace(cov_y, axis1=1, axis2=2)) / 2)
    return np.asarray(np.hypot(*(y - x).T) < np.maximum(STILL_PX, SIGMAS * np.nan_to_num(noise)))


def standing_still(x: Array, y: Array, cov_x: Array, cov_y: Array) -> Mask:
    """Which pairs (N,) stand still though the motion of the others says that they should move.

    A marker on the model that happens not to move, near the axis of a rotation, is not among them: the others agree
    with it. Where camera and walls move against each other nothing stands still; a mask has to tell.
    """
    still = have_not_moved(x, y, cov_x, cov_y)
    nothing = np.zeros(len(x), dtype=bool)
    if not still.any() or (~still).sum() < FEWEST:
        return nothing
    every, moving = choose(x, y, cov_x, cov_y), choose(x[~still], y[~still], cov_x[~still], cov_y[~still])
    if moving.chosen is None or moving.chosen.fit is None:
        return nothing
    fit = moving.chosen.fit
    if every.chosen is not None and every.chosen.fit is not None:
        with_them = np.sqrt((every.chosen.fit.held_out[~still] ** 2).sum(axis=1).mean())
        if fit.held_out_px > BETTER * with_them:
            return nothing
    off = np.hypot(*(fit.transform.apply(x) - y).T)
    return still & (off > max(OFF * fit.held_out_px, 2 * STILL_PX))
