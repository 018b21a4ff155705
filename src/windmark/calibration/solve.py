"""From a rough start to the minimum, gross errors found on the way.

0. Least squares of all marks: where these fit as their covariances say and every one passes its test, that is it.
1. Graduated Cauchy weights: the scale follows the median residual down, so neither a rough start nor a third of wrong
   marks leads astray.
2. Least squares of the marks that fit, each tested (`snooping`); marks come and go until nothing changes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from windmark.adjust import PaperOptions, SolveReport
from windmark.adjust.levenberg_marquardt import SolveOptions, minimise
from windmark.adjust.network import Network, NetworkProblem, NetworkState, graduated, minimise_network_by_steps
from windmark.adjust.network.covariance import NetworkCovariance, covariance_and_cross
from windmark.adjust.network.equations import NetworkEquations
from windmark.calibration.disc_shapes import Discs
from windmark.calibration.setup import LEAST_MARKS, Job, frames_of, make_network, taking_part, views_of
from windmark.calibration.snooping import critical, externally, influence, statistic
from windmark.calibration.start import start_poses
from windmark.geometry import DegenerateGeometry, Pose

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

STAGES = 15
"""Robust stages at most."""
STAGE = SolveOptions(max_iterations=8, gradient_tol=1e-2, initial_damping=1e-4)
SETTLED = 0.95
"""A stage that lowers the median residual by less than this factor is the last one."""
ROUNDS = 12
"""Rounds of leaving out and taking back."""
RESCUES, MOST_LEFT, RESCUE_PX = 2, 0.6, 5.0
"""Times that views with at most this share of marks left are given a new pose; it must explain them within so much."""
FINAL = SolveOptions(max_iterations=200, gradient_tol=1e-4, initial_damping=1e-5)
PLAIN = SolveOptions(max_iterations=8, gradient_tol=1e-4, initial_damping=1e-5)
"""Of all marks without a robust stage: from a usual start it is there in four or five steps, or something is wrong."""
PLAIN_FITS = 1e-3
"""Probability of a sum of squares as large, or as small, above which all marks fit as their covariances say. Residuals
that are smaller than stated may hide gross errors among them, so they are no sign of it either."""
UNSEEN = "the marker is behind the camera, or beyond its lens: a wrong label, or it moved"
STEPS = PaperOptions(max_passes=3000)
NEAR = 0.1
"""Distance of the minimum, in units of the estimate's sigma, within which the paper's steps are said to be there."""


@dataclass(frozen=True)
class Solved:
    """An adjusted network with the test of every mark that took part.

    ``taken`` (O,) are the marks of the job in the problem's network, ``used`` of those (K,) not left out; ``discs``
    what their ellipses tell of the markers, in the frame of ``state``.
    """

    problem: NetworkProblem
    state: NetworkState
    covariance: NetworkCovariance
    report: SolveReport
    taken: Mask
    used: Mask
    residual: Array
    test: Array
    sigma0: float
    redundancy: int
    dropped: dict[str, str]
    discs: Discs | None = None

    @property
    def scale(self) -> float:
        """Factor on all covariances: sigma0 squared, but never below 1.

        What the marks' covariances say is a lower bound: a sigma0 below it comes from few residuals, or from gross
        errors that took their scatter with them.
        """
        return max(self.sigma0, 1.0) ** 2


def solve(job: Job, start: NetworkState, allowed: Mask, shift: Array, reject: bool, fits: Mask | None = None) -> Solved:
    """Adjust the ``allowed`` (O,) marks of a job from a start; ``shift`` (O, 2) is the eccentricity of each.

    With ``reject`` gross errors are left out. ``fits`` (O,) are the marks that do as far as is known, where the start
    is near the minimum; without, robust stages find both.

    Raises
    ------
    DegenerateGeometry
        When something is not determined at all.
    ValueError
        When the start has no image of a marker.
    """
    good, state = allowed.copy(), start
    if fits is None:
        plain = _plain(job, start, allowed, shift) if job.solver == "newton" else None
        if plain is not None:
            return plain
        # Of a wrong label the marker may be behind the camera: that mark says nothing, and the others go on without it.
        good = _imaged(job, start, good)
        taken, _ = taking_part(job, good)
        if not taken.any():
            raise DegenerateGeometry("no view has four marks whose markers are in front of the camera where it starts")
        state, good[taken] = _robust(job, start, taken, shift)
    else:
        good &= fits
    if not reject:
        taken, dropped = taking_part(job, allowed)
        return _adjusted(job, state, taken, np.zeros_like(taken), allowed, shift, dropped)
    solved, good = _tested(job, state, allowed, good, shift)
    for _ in range(RESCUES):
        state, again = _rescued(job, solved, allowed, good)
        if again is None:
            break
        solved, good = _tested(job, state, allowed, again, shift)
    return _restored(job, solved, allowed, good, shift)


def _restored(job: Job, solved: Solved, allowed: Mask, good: Mask, shift: Array) -> Solved:
    """With the markers back that vanished, where more marks fit then.

    A marker with one mark left takes no part, and what takes no part is not tested: it could not come back by itself.
    """
    obs = job.observations
    there, could = (np.isin(np.arange(len(job.markers)), obs.point[m]) for m in (
        solved.taken, taking_part(job, allowed)[0]
    ))  # fmt: skip
    back = allowed & (could & ~there)[obs.point]
    if not back.any() or not solved.report.converged:
        return solved
    try:
        other, fits = _tested(job, solved.state, allowed, good | back, shift)
    except (DegenerateGeometry, ValueError):
        return solved
    return other if other.report.converged and fits.sum() > good.sum() else solved


def _plain(job: Job, start: NetworkState, allowed: Mask, shift: Array) -> Solved | None:
    """The adjustment of all marks at once; None where they do not all fit, or it is far from the start."""
    taken, dropped = taking_part(job, allowed)
    if not taken.any():
        return None
    problem = NetworkProblem(make_network(job, taken), start, shift[taken])
    if problem.residual(start) is None:
        return None  # the robust stages say why
    state, system, report = minimise(problem, start, PLAIN)
    redundancy = _redundancy(problem, int(taken.sum()), system.gauge.dense.shape[1])
    squares = 2 * report.final_cost
    if not report.converged or redundancy <= 0 or not PLAIN_FITS < chdtrc(redundancy, squares) < 1 - PLAIN_FITS:
        return None
    covariance, cross = covariance_and_cross(system, problem.layout)
    del system  # as large as the covariance, and the tests need room
    solved = _with_tests(problem, state, covariance, cross, report, taken, allowed, dropped)
    return solved if (solved.test <= critical(len(solved.test))).all() else None


def _tested(job: Job, state: NetworkState, allowed: Mask, good: Mask, shift: Array) -> tuple[Solved, Mask]:
    """Least squares, and marks left out and taken back, until nothing changes."""
    seen: set[bytes] = set()
    while True:
        taken, dropped = taking_part(job, good)
        if not taken.any():
            raise DegenerateGeometry("no view keeps four marks that fit one solution")
        left_out, unseen = _predictable(job, state, taken, allowed & ~good)
        solved = _adjusted(job, state, taken, left_out, good, shift, dropped | unseen)
        state = solved.state
        if not solved.report.converged:
            return solved, good  # the tests of marks mean nothing there
        fits = good.copy()
        fits[solved.taken] = solved.test <= critical(int(solved.taken.sum()))
        fits = _one_by_one(job, good, fits, solved)
        if (fits == good).all() or fits.tobytes() in seen or len(seen) == ROUNDS - 1:
            return solved, good
        seen.add(fits.tobytes())
        good = fits
        del solved  # its covariances are the largest arrays there are


def _rescued(job: Job, solved: Solved, allowed: Mask, good: Mask) -> tuple[NetworkState, Mask | None]:
    """Views that lost most of their marks get a new pose from the markers as they are now known.

    The first poses come from rough coordinates; a wrong one makes all marks of its view look like gross errors.
    None where no view can be helped.
    """
    obs, state, out = job.observations, solved.state, good.copy()
    kept, every = (np.bincount(obs.view[m], minlength=len(job.views)) for m in (allowed & good, allowed))
    if state.offsets is not None or not (kept < every).any():
        return state, None
    known = np.zeros(len(job.markers), dtype=np.bool_)
    known[obs.point[solved.taken]] = True
    usable = allowed & known[obs.point]
    frames, helped = frames_of(job)[1], False
    rotation, translation = state.frames.rotation.copy(), state.frames.translation.copy()
    for v, (camera, _) in enumerate(views_of(job, state)):
        mine = np.flatnonzero(usable & (obs.view == v))
        if len(mine) < LEAST_MARKS or good[mine].mean() > MOST_LEFT:
            continue
        marks = [(obs.xy[mine], state.points[obs.point[mine]])]
        _, poses, _ = start_poses(camera, marks, scan_focal=False, rng=np.random.default_rng(v))
        if poses[0] is None:
            continue
        seen, valid = camera.project(poses[0].apply(marks[0][1]))
        near = valid & (np.linalg.norm(seen - marks[0][0], axis=1) < RESCUE_PX)
        if near.mean() > max(good[mine].mean(), 0.5):
            out[mine], helped = near, True
            rotation[frames[v]], translation[frames[v]] = poses[0].rotation, poses[0].translation
    return replace(state, frames=Pose(rotation, translation)), out if helped else None


def _robust(job: Job, state: NetworkState, taken: Mask, shift: Array) -> tuple[NetworkState, Mask]:
    """Values that a third of wrong marks does not pull, and which of the marks fit them."""
    problem, state, scale = graduated(
        make_network(job, taken), state, STAGE, stages=STAGES, settled=SETTLED, shift=shift[taken]
    )
    residual = problem.residual(state)
    assert residual is not None
    fits = np.empty(len(residual), dtype=np.bool_)
    fits[problem.order] = (residual**2).sum(axis=1) < critical(len(residual)) * scale**2
    return state, fits


def _adjusted(
    job: Job, state: NetworkState, taken: Mask, left_out: Mask, good: Mask, shift: Array, dropped: dict[str, str]
) -> Solved:
    """Least squares of the good marks among those that take part; all of them are tested.

    Marks that were left out stay in the network with no weight, so that their test is a prediction.
    """
    every = taken | left_out
    network = make_network(job, every, good.astype(float))
    problem = NetworkProblem(network, state, shift[every])
    state, system, report = _minimum(job, problem, state)
    covariance, cross = covariance_and_cross(system, problem.layout)
    del system  # as in `_plain`
    return _with_tests(problem, state, covariance, cross, report, every, good, dropped)


def _with_tests(
    problem: NetworkProblem, state: NetworkState, covariance: NetworkCovariance, cross: Array, report: SolveReport,
    every: Mask, good: Mask, dropped: dict[str, str],
) -> Solved:  # fmt: skip
    """The test of ``every`` mark at a minimum, of which the ``good`` ones were adjusted; ``cross`` see `influence`."""
    used = good[every][problem.order]
    redundancy = _redundancy(problem, int(used.sum()), covariance.motions.shape[1])
    residual = problem.residual(state)
    assert residual is not None
    squares = 2 * report.final_cost
    sigma0 = float(np.sqrt(squares / redundancy)) if redundancy > 0 else float("nan")
    test = statistic(residual, influence(problem, state, covariance, cross), used)
    test = externally(test, used, squares, redundancy)
    back = np.argsort(problem.order)
    return Solved(
        problem, state, covariance, report, every, used[back], residual[back], test[back], sigma0, redundancy, dropped
    )


def _redundancy(problem: NetworkProblem, used: int, motions: int) -> int:
    """Degrees of freedom of an adjustment of so many marks, with so many motions that nothing sees."""
    lay = problem.layout
    unknowns = lay.dense + lay.blocks * lay.size
    return 2 * used + _known(problem.network) + motions - unknowns


def _known(network: Network) -> int:
    """What is known besides the pictures and has a residual: coordinates of markers in use, distances, parameters."""
    points = 0
    if network.point_sigma is not None:
        points = int(np.isfinite(network.point_sigma[network.used_point & ~network.held.all(axis=1)]).sum())
    if network.together is not None:
        points += network.together.value.size
    changes = 0
    if network.change_sigma is not None and network.free_change is not None:
        used = network.used_view[:, None]
        changes = int((network.free_change & used & np.isfinite(network.change_sigma)).sum())
    return points + changes + len(network.bars.length) + sum(len(sigma) for sigma in network.camera_sigma)


def _minimum(
    job: Job, problem: NetworkProblem, state: NetworkState
) -> tuple[NetworkState, NetworkEquations, SolveReport]:
    """Least squares by the job's solver."""
    if job.solver == "newton":
        return minimise(problem, state, FINAL)
    state, report = minimise_network_by_steps(problem, state, STEPS)
    system = problem.linearise(state)
    assert system is not None
    # Steps along the axes also end in a narrow valley that leads on: Newton's step says how far the minimum is.
    newton = system.solve(0.0)
    there = newton is not None and 2 * newton.decrease <= NEAR**2
    reason = "converged_step" if there else "stalled" if report.converged else report.reason
    return state, system, replace(report, reason=reason, converged=there)


