"""The one solver: Levenberg-Marquardt on anything that can be linearised and retracted.

The driver does not know what the parameters mean, nor how the linear system is solved.
Damping: Marquardt (1963) scaling, updated by the gain ratio as in Nielsen (1999, IMM-REP-1999-05),
but let to fall by 10 instead of 3 per good step so that the end of the search is Newton-like.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from windmark.adjust.problem import Step
from windmark.adjust.report import SolveReport
from windmark.errors import DataError

Array = NDArray[np.float64]

_MAX_DAMPING = 1e12
_DOUBT = 100.0
"""A damped step so many times the smallest one may stand for an undamped one that is smaller still."""
_LITTLE, _SMALL = 3e-8, 1e-4
"""With so little damping the undamped step is taken, if it is no longer than this in natural units ..."""


class System(Protocol):
    """Quadratic model of the cost about one point."""

    cost: float

    def solve(self, damping: float) -> Step | None:
        """Damped step, or None where the damped matrix is not positive definite."""

    def decrement(self, other: Any) -> float:
        """Newton's decrement sqrt(g^T H^-1 g) with the gradient of another system near by and this one's matrix.

        Asked for after `solve` without damping; inf where that failed.
        """


class Solvable(Protocol):
    """What the driver asks of a problem."""

    def linearise(self, values: Any) -> Any:
        """The `System` at ``values``, or None where the model has no prediction."""

    def retract(self, values: Any, delta: Array) -> Any:
        """The values after a step, or None where there are none."""


@dataclass(frozen=True)
class SolveOptions:
    """When to stop.

    Parameters
    ----------
    max_iterations : steps tried, accepted or not
    gradient_tol : Newton decrement sqrt(g^T H^-1 g): distance of the minimum in units of the estimate's sigma
    step_tol : largest component of the Newton step in natural units (rounding level)
    cost_tol : predicted decrease relative to the cost
    initial_damping : relative to the diagonal of the normal matrix
    """

    max_iterations: int = 50
    gradient_tol: float = 1e-6
    step_tol: float = 1e-14
    cost_tol: float = 1e-11
    initial_damping: float = 1e-3

    def __post_init__(self) -> None:
        if self.max_iterations < 1:
            raise ValueError(f"max_iterations: expected at least 1, got {self.max_iterations}")


def minimise(problem: Solvable, start: Any, options: SolveOptions | None = None) -> tuple[Any, Any, SolveReport]:
    """Minimise the cost of a problem from a start.

    Returns
    -------
    values : where the search ended, never worse than the start
    system : the normal equations there
    report : `SolveReport`

    Raises
    ------
    ValueError
        When the model has no prediction at the start.
    """
    options = options or SolveOptions()
    values, system = start, problem.linearise(start)
    if system is None:
        raise DataError("start: the model has no prediction there (a point behind the camera or beyond the lens)")
    initial_cost = system.cost
    damping, growth = options.initial_damping, 2.0
    reason, iteration, evaluations = "max_iterations", 0, 1
    while iteration < options.max_iterations:
        step, undamped = _step(system, damping)
        if at_minimum := _at_minimum(system, step, undamped, options):
            reason = at_minimum
            break
        iteration += 1
        trial_values = None if step is None else problem.retract(values, step.delta)
        trial = None if trial_values is None else problem.linearise(trial_values)
        evaluations += trial_values is not None
        # Neither the promised nor the reached decrease can be seen: this is the floor of the cost.
        at_floor = step is not None and damping <= 1 and step.decrease <= options.cost_tol * system.cost
        gain = -1.0 if step is None or trial is None else (system.cost - trial.cost) / max(step.decrease, 1e-300)
        if gain > 0:
            before, values, system = system, trial_values, trial
            # ... and then the matrix is the same at its end, so no other is needed to see that it is the minimum.
            if undamped and before.decrement(system) <= options.gradient_tol:
                reason = "converged_gradient"
                break
            del before
            damping *= max(0.1, 1 - (2 * gain - 1) ** 3)
            growth = 2.0
        else:
            damping *= growth
            growth *= 2.0
        if at_floor:
            reason = "converged_cost"
            break
        if damping > _MAX_DAMPING:
            reason = "stalled"
            break
    report = SolveReport(
        reason=reason,
        converged=reason.startswith("converged"),
        iterations=iteration,
        evaluations=evaluations,
        initial_cost=initial_cost,
        final_cost=system.cost,
        options=asdict(options),
    )
    return values, system, report


def _step(system: System, damping: float) -> tuple[Step | None, bool]:
    """The step, and whether it is undamped."""
    if damping <= _LITTLE:
        newton = system.solve(0.0)
        if newton is not None and newton.size <= _SMALL:
            return newton, True
    return system.solve(damping), False


def _at_minimum(system: System, step: Step | None, undamped: bool, options: SolveOptions) -> str:
    """The reason to stop here, or an empty text.

    Judged on the undamped step: damping hides weak directions. It promises at least the decrease of the damped one,
    so it is asked for only where that is small.
    """
    if step is not None and _decrement(step) > options.gradient_tol and step.size > _DOUBT * options.step_tol:
        return ""
    newton = step if undamped else system.solve(0.0)
    if newton is None:
        return ""
    if _decrement(newton) <= options.gradient_tol:
        return "converged_gradient"
    return "converged_step" if newton.size <= options.step_tol else ""


def _decrement(step: Step) -> float:
    """Newton's decrement: the distance of the minimum in units of the estimate's sigma."""
    return float(np.sqrt(max(2 * step.decrease, 0.0)))
