"""The search for one instant: least squares, gross errors left out, a robust solution first where they are many."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.adjust import Loss, Problem, SolveOptions, SolveReport, covariance, minimise
from windmark.deformation.ends import NO_PLACE, end_words
from windmark.deformation.outliers import critical, scale_of, test_left_out, test_used
from windmark.deformation.result import NotIdentified
from windmark.deformation.setup import Task
from windmark.deformation.sighting import LAW, Sighting
from windmark.geometry import DegenerateGeometry

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ROUGH = SolveOptions(max_iterations=30, gradient_tol=0.03, cost_tol=1e-4)
FINE = SolveOptions(max_iterations=40, gradient_tol=1e-2, cost_tol=1e-9, initial_damping=1e-8)
"""Near the minimum, where plain Gauss-Newton steps are best; a hundredth of a sigma is left."""
FAR_LOSS = Loss.make("cauchy", 4.0)
MOST_OUT = 0.4
"""More outliers than this part, and the answer is that nothing fits."""
NAMED = 5
"""Marks without an image that are named at most."""


@dataclass(frozen=True)
class Solved:
    """An adjusted instant.

    Parameters
    ----------
    task : what was given
    problem, values : the adjustment at its minimum
    cov : (F, F) of all that was free, from the stated covariances
    report : why the search stopped
    shift : (O, 2) the discs' eccentricity
    used : (O,) observations that took part
    test : (O,) test value of each observation
    """

    task: Task
    problem: Problem
    values: Mapping[str, Any]
    cov: Array
    report: SolveReport
    shift: Array
    used: Mask
    test: Array

    @property
    def sighting(self) -> Sighting:
        """The observations' term."""
        return sighting(self.problem)

    @cached_property
    def parts(self) -> list[Array]:
        """Whitened residuals: of the observations, then of what is known beforehand."""
        return [part for term in self.problem.terms if (part := term.residual(self.values)) is not None]

    @cached_property
    def jacobian(self) -> Array:
        """(R, F) of all whitened residuals by all that is free."""
        problem, rows = self.problem, list[Array]()
        for term in problem.terms:
            linearised = term.linearise(self.values)
            assert linearised is not None  # the engine never stands where the model has no prediction
            own = np.zeros((linearised.residual.size, problem.size))
            for name in term.blocks:
                own[:, problem.slices[name]] = linearised.jacobian[name].reshape(len(own), -1)
            rows.append(own)
        return np.concatenate(rows)

    @cached_property
    def chi2(self) -> float:
        """Sum of squared whitened residuals, priors included."""
        return float(sum((part**2).sum() for part in self.parts))

    @cached_property
    def at_bound(self) -> tuple[str, ...]:
        """Law parameters that ended at a bound."""
        volumes = self.task.volumes
        known = zip(volumes.names, volumes.parameters, self.values[LAW], strict=True)
        return tuple(n for n, p, value in known if value in (p.lower, p.upper))

    @cached_property
    def redundancy(self) -> int:
        """Expected value of `chi2`."""
        known = sum(part.size for part in self.parts[1:])
        return 2 * int(self.used.sum()) + known - self.problem.size + len(self.at_bound)


def solve(task: Task, values: dict[str, Any], shift: Array, reject: bool, near: bool) -> Solved | NotIdentified:
    """Adjust one instant.

    Parameters
    ----------
    task : what was given
    values, shift : where the search begins, and the discs' eccentricity (O, 2) there
    reject : test every observation and leave gross errors out
    near : the start is close to the minimum

    Raises
    ------
    DegenerateGeometry
        Naming what is not determined.
    """
    used = np.ones(len(task.observations), bool)
    readmitted = np.zeros(len(used), bool)
    task.placed.beyond.clear()
    problem = task.problem(values, shift, used, Loss())
    if sighting(problem).raw_jacobian(values) is None:
        if words := end_words(task.placed):
            return NotIdentified(f"{NO_PLACE}: {words}", "law")
        gone = task.without_image(values)
        more = f" and {len(gone) - NAMED} more" if len(gone) > NAMED else ""
        return NotIdentified(
            f"the start puts markers behind a camera or beyond its lens: {', '.join(gone[:NAMED])}{more} (wrong "
            "labels, or a start that is too far away)", "behind",
        )  # fmt: skip
    if not near:
        values, _, _ = minimise(problem, values, ROUGH)
        problem, shift = _renewed(task, values, used)
    robust = False
    while True:
        values, system, report = minimise(problem, values, FINE)
        names = free_names(problem)
        if lost := [n for n, told in zip(names, np.isfinite(np.diag(system.information)), strict=True) if not told]:
            words = end_words(task.placed)
            return NotIdentified(f"there are no numbers for a small change of {', '.join(lost)}: a law ends there"
                                 + (f" ({words})" if words else ""), "undetermined", tuple(lost))  # fmt: skip
        cov = covariance(system, names)
        test = test_used(task, sighting(problem), values, cov, used)
        if not reject:
            break
        limit = critical(int(used.sum())) * scale_of(test[used])
        if not robust and _many_gross(test, limit):
            robust = True
            values, used = _without_gross(task, values, shift, used)
            problem, shift = _renewed(task, values, used)
            continue
        worst = int(np.nanargmax(test))
        if test[worst] > limit:
            used = used.copy()
            used[worst] = False
            if used.mean() < 1 - MOST_OUT:
                return NotIdentified(f"{(~used).sum()} of {len(used)} observations contradict the others", "no_fit")
            problem, shift = _renewed(task, values, used)
            continue
        left = test_left_out(task, problem, values, cov, shift, ~used)
        test = np.where(used, test, left)
        back = ~used & (left < limit) & ~readmitted
        if not back.any():
            break
        used, readmitted = used | back, readmitted | back
        problem, shift = _renewed(task, values, used)
    if not report.converged:
        if words := end_words(task.placed):  # what fits best lies beyond
            return NotIdentified(f"{NO_PLACE}: {words}", "law")
        return NotIdentified(f"the search stopped before its minimum: {report.reason}", "no_convergence")
    return Solved(task, problem, values, cov, report, shift, used, test)


def _renewed(task: Task, values: Any, used: Mask) -> tuple[Problem, Array]:
    """The adjustment, with eccentricity and whiteners at these values."""
    shift = task.eccentricity(values)
    return task.problem(values, shift, used, Loss()), shift


def sighting(problem: Problem) -> Sighting:
    """The observations' term of an adjustment."""
    term = problem.terms[0]
    assert isinstance(term, Sighting)
    return term


def _many_gross(test: Array, limit: float) -> bool:
    """Whether there is more than a single test can be trusted with."""
    return bool(np.count_nonzero(test > limit) > 1 or scale_of(test) > 4)


def _without_gross(task: Task, values: Any, shift: Array, used: Mask) -> tuple[Any, Mask]:
    """Where single tests would see errors that pull everything, a robust solution comes first."""
    robust = task.problem(values, shift, used, FAR_LOSS)
    values, system, _ = minimise(robust, values, ROUGH)
    try:
        cov = covariance(system, free_names(robust))
    except DegenerateGeometry:
        return values, used
    every = test_left_out(task, robust, values, cov, shift, used)
    keep = used & (every <= critical(len(every)) * scale_of(every))
    return values, keep if keep.mean() >= 1 - MOST_OUT else used


def free_names(problem: Problem) -> tuple[str, ...]:
    """Such as wing.tip for laws, motion.rotation_x, cam1.pose.rotation_x, cam1.camera.focal_px."""
    return tuple(n if key == LAW else f"{key}.{n}" for key, block in problem.blocks.items() for n in block.names)
