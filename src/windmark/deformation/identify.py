"""The verb `identify`: deformation parameters, rigid motion and camera poses in one adjustment (section V)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.deformation.disc_size import likelier_discs, other_discs
from windmark.deformation.discs import OtherDiscs, sigmas_of
from windmark.deformation.judge import Verdict, judge
from windmark.deformation.lost import residuals_of_all
from windmark.deformation.result import Deformation, NotIdentified
from windmark.deformation.setup import Task, prepare, start_values
from windmark.deformation.sighting import LAW, MOTION, camera_block, pose_block
from windmark.deformation.solve import Solved, free_names, solve
from windmark.deformation.twin import best_of_twins
from windmark.deformation.volumes import Volume, Volumes
from windmark.geometry import Camera, DegenerateGeometry
from windmark.scene import MarkerSet, Observations, View
from windmark.scene.shown import by_name, check_kinds, list_of
from windmark.scene.units import CommonRatio

Array = NDArray[np.float64]

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
    free_moved: bool = True,
    disc_size: CommonRatio | None = None,
    keep: Callable[[Solved], None] | None = None,
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
    free_moved : a camera taken as fixed that moved is named, and its pose found; False takes all of them as they are
    disc_size : how many times as large as the table's radii the discs are imaged, see
        `windmark.deformation.disc_size`; None takes these as they are
    keep : is given the adjusted instant before it is judged, for what a series of them says together

    Returns
    -------
    Deformation
        or `NotIdentified`, falsy, where the images do not say: parameters that they do not determine are named.

    Raises
    ------
    ValueError
        For shapes, names or numbers that do not fit.

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> @wm.law(tip={"unit": "mm", "sigma": 20.0})
    ... def bend(xyz, tip):
    ...     return xyz + np.outer((xyz[:, 1] / 400.0) ** 2, [0.0, 0.0, tip])
    >>> x, y = (v.ravel() for v in np.meshgrid([0.0, 40.0, 80.0], np.linspace(50.0, 400.0, 8)))
    >>> markers = wm.MarkerSet.make([f"m{i}" for i in range(24)], np.c_[x, y, 0 * x], volume="wing")
    >>> camera, pose = wm.Camera((640, 480), 800.0), wm.Pose.look_at([300, 200, 700], [40, 200, 0], [0, 1, 0])
    >>> xy, _ = camera.project(pose.apply(bend.function(markers.xyz, 8.0)))  # the wing's tip rises by 8 mm
    >>> seen = wm.Observations(np.zeros(24, dtype=int), np.arange(24), xy, np.tile(0.01 * np.eye(2), (24, 1, 1)))
    >>> wing, view = wm.Volume("wing", bend), wm.View("cam1", cam_from_model=pose)
    >>> state = wm.identify(seen, markers, [wing], camera, [view], free_motion=False)
    >>> round(state.parameters["wing.tip"], 2), round(state.sigma["wing.tip"], 2)
    (8.0, 0.09)
    """
    check_kinds(
        "identify", observations=(observations, Observations), markers=(markers, MarkerSet),
        cameras=(cameras, by_name(Camera)), views=(views, list_of(View)),
    )  # fmt: skip
    task = prepare(
        observations, markers, Volumes.of(laws), cameras, views, free_motion, motion_cov, free_poses, pose_cov,
        free_focal, marker_cov, None if start is None else start.placed,
    )  # fmt: skip
    options = {
        "free_motion": task.free_motion, "free_poses": task.free_poses, "free_focal": task.free_focal,
        "motion_cov": motion_cov is not None, "pose_cov": tuple(task.pose_cov), "reject": reject,
        "free_moved": free_moved,
    }  # fmt: skip
    values = start_values(task, start)
    if (refusal := _unfit(task)) is not None:
        return replace(refusal, options=options)
    try:
        solved = solve(task, values, _shift(task, values, eccentricity), reject, near=start is not None)
    except DegenerateGeometry as error:
        weak = ", ".join(error.weak)
        return NotIdentified(
            f"not determined: {weak}; {_advice(task, error.weak)}", "undetermined", error.weak, options
        )
    if isinstance(solved, NotIdentified):
        return replace(solved, options=options)
    solved, twofold = best_of_twins(solved, reject)
    solved = likelier_discs(solved, disc_size, reject)
    if keep is not None:
        keep(solved)
    judged = judge(solved, free_moved)
    if isinstance(judged, NotIdentified):
        return replace(judged, options=options)
    found, verdict = judged
    state = _result(found, replace(verdict, doubts=(*verdict.doubts, *twofold)), options)
    return _with_discs(state, other_discs(found, disc_size), markers.length_unit)


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
                "cameras and model both move and no marker on a wall is found: their motions cannot be told apart. "
                "Hold the poses, or the model's motion, or add wall markers", "undetermined", (MOTION, *moving),
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


def _result(s: Solved, verdict: Verdict, options: Mapping[str, Any]) -> Deformation:
    task, values, volumes = s.task, s.values, s.task.volumes
    raw = residuals_of_all(s)
    point, view = task.slots
    residuals = raw[point[:, None], 2 * view[:, None] + np.arange(2)]
    slices = s.problem.slices
    weight = s.used / np.trace(task.observations.cov, axis1=1, axis2=2)
    sigma = np.sqrt(np.diag(s.cov)[slices[LAW]]) if LAW in slices else np.zeros(0)
    known = zip(volumes.names, volumes.parameters, sigma, strict=True)
    cov, misfit = verdict.scale * s.cov, verdict.misfit
    set_up = cov if misfit is not None or verdict.bounds is not None else None
    if misfit is not None:
        cov = cov + misfit.follow @ misfit.second @ misfit.follow.T
    if (bounds := verdict.bounds) is not None:
        cov = cov + bounds.follow @ bounds.second @ bounds.follow.T
    if verdict.other is not None:
        cov = cov + verdict.other
    return Deformation(
        volumes=volumes, placed=task.placed, q=values[LAW], tunnel_from_model=values[MOTION],
        cam_from_tunnel={v.name: values[pose_block(v.name)] for v in task.views},
        cameras={v.camera: values[camera_block(v.camera)] for v in task.views},
        names=free_names(s.problem), cov=cov, slices=slices, residuals_px=residuals, used=s.used, test=s.test,
        rms_px=float(np.sqrt(weight @ (residuals**2).sum(axis=1) / weight.sum())),
        sigma0=float(np.sqrt(s.chi2 / s.redundancy)) if s.redundancy > 0 else float("nan"), chi2=s.chi2,
        redundancy=s.redundancy, from_prior=tuple(n for n, p, size in known if size > PRIOR_SHARE * p.sigma),
        at_bound=s.at_bound, report=s.report, options=options, doubts=verdict.doubts, suspect=verdict.suspect,
        misfit=misfit, unchecked=verdict.unchecked, set_up=set_up,
    )  # fmt: skip


def _with_discs(state: Deformation, discs: OtherDiscs | None, unit: str) -> Deformation:
    """The state with what discs of another size change in its covariance."""
    if discs is None:
        return state
    doubts, sigmas = discs.doubt(unit), sigmas_of(discs.follow, state.cov)
    more = np.outer(discs.follow, discs.follow)
    return replace(
        state, cov=state.cov + more, set_up=None if state.set_up is None else state.set_up + more,
        doubts=(*state.doubts, *doubts), unchecked=(*state.unchecked, *discs.unchecked(unit, sigmas)),
        other_discs=discs,
    )  # fmt: skip


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
