"""Which kind of transformation pairs of marks support: judged on marks that the fit has not seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.geometry.errors import DegenerateGeometry
from windmark.geometry.planar.fit import PlanarFit, fit_planar
from windmark.geometry.planar.hull import hull_of
from windmark.geometry.planar.transform import KINDS

Array = NDArray[np.float64]

FOLD = 0.05
"""Area of a mark's surroundings, as part of the median one, below which a transformation folds there."""

ERRORS, PART, NOTHING_PX = 2.0, 0.2, 1e-3
"""Standard errors, part of the mean, and pixels within which held-out residuals count as alike."""
INNER = 5
"""So many markers inside the hull of the others judge alone; else all do."""


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

    No worse: the mean difference of the squared held-out residuals, mark by mark, is within two standard errors, and
    within a fifth of the best one's mean: a few marks that differ much are no licence. The same marks judge all kinds:
    those inside the hull of the others, for without a corner of the hull the fit extrapolates to it, and what is wanted
    lies between the marks.

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
    judges = _inner(x)
    square = {t.kind: (t.fit.held_out[judges] ** 2).sum(axis=1) for t in fits if t.fit is not None}
    best = min(fits, key=lambda t: float(square[t.kind].mean()))
    for trial in fits:
        worse = square[trial.kind] - square[best.kind]
        chance = ERRORS * worse.std() / np.sqrt(len(worse))
        if worse.mean() <= max(min(chance, PART * square[best.kind].mean()), NOTHING_PX**2):
            break
    word = "least" if trial is best else f"no more than chance above the least, of {best.kind}"
    among = f"of the {judges.sum()} markers inside the others' hull, " if not judges.all() else ""
    rms = np.sqrt(square[trial.kind].mean())
    return Choice(trials, trial, f"{trial.kind}: held-out residual {rms:.3f} px, {among}{word}")


def _inner(x: Array) -> NDArray[np.bool_]:
    """Marks that are no corner of the hull; all where these are few."""
    inner = ~(x[:, None] == hull_of(x)[None]).all(axis=2).any(axis=1)
    return inner if inner.sum() >= INNER else np.ones(len(x), dtype=bool)


def _trial(kind: str, x: Array, y: Array, cov_x: Array, cov_y: Array) -> Trial:
    try:
        fit = fit_planar(kind, x, y, cov_x, cov_y)
    except DegenerateGeometry as error:
        return Trial(kind, None, str(error))
    area = np.linalg.det(fit.transform.jacobian(x))
    if area.min() < FOLD * np.median(np.abs(area)):
        return Trial(kind, None, f"{kind} folds or mirrors the picture at a marker")
    return Trial(kind, fit)
