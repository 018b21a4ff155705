"""The paper's own minimiser, kept to compare with.

AIAA 2005-5007, section IV.B: the RMS is minimised for each parameter in turn, "only for a small iteration
number, no more than three. The parameter step is increased if the RMS keeps decreasing and it is decreased
when the RMS does not." It needs no derivative, and it works on the same `Problem` as the real engine. The
parameters are taken in natural units (a turn about the points' centroid, a shift in parts of the distance),
which are near to the paper's PoV: a turn about the model's origin, then three distances.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from windmark.adjust.problem import Problem
from windmark.adjust.report import SolveReport
from windmark.errors import DataError


@dataclass(frozen=True)
class PaperOptions:
    """Settings of the growing and shrinking steps.

    Parameters
    ----------
    tries : evaluations per parameter and pass (the paper's "no more than three")
    initial_step : of every parameter, in natural units
    grow, shrink : factors on the step after a success and after a failure (which also turns it round)
    step_tol : the search has converged when every step is smaller than this, in natural units
    max_passes : over all parameters
    """

    tries: int = 3
    initial_step: float = 1e-2
    grow: float = 2.0
    shrink: float = 0.5
    step_tol: float = 1e-9
    max_passes: int = 20_000

    def __post_init__(self) -> None:
        if self.tries < 1 or self.max_passes < 1:
            raise ValueError(f"tries and max_passes: expected at least 1, got {self.tries} and {self.max_passes}")
        if not (self.grow > 1 > self.shrink > 0):
            raise ValueError(f"grow, shrink: expected grow > 1 > shrink > 0, got {self.grow} and {self.shrink}")


def minimise_by_steps(
    problem: Problem, start: Any, options: PaperOptions | None = None
) -> tuple[dict[str, Any], SolveReport]:
    """Minimise a problem one parameter at a time.

    The half sum of squares takes the place of the RMS: one falls exactly when the other does. A point where the
    model has no prediction counts as infinitely bad.

    Returns
    -------
    values : where the search ended
    report : `SolveReport`; `evaluations` is what to compare between engines, `iterations` are passes
    """
    options = options or PaperOptions()
    values = dict(start)
    cost = initial_cost = problem.cost(values)
    if not np.isfinite(cost):
        raise DataError("start: the model has no prediction there (a point behind the camera or beyond the lens)")
    steps = np.full(problem.size, options.initial_step)
    evaluations, passes, reason = 1, 0, "max_iterations"
    while passes < options.max_passes:
        passes += 1
        for k in range(problem.size):
            for _ in range(options.tries):
                trial = problem.retract(values, problem.natural(values)[:, k] * steps[k])
                trial_cost = float("inf") if trial is None else problem.cost(trial)
                evaluations += trial is not None
                if trial is not None and trial_cost < cost:
                    values, cost = trial, trial_cost
                    steps[k] *= options.grow
                else:
                    steps[k] *= -options.shrink
        if np.abs(steps).max(initial=0.0) < options.step_tol:
            reason = "converged_step"
            break
    report = SolveReport(
        reason=reason,
        converged=reason.startswith("converged"),
        iterations=passes,
        evaluations=evaluations,
        initial_cost=initial_cost,
        final_cost=cost,
        options=asdict(options),
    )
    return values, report
