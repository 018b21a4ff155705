"""Pose refinement: one camera, one view, known points; camera parameters free on demand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.adjust.blocks import Block, CameraBlock, PoseBlock
from windmark.adjust.levenberg_marquardt import SolveOptions, minimise
from windmark.adjust.loss import Loss
from windmark.adjust.pose_estimate import PoseEstimate, pose_estimate
from windmark.adjust.problem import Problem
from windmark.adjust.terms import JointPrior, Prior, Reprojection, Term, whitener
from windmark.errors import DataError, UsageError
from windmark.geometry import Camera, Pose
from windmark.geometry.camera import filled_up

Array = NDArray[np.float64]


def pose_problem(
    camera: Camera,
    cam_from_model: Pose,
    xyz: ArrayLike,
    xy: ArrayLike,
    cov: ArrayLike | None = None,
    *,
    free: Sequence[str] = (),
    loss: Loss | None = None,
    prior_sigma: Mapping[str, float] | None = None,
    camera_cov: ArrayLike | None = None,
) -> tuple[Problem, dict[str, Any]]:
    """The `Problem` of `refine_pose` and its starting values, for any engine; the parameters are the same."""
    points, observed = _checked(xyz, xy)
    blocks: dict[str, Block] = {"pose": PoseBlock(points.mean(axis=0) if len(points) else np.zeros(3))}
    values = {"pose": cam_from_model, "camera": camera}
    camera_block = CameraBlock(tuple(free))
    if camera_block.names:
        blocks["camera"] = camera_block
    terms: list[Term] = [
        Reprojection(
            camera="camera",
            pose="pose",
            xyz=points,
            xy=observed,
            whitener=None if cov is None else whitener(cov, len(points)),
            free_camera=camera_block.columns,
            loss=loss or Loss(),
        )
    ]
    terms.extend(_priors(dict(prior_sigma or {}), blocks, values))
    if camera_cov is not None:
        terms.extend(_camera_prior(camera_cov, camera_block, camera, set(prior_sigma or {})))
    return Problem(blocks, terms), values


def refine_pose(
    camera: Camera,
    cam_from_model: Pose,
    xyz: ArrayLike,
    xy: ArrayLike,
    cov: ArrayLike | None = None,
    *,
    free: Sequence[str] = (),
    loss: str = "none",
    loss_scale: float | None = None,
    prior_sigma: Mapping[str, float] | None = None,
    camera_cov: ArrayLike | None = None,
    max_iterations: int = 50,
) -> PoseEstimate:
    """Least-squares pose of a camera from labelled points, with covariance.

    Parameters
    ----------
    camera : interior parameters; the free ones start here
    cam_from_model : start
    xyz : (N, 3) points in the model frame
    xy : (N, 2) detected pixels
    cov : (N, 2, 2) covariance of xy in px^2; None means 1 px^2
    free : camera parameters (names out of `geometry.PARAMETERS`) solved together with the pose
    loss : "none", "huber", "cauchy" or "tukey", on the length of each point's whitened residual. The
        last two forget far points, so they start from the result of "huber"
    loss_scale : in sigma; None takes the scale of 95 % efficiency
    prior_sigma : parameter name -> standard deviation of its start (px for focal_px and cx, rad for
        rotation_x, ..., length unit for translation_x, ...)
    camera_cov : (15, 15) covariance of the camera's start in the order of `PARAMETERS`, as `Camera.cov`: the free
        parameters with a variance > 0 are held by it, together with their correlations
    max_iterations : limit of each solve

    Notes
    -----
    The lens parameters belong to normalised coordinates, so the distortion in the image changes with the focal length.
    With ``free=("focal_px",)`` and a strong lens most of what is known of the focal length may come from that: an error
    of k1 by 1 % then moves it by up to 0.5 %, which its covariance knows nothing of. Free the lens parameters, too,
    and hold them by what is known of them (``camera_cov=camera.cov``).

    Raises
    ------
    ValueError
        For wrong shapes, values or names, or a start that puts a point behind the camera or beyond the
        lens' one-to-one range.
    DegenerateGeometry
        Where the points do not determine all free parameters (too few, on one line, focal length on a plane
        seen frontally); `determinacy` has the criterion.
    """
    wanted = Loss.make(loss, loss_scale)
    build = partial(
        pose_problem, camera, cam_from_model, xyz, xy, cov, free=free, prior_sigma=prior_sigma, camera_cov=camera_cov
    )
    problem, start = build(loss=wanted)
    _check_start(problem, start)
    options = SolveOptions(max_iterations=max_iterations)
    near, before = start, None
    if wanted.redescending:
        # From a far start such a loss would see nothing but outliers. A rough result is near enough.
        rough = replace(options, gradient_tol=0.1, cost_tol=1e-3)
        near, _, before = minimise(build(loss=Loss.make("huber"))[0], start, rough)
    values, system, report = minimise(problem, near, options)
    if before is not None:
        report = replace(
            report,
            iterations=report.iterations + before.iterations,
            evaluations=report.evaluations + before.evaluations + 1,
            initial_cost=problem.cost(start),
        )
    asked = {"free": tuple(free), "loss": loss, "loss_scale": wanted.scale, "prior_sigma": dict(prior_sigma or {})}
    report = replace(report, options={**report.options, **asked})
    return pose_estimate(problem, values, system, report)


def _checked(xyz: ArrayLike, xy: ArrayLike) -> tuple[Array, Array]:
    points, observed = np.asarray(xyz, dtype=float), np.asarray(xy, dtype=float)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"xyz: expected (N, 3), got {points.shape}")
    if observed.shape != (len(points), 2):
        raise ValueError(f"xy: expected ({len(points)}, 2) as there are {len(points)} points, got {observed.shape}")
    for name, values in (("xyz", points), ("xy", observed)):
        if not np.isfinite(values).all():
            raise UsageError(f"{name}: must be finite, row {int(np.argmin(np.isfinite(values).all(axis=1)))} is not")
    return points, observed


def _priors(sigma: dict[str, float], blocks: Mapping[str, Block], values: Mapping[str, Any]) -> list[Term]:
    """One prior per block that has any, centred on the start."""
    known = [name for block in blocks.values() for name in block.names]
    unknown = sorted(set(sigma) - set(known))
    if unknown:
        raise UsageError(f"prior_sigma: {', '.join(unknown)} not free; free are {', '.join(known)}")
    chosen = {key: {n: sigma[n] for n in block.names if n in sigma} for key, block in blocks.items()}
    return [Prior(key, blocks[key], values[key], part) for key, part in chosen.items() if part]


def _camera_prior(cov: ArrayLike, block: CameraBlock, camera: Camera, held: set[str]) -> list[Term]:
    """The prior of the free camera parameters that have a variance, centred on the start."""
    full = filled_up(cov, "camera_cov")
    rows = [n for n, column in enumerate(block.columns) if full[column, column] > 0]
    twice = [block.names[n] for n in rows if block.names[n] in held]
    if twice:
        raise UsageError(f"camera_cov: {twice[0]} is held by prior_sigma, too; expected one of them")
    if not rows:
        return []
    columns = [block.columns[n] for n in rows]
    part = full[np.ix_(columns, columns)]
    sigma = np.sqrt(np.diag(part))
    try:
        half = np.linalg.cholesky(part / np.outer(sigma, sigma))
    except np.linalg.LinAlgError:
        names = ", ".join(block.names[n] for n in rows)
        raise UsageError(f"camera_cov: must be finite and positive definite in {names}") from None
    return [JointPrior("camera", block, camera, rows, np.linalg.inv(half) / sigma)]


def _check_start(problem: Problem, start: Mapping[str, Any]) -> None:
    """Refuse what no iteration can mend, with the reason."""
    term = problem.terms[0]
    assert isinstance(term, Reprojection)
    pose: Pose = start["pose"]
    if pose.rotation.ndim != 2:
        raise ValueError(f"cam_from_model: expected a single pose, got a batch {pose.rotation.shape[:-2]}")
    valid = start["camera"].project(pose.apply(term.xyz))[1]
    if not valid.all():
        raise DataError(
            f"cam_from_model: the start puts {int((~valid).sum())} of {len(valid)} points behind the camera or beyond "
            f"the lens' one-to-one range, the first is point {int(np.argmin(valid))}"
        )
