"""The verb `identify`: deformation parameters, rigid motion and camera poses in one adjustment (section V)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.adjust import Loss, Problem, SolveOptions, SolveReport, covariance, minimise
from windmark.deformation.outliers import critical, scale_of, test_left_out, test_used
from windmark.deformation.result import Deformation, NotIdentified
from windmark.deformation.setup import Task, prepare, start_values
from windmark.deformation.sighting import LAW, MOTION, Sighting, camera_block, pose_block
from windmark.deformation.volumes import Volume, Volumes
from windmark.geometry import Camera, DegenerateGeometry
from windmark.scene import MarkerSet, Observations, View

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ROUGH = SolveOptions(max_iterations=30, gradient_tol=0.03, cost_tol=1e-4)
FINE = SolveOptions(max_iterations=40, gradient_tol=1e-2, cost_tol=1e-9, initial_damping=1e-8)
"""Near the minimum, where plain Gauss-Newton steps are best; a hundredth of a sigma is left."""
FAR_LOSS = Loss.make("cauchy", 4.0)
MOST_OUT = 0.4
"""More outliers than this part, and the answer is that nothing fits."""
PRIOR_SHARE = 0.7
"""A law parameter whose sigma is more than this part of its prior's is known from that prior alone."""


def identify(
    observations: Observations,
    markers: MarkerSet,
    laws: Sequence[Volume] | Volumes,
    cameras: Mapping[str, Camera] | Camera,
    views: Sequence[View],
    *,
    free_motion: bool = True,
    motion_cov: ArrayLike | None = None,
    free_poses: bool | Sequence[str] = False,
    pose_cov: Mapping[str, ArrayLike] | None = None,
    free_focal: bool | Sequence[str] = False,
    marker_cov: ArrayLike | None = None,
    start: Deformation | None = None,
    eccentricity: ArrayLike | None = None,
    reject: bool = True,
) -> Deformation | NotIdentified:
    """How a model moved and deformed, from one or more images of one instant.

    Parameters
    ----------
    observations : spots with their markers; ``view`` counts the views, ``point`` the markers. Spots are centres of
        imaged ellipses; where a marker's normal and radius are known the disc's eccentricity is taken off
    markers : undeformed, in the model's frame, with the volumes they belong to; those of role "wall" stand still
    laws : the model's volumes; markers of other volumes are rigid
    cameras : by name, or the one that all views have
    views : one for each image, ``cam_from_model`` is its pose ``cam_from_tunnel`` (at rest the two frames are one)
    free_motion : find a rigid motion of the whole model, too
    motion_cov : (6, 6) what is known of that motion: covariance about none, [rotation (rad), translation]
    free_poses : views whose cameras may have moved, True for all; markers on walls hold them
    pose_cov : view -> (6, 6) what is known of a free pose: covariance about that of the view
    free_focal : cameras whose focal length is free, True for all; with a variance in ``camera.cov`` it is held
    marker_cov : (N, 3, 3) covariance of the markers' own places; by default from their sigma, unknown counts as exact
    start : a state to begin at, that of the frame before; its markers bound to laws are used again
    eccentricity : (O, 2) the discs' eccentricity in pixels at the start, where it is known; None works it out
    reject : test every observation and leave gross errors out

    Returns
    -------
    Deformation
        or `NotIdentified`, falsy, where the images do not say: parameters that they do not determine are named.

    Raises
    ------
    ValueError
        For shapes, names or numbers that do not fit.
    """
    task = prepare(
        observations, markers, Volumes.of(laws), cameras, views, free_motion, motion_cov, free_poses, pose_cov,
        free_focal, marker_cov, None if start is None else start.placed,
    )  # fmt: skip
    options = {
        "free_motion": task.free_motion, "free_poses": task.free_poses, "free_focal": task.free_focal,
        "motion_cov": motion_cov is not None, "pose_cov": tuple(task.pose_cov), "reject": reject,
    }  # fmt: skip
    values = start_values(task, start)
    if (refusal := _unfit(task)) is not None:
        return replace(refusal, options=options)
    try:
        solved = _solve(task, values, _shift(task, values, eccentricity), reject, near=start is not None)
    except DegenerateGeometry as error:
        weak = ", ".join(error.weak)
        return NotIdentified(
            f"not determined: {weak}; {_advice(task, error.weak)}", "undetermined", error.weak, options
        )
    if isinstance(solved, NotIdentified):
        return replace(solved, options=options)
    return _result(task, solved, options)


class _Solved(NamedTuple):
    """An adjusted instant."""

    problem: Problem
    values: Mapping[str, Any]
    cov: Array
    report: SolveReport
    shift: Array
    used: Mask
    test: Array


def _unfit(task: Task) -> NotIdentified | None:
    """What no search can mend."""
    count = len(task.observations)
    if not count:
        return NotIdentified("there is no observation", "too_few")
    free = len(task.volumes.names) + 6 * task.free_motion + 6 * len(task.free_poses) + len(task.free_focal)
    known = sum(np.isfinite(p.sigma) for p in task.volumes.parameters)
    known += 6 * (task.motion_cov is not None) + 6 * len(task.pose_cov)
    if 2 * count + known < free:
        return NotIdentified(f"{count} observations cannot tell {free} unknowns", "too_few")
    if task.free_motion and task.motion_cov is None:
        moving = [v.name for v in task.views if v.name in task.free_poses and v.name not in task.pose_cov]
        if len(moving) == len(task.views) and not task.wall[task.observations.point].any():
            return NotIdentified(
                "cameras and model both move and no marker on a wall is seen: their motions cannot be told apart. Hold "
                "the poses, or the model's motion, or add wall markers", "undetermined", (MOTION, *moving),
            )  # fmt: skip
    return None


