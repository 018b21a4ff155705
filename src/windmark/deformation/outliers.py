"""Gross errors among the observations of one instant: tested one by one, removed, taken back when they fit.

Baarda's test (1968) for two coordinates at once and correlated observations: with e = C^-1 r and Q_e its covariance,
e_o^T Q_e,oo^-1 e_o of a good observation is chi-square with two degrees of freedom.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from windmark.adjust import Problem
from windmark.deformation.setup import Task
from windmark.deformation.sighting import LAW, Sighting

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MEDIAN = float(chi2.ppf(0.5, 2))
FALSE = 1e-3
"""Probability of a false rejection in an instant without gross errors."""


def critical(count: int) -> float:
    """Test value that one of ``count`` good observations exceeds with probability `FALSE`."""
    return float(chi2.isf(FALSE / max(count, 1), 2))


def columns_of(term: Sighting, problem: Problem, values: Mapping[str, Any]) -> tuple[Array, Array]:
    """Residuals (P, 2 V) in pixels and their derivative (P, 2 V, F) by all that is free, in the problem's order."""
    raw = term.raw_jacobian(values)
    assert raw is not None  # the engine never stands where the model has no prediction
    parts = [raw[1].get(name) for name in problem.blocks]
    sizes = [len(block.names) for block in problem.blocks.values()]
    empty = [np.zeros((*raw[0].shape, n)) for n in sizes]
    return raw[0], np.concatenate([e if p is None else p for p, e in zip(parts, empty, strict=True)], axis=2)


def test_used(task: Task, term: Sighting, problem: Problem, values: Mapping[str, Any], cov: Array, used: Mask) -> Array:
    """(O,) test value of the observations that took part; NaN for the others, inf where nothing checks one."""
    residual, j = columns_of(term, problem, values)
    precision = np.swapaxes(term.whitener, 1, 2) @ term.whitener
    e = (precision @ residual[..., None])[..., 0]
    pj = precision @ j
    spread = precision - pj @ cov @ np.swapaxes(pj, 1, 2)
    row, view = task.slots
    out = np.full(len(used), np.nan)
    two = 2 * view[used, None] + np.arange(2)
    own, e_own = spread[row[used, None, None], two[:, :, None], two[:, None, :]], e[row[used, None], two]
    weight = precision[row[used, None, None], two[:, :, None], two[:, None, :]]
    # Where the others do not check an observation its spread is rounding: no test value then.
    checked = np.linalg.det(own) > 1e-9 * np.linalg.det(weight)
    value = np.zeros(len(own))
    value[checked] = (e_own[checked] * np.linalg.solve(own[checked], e_own[checked, :, None])[..., 0]).sum(axis=1)
    out[used] = value
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
    residual, j = columns_of(term, problem, values)
    row, view = task.slots
    for o in np.flatnonzero(left):
        two = slice(2 * view[o], 2 * view[o] + 2)
        own = task.observations.cov[o] + j[row[o], two] @ cov @ j[row[o], two].T
        if task.place_cov is not None:
            own = own + _by_own_place(task, term, values, row[o], view[o])
        r = residual[row[o], two]
        out[o] = float(r @ np.linalg.solve(own, r))
    return out


def _by_own_place(task: Task, term: Sighting, values: Mapping[str, Any], row: int, view: int) -> Array:
    from windmark.deformation.sighting import by_place

    assert task.place_cov is not None
    j = by_place(term.sights, values, task.tunnel_place(values))[row, 2 * view : 2 * view + 2]
    return np.asarray(j @ task.place_cov[row] @ j.T)


def scale_of(test: Array) -> float:
    """How many times larger than their covariance the squared residuals are, robustly; at least 1."""
    known = test[np.isfinite(test)]
    return max(float(np.median(known)) / MEDIAN, 1.0) if len(known) else 1.0


__all__ = ["LAW", "columns_of", "critical", "scale_of", "test_left_out", "test_used"]
