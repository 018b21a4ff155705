"""Gross errors among the observations of one instant: tested one by one, removed, taken back when they fit.

Baarda's test (1968) for two coordinates at once and correlated observations: with e = C^-1 r and Q_e its covariance,
e_o^T Q_e,oo^-1 e_o of a good observation is chi-square with two degrees of freedom.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.adjust import Problem
from windmark.deformation.setup import Task
from windmark.deformation.sighting import Sighting, by_place
from windmark.geometry.order import median

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MEDIAN = 2 * math.log(2)
"""Of chi-square with two degrees of freedom."""
FALSE = 1e-3
"""Probability of a false rejection in an instant without gross errors."""


def critical(count: int) -> float:
    """Test value that any of ``count`` good observations exceeds with probability `FALSE`."""
    return -2 * math.log(FALSE / max(count, 1))


def test_used(task: Task, term: Sighting, values: Mapping[str, Any], cov: Array, used: Mask) -> Array:
    """(O,) test value of the observations that took part, 0 where nothing checks one; NaN for the others."""
    from windmark.deformation._kernels import test_values

    raw = term.raw_jacobian(values)
    assert raw is not None  # the engine never stands where the model has no prediction
    out, of_used = np.full(len(used), np.nan), np.empty(int(used.sum()))
    point, view = (a[used] for a in task.slots)
    # Where the others do not check an observation its spread is rounding.
    test_values(term.whitener, *raw, np.ascontiguousarray(cov), point, view, 1e-9, of_used)
    out[used] = of_used
    return out


def test_left_out(
    task: Task, problem: Problem, values: Mapping[str, Any], cov: Array, shift: Array, left: Mask
) -> Array:
    """(O,) test value of observations that did not take part, from their prediction; NaN for the others."""
    out = np.full(len(left), np.nan)
    if not left.any():
        return out
    term = task.term(values, task.sights(shift, left), left, problem.terms[0].loss)
    raw = term.raw_jacobian(values)
    if raw is None:
        return out
    residual, j = raw
    point, view = (a[left] for a in task.slots)
    own = point[:, None], 2 * view[:, None] + np.arange(2)
    spread = task.observations.cov[left] + (j[own] @ cov) @ np.swapaxes(j[own], 1, 2)
    place_cov = task.own_cov(values)
    if place_cov is not None:
        by_own = by_place(term.sights, values, task.tunnel_place(values))[own]
        spread = spread + by_own @ place_cov[point] @ np.swapaxes(by_own, 1, 2)
    r = residual[own]
    out[left] = (r * np.linalg.solve(spread, r[..., None])[..., 0]).sum(axis=1)
    return out


def scale_of(test: Array) -> float:
    """How many times larger than their covariance the squared residuals are, robustly; at least 1."""
    known = test[np.isfinite(test)]
    return max(median(known) / MEDIAN, 1.0) if len(known) else 1.0