def _predictable(job: Job, state: NetworkState, taken: Mask, out: Mask) -> tuple[Mask, dict[str, str]]:
    """Marks that are ``out`` of views and markers that take part; those that have no image there, with the reason."""
    obs = job.observations
    view, point = np.zeros(len(job.views), dtype=np.bool_), job.held.copy()
    view[obs.view[taken]], point[obs.point[taken]] = True, True
    out = out & view[obs.view] & point[obs.point]
    seen = _imaged(job, state, out)
    pairs = zip(obs.point[out & ~seen].tolist(), obs.view[out & ~seen].tolist(), strict=True)
    return seen, {f"{job.markers.name[p]} in {job.views[v].name}": UNSEEN for p, v in pairs}


def _imaged(job: Job, state: NetworkState, asked: Mask) -> Mask:
    """(O,) marks among those asked for whose marker has an image in their view: before the camera, within its lens."""
    obs, out = job.observations, np.zeros(len(job.observations), dtype=np.bool_)
    at = views_of(job, state) if asked.any() else []
    for v in np.unique(obs.view[asked]).tolist():
        camera, pose = at[v]
        mine = asked & (obs.view == v)
        out[mine] = camera.project(pose.apply(state.points[obs.point[mine]]))[1]
    return out


def _one_by_one(job: Job, good: Mask, fits: Mask, solved: Solved) -> Mask:
    """Of the marks that newly fail, only those that are the worst of their view or of their marker are left out now.

    A gross error pulls its neighbours; they may fit once it is gone.
    """
    fails = np.flatnonzero(good & ~fits)
    if not len(fails):
        return fits
    test = np.zeros(len(good))
    test[solved.taken] = solved.test
    obs = job.observations
    worst_view, worst_point = np.zeros(len(job.views)), np.zeros(len(job.markers))
    np.maximum.at(worst_view, obs.view[fails], test[fails])
    np.maximum.at(worst_point, obs.point[fails], test[fails])
    now = (test[fails] >= worst_view[obs.view[fails]]) | (test[fails] >= worst_point[obs.point[fails]])
    out = fits.copy()
    out[fails[~now]] = True
    return out
