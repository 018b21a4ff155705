"""Which kind of transformation pairs of marks support: judged on marks that the fit has not seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.geometry.errors import DegenerateGeometry
from windmark.geometry.planar.fit import PlanarFit, fit_planar
from windmark.geometry.planar.transform import KINDS

Array = NDArray[np.float64]

FOLD = 0.05
"""Area of a mark's surroundings, as part of the median one, below which a transformation folds there."""


@dataclass(frozen=True)
class Trial:
    """One kind: its fit, or why it has none."""

    kind: str
    fit: PlanarFit | None
    reason: str = ""


@dataclass(frozen=True)
class Choice:
    """All trials, simplest first, and the chosen one (None: no kind is supported; ``reason`` says why)."""

    trials: tuple[Trial, ...]
    chosen: Trial | None
    reason: str


def choose(x: Array, y: Array, cov_x: Array, cov_y: Array, kinds: Sequence[str] = KINDS) -> Choice:
    """Fit every kind and choose the simplest that predicts held-out marks no worse than the best.

    No worse: the mean difference of the squared held-out residuals, mark by mark, is within one standard error. The
    same marks judge all kinds.

    Parameters
    ----------
    x, y : (N, 2) sound pairs, reference and image
    cov_x, cov_y : (N, 2, 2)
    kinds : those that are tried, simplest first
    """
    trials = tuple(_trial(kind, x, y, cov_x, cov_y) for kind in kinds)
    fits = [t for t in trials if t.fit is not None]
    if not fits:
        return Choice(trials, None, "; ".join(t.reason for t in trials))
    square = {t.kind: (t.fit.held_out**2).sum(axis=1) for t in fits if t.fit is not None}
    best = min(fits, key=lambda t: float(square[t.kind].mean()))
    for trial in fits:
        worse = square[trial.kind] - square[best.kind]
        if worse.mean() <= worse.std() / np.sqrt(len(worse)):
            break
    word = "least" if trial is best else f"no more than chance above the least, of {best.kind}"
    return Choice(trials, trial, f"{trial.kind}: held-out residual {np.sqrt(square[trial.kind].mean()):.3f} px, {word}")


def _trial(kind: str, x: Array, y: Array, cov_x: Array, cov_y: Array) -> Trial:
    try:
        fit = fit_planar(kind, x, y, cov_x, cov_y)
    except DegenerateGeometry as error:
        return Trial(kind, None, str(error))
    area = np.linalg.det(fit.transform.jacobian(x))
    if area.min() < FOLD * np.median(np.abs(area)):
        return Trial(kind, None, f"{kind} folds or mirrors the picture at a marker")
    return Trial(kind, fit)
