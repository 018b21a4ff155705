"""The paper's own minimiser on a network, kept to compare with: AIAA 2005-5007, section IV.B and Fig. 7.

In each pass first the exterior parameters of all images, then the "global" ones (interior parameters and marker
coordinates) are moved one at a time, "only for a small iteration number, no more than three"; a parameter's step grows
while the RMS falls, and shrinks where it does not. A pose touches only the marks of its own images and a marker only
its own, so the same parameter of all poses (of all markers) is moved at once: the result is that of one after another.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.adjust.network._arrays import CHANGE
from windmark.adjust.network.problem import NetworkProblem, camera_columns
from windmark.adjust.network.state import NetworkState
from windmark.adjust.paper_engine import PaperOptions
from windmark.adjust.report import SolveReport
from windmark.errors import DataError

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class _Family:
    """Parameters (G,) that do not touch each other: their places in a step, and whose each mark is (O,), -1 for none.

    ``prior`` says what part of the prior knowledge they change: "points" and "change" their own, "all" any.
    """

    place: Ints
    owner: Ints
    prior: str


def minimise_network_by_steps(
    problem: NetworkProblem, start: NetworkState, options: PaperOptions | None = None
) -> tuple[NetworkState, SolveReport]:
    """Minimise the cost of a network one parameter at a time, without derivatives.

    Poses, interior parameters and markers trade against each other (focal length and distance, a turn of everything),
    and a walk along the axes is slow where a valley is not along one: expect thousands of passes where
    `levenberg_marquardt.minimise` takes five steps.

    Parameters
    ----------
    problem, start : the network and its values
    options : of the steps; ``step_tol`` in natural units

    Returns
    -------
    values : where the search ended, never worse than the start
    report : `SolveReport`; `iterations` are passes, `evaluations` those of the residuals of all marks

    Raises
    ------
    ValueError
        When a marker has no image at the start.
    """
    options = options or PaperOptions()
    families = list(_families(problem))
    walk = _Walk(problem, start)
    initial = walk.cost()
    steps = [np.full(len(f.place), options.initial_step) for f in families]
    passes, reason = 0, "max_iterations"
    while passes < options.max_passes:
        passes += 1
        for family, step in zip(families, steps, strict=True):
            for _ in range(options.tries):
                better = walk.tried(family, step)
                step *= np.where(better, options.grow, -options.shrink)
        if max((np.abs(s).max(initial=0.0) for s in steps), default=0.0) < options.step_tol:
            reason = "converged_step"
            break
    report = SolveReport(
        reason, reason.startswith("converged"), passes, walk.evaluations, initial, walk.cost(), asdict(options)
    )
    return walk.state, report


class _Walk:
    """Values on their way down, with the cost of each mark."""

    def __init__(self, problem: NetworkProblem, start: NetworkState) -> None:
        self.problem, self.state, self.evaluations = problem, start, 1
        rho = problem.losses(start)
        if rho is None:
            raise DataError("start: the model has no prediction there (a point behind the camera or beyond the lens)")
        self.rho = rho

    def cost(self) -> float:
        """Half the sum of the losses."""
        return 0.5 * float(self.rho.sum()) + self.problem.prior_cost(self.state)

    def tried(self, family: _Family, step: Array) -> NDArray[np.bool_]:
        """Move each parameter (G,) of a family by its step, and keep those moves that lower the cost."""
        none = np.zeros(len(step), dtype=np.bool_)
        delta = np.zeros(self.problem.size)
        delta[family.place] = step
        trial = self.problem.retract(self.state, delta)
        # A step that puts a marker behind a camera is none for the whole family: all try a smaller one.
        rho = None if trial is None else self.problem.losses(trial)
        self.evaluations += trial is not None
        if trial is None or rho is None:
            return none
        mine = family.owner >= 0
        gained = np.bincount(family.owner[mine], 0.5 * (rho - self.rho)[mine], minlength=len(step))
        change = gained + self._prior(family, trial) - self._prior(family, self.state)
        better = np.asarray(change < 0)
        if better.all():
            self.state, self.rho = trial, np.where(mine, rho, self.rho)
        elif better.any():
            delta[family.place[~better]] = 0.0
            kept = self.problem.retract(self.state, delta)
            assert kept is not None
            self.state = kept
            self.rho = np.where(mine & better[family.owner], rho, self.rho)
        return better

    def _prior(self, family: _Family, state: NetworkState) -> Array | float:
        """(G,) what prior knowledge costs each parameter of a family."""
        network = self.problem.network
        if family.prior == "all":
            return self.problem.prior_cost(state)
        if family.prior == "change":
            if network.change_sigma is None or state.change is None:
                return 0.0
            columns = self.problem.layout.columns.change
            k = np.flatnonzero((columns == family.place[0]).any(axis=0))[0]
            free = columns[:, k] >= 0
            return np.asarray(0.5 * (state.change[free, k] / network.change_sigma[free, k]) ** 2)
        if family.prior == "points" and network.point_sigma is not None and network.point_value is not None:
            known = np.isfinite(network.point_sigma) & ~network.held
            off = np.where(known, state.points - np.where(known, network.point_value, 0.0), 0.0) / network.point_sigma
            return np.asarray(0.5 * (off**2).sum(axis=1)[_moving(self.problem, tied=False)])
        return 0.0


def _families(problem: NetworkProblem) -> Iterator[_Family]:
    """Poses, changes of single views and rig first (the exterior parameters), then interior parameters and markers."""
    network, lay, marks = problem.network, problem.layout, problem.marks
    columns = lay.columns
    frame = _places(columns.frame, columns.frame_block, lay.dense, 6)
    free = np.flatnonzero(frame >= 0)
    owner = _numbered(free, len(frame))[network.view_frame[marks.views]]
    for k in range(6):
        yield _Family(frame[free] + k, owner, "none")
    for k in range(CHANGE):
        free = np.flatnonzero(columns.change[:, k] >= 0)
        if len(free):
            yield _Family(columns.change[free, k], _numbered(free, len(columns.change))[marks.views], "change")
    for a in np.flatnonzero(columns.offset >= 0):
        owner = np.where(network.view_offset[marks.views] == a, 0, -1)
        for k in range(6):
            yield _Family(columns.offset[[a]] + k, owner, "none")
    for c, _, column in camera_columns(lay):
        yield _Family(np.array([column]), np.where(network.view_camera[marks.views] == c, 0, -1), "all")
    point = _places(columns.point, columns.point_block, lay.dense, 3)
    free = np.flatnonzero(_moving(problem, tied=False))
    owner = _numbered(free, len(point))[marks.points]
    for k in range(3):
        yield _Family(point[free] + k, owner, "points")
    for n in np.flatnonzero(_moving(problem, tied=True)):
        for k in range(3):
            yield _Family(point[[n]] + k, np.where(marks.points == n, 0, -1), "all")


def _moving(problem: NetworkProblem, *, tied: bool) -> NDArray[np.bool_]:
    """(N,) free points that prior knowledge ties to others, or those that none does."""
    columns = problem.layout.columns
    return np.asarray(((columns.point >= 0) | (columns.point_block >= 0)) & (problem.network.tied == tied))


def _places(column: Ints, block: Ints, dense: int, size: int) -> Ints:
    """First place of each group in a step, -1 for fixed ones."""
    return np.where(column >= 0, column, np.where(block >= 0, dense + size * block, -1))


def _numbered(chosen: Ints, count: int) -> Ints:
    """(count,) position within the chosen ones, else -1."""
    out = np.full(count, -1)
    out[chosen] = np.arange(len(chosen))
    return out