def _shift(task: Task, values: dict[str, Any], eccentricity: ArrayLike | None) -> Array:
    """(O, 2) eccentricity at the start, as given or worked out."""
    if eccentricity is None:
        return task.eccentricity(values)
    given, expected = np.asarray(eccentricity, dtype=float), (len(task.observations), 2)
    if given.shape != expected or not np.isfinite(given).all():
        raise ValueError(f"eccentricity: expected {expected}, finite, got {given.shape}")
    return given


def _solve(task: Task, values: dict[str, Any], shift: Array, reject: bool, near: bool) -> _Solved | NotIdentified:
    used = np.ones(len(task.observations), bool)
    readmitted = np.zeros(len(used), bool)
    problem = task.problem(values, shift, used, Loss())
    if _sighting(problem).raw_jacobian(values) is None:
        return NotIdentified("the start puts markers behind a camera or beyond its lens", "behind")
    if not near:
        values, _, _ = minimise(problem, values, ROUGH)
        problem, shift = _renewed(task, values, used)
    robust = False
    while True:
        values, system, report = minimise(problem, values, FINE)
        cov = covariance(system, _names(problem))
        test = test_used(task, _sighting(problem), values, cov, used)
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
        return NotIdentified(f"the search stopped before its minimum: {report.reason}", "no_convergence")
    return _Solved(problem, values, cov, report, shift, used, test)


def _renewed(task: Task, values: Any, used: Mask) -> tuple[Problem, Array]:
    """The adjustment, with eccentricity and whiteners at these values."""
    shift = task.eccentricity(values)
    return task.problem(values, shift, used, Loss()), shift


def _sighting(problem: Problem) -> Sighting:
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
        cov = covariance(system, _names(robust))
    except DegenerateGeometry:
        return values, used
    every = test_left_out(task, robust, values, cov, shift, used)
    keep = used & (every <= critical(len(every)) * scale_of(every))
    return values, keep if keep.mean() >= 1 - MOST_OUT else used


def _result(task: Task, s: _Solved, options: Mapping[str, Any]) -> Deformation:
    values, volumes = s.values, task.volumes
    term = _sighting(s.problem)
    if not s.used.all():  # those that did not take part, too
        term = replace(term, sights=task.sights(s.shift, np.ones(len(s.used), bool)), _last=[])
    raw = term.raw(values)
    assert raw is not None
    point, view = task.slots
    residuals = raw[point[:, None], 2 * view[:, None] + np.arange(2)]
    parts = [part for term in s.problem.terms if (part := term.residual(values)) is not None]
    chi2 = float(sum((part**2).sum() for part in parts))
    slices, q = s.problem.slices, values[LAW]
    weight = s.used / np.trace(task.observations.cov, axis1=1, axis2=2)
    sigma = np.sqrt(np.diag(s.cov)[slices[LAW]]) if LAW in slices else np.zeros(0)
    known = zip(volumes.names, volumes.parameters, sigma, strict=True)
    edge = zip(volumes.names, volumes.parameters, q, strict=True)
    at_bound = tuple(n for n, p, value in edge if value in (p.lower, p.upper))
    redundancy = 2 * int(s.used.sum()) + sum(part.size for part in parts[1:]) - s.problem.size + len(at_bound)
    return Deformation(
        volumes=volumes, placed=task.placed, q=q, tunnel_from_model=values[MOTION],
        cam_from_tunnel={v.name: values[pose_block(v.name)] for v in task.views},
        cameras={v.camera: values[camera_block(v.camera)] for v in task.views},
        names=_names(s.problem), cov=s.cov, slices=slices, residuals_px=residuals, used=s.used, test=s.test,
        rms_px=float(np.sqrt(weight @ (residuals**2).sum(axis=1) / weight.sum())),
        sigma0=float(np.sqrt(chi2 / redundancy)) if redundancy > 0 else float("nan"), chi2=chi2, redundancy=redundancy,
        from_prior=tuple(n for n, p, size in known if size > PRIOR_SHARE * p.sigma),
        at_bound=at_bound, report=s.report, options=options,
    )  # fmt: skip


def _names(problem: Problem) -> tuple[str, ...]:
    """Such as wing.tip for laws, motion.rotation_x, cam1.pose.rotation_x, cam1.camera.focal_px."""
    return tuple(n if key == LAW else f"{key}.{n}" for key, block in problem.blocks.items() for n in block.names)


def _advice(task: Task, weak: Sequence[str]) -> str:
    """The likely reason and what would help."""
    laws = [n for n in weak if n in task.volumes.names]
    moves = [n for n in weak if n.startswith(MOTION)]
    if laws:
        by_q = task.placed.linearise(task.volumes.start)[1][task.seen]
        still = [n for k, n in enumerate(task.volumes.names) if n in laws and not by_q[..., k].any()]
        if still:
            return f"no marker that is seen moves with {', '.join(still)}"
    if laws and task.free_motion and task.motion_cov is None:
        return "a law may repeat the rigid motion (then hold the motion), or the markers seen are too few for the law"
    if moves and len(task.views) == 1:
        return "one camera sees too little of the motion; add a camera, or hold the motion by what is known of it"
    return "the markers seen are too few, or too close to one line or plane, for all that is free"
