"""Pose refinement: one camera, one view, known points; camera parameters free on demand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.adjust.blocks import Block, CameraBlock, PoseBlock
from windmark.adjust.determinacy import covariance
from windmark.adjust.levenberg_marquardt import SolveOptions, minimise
from windmark.adjust.loss import Loss
from windmark.adjust.problem import NormalEquations, Problem
from windmark.adjust.report import SolveReport
from windmark.adjust.terms import JointPrior, Prior, Reprojection, Term, whitener
from windmark.geometry import PARAMETERS, Camera, DegenerateGeometry, Pose

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PoseEstimate:
    """A refined pose with everything needed to judge it.

    Parameters
    ----------
    cam_from_model : the pose
    camera : the camera, with the free parameters replaced. Its `cov` holds the block of the free ones
        from this solve (correlations with the pose are in `cov` below); entries of fixed ones are kept
    cov : (6 + F, 6 + F) covariance of [rotation, translation, *free] for ``exp(delta) @ pose``, from the
        given covariances of the observations. Times ``sigma0**2`` it is the one from the residuals
    names : (6 + F,) names of the parameters, in the order of `cov`
    residuals_px : (N, 2) projected - detected
    weights : (N,) weights of the robust loss, 1 for an undoubted point
    rms_px : root mean square length of all residuals, robust weights not applied
    sigma0 : a posteriori standard deviation of unit weight: 1 where the residuals are as large as the
        given covariances say; NaN where there are no redundant observations
    report : why the solve stopped
    """

    cam_from_model: Pose
    camera: Camera
    cov: Array
    names: tuple[str, ...]
    residuals_px: Array
    weights: Array
    rms_px: float
    sigma0: float
    report: SolveReport

    def sigma(self, name: str) -> float:
        """Standard deviation of one parameter by name."""
        if name not in self.names:
            raise ValueError(f"sigma: name must be one of {', '.join(self.names)}, got {name!r}")
        i = self.names.index(name)
        return float(np.sqrt(self.cov[i, i]))


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
    camera_cov : (11, 11) covariance of the camera's start in the order of `PARAMETERS`, as `Camera.cov`: the free
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
    return _estimate(problem, values, system, report)


def _checked(xyz: ArrayLike, xy: ArrayLike) -> tuple[Array, Array]:
    points, observed = np.asarray(xyz, dtype=float), np.asarray(xy, dtype=float)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"xyz: expected (N, 3), got {points.shape}")
    if observed.shape != (len(points), 2):
        raise ValueError(f"xy: expected ({len(points)}, 2) as there are {len(points)} points, got {observed.shape}")
    for name, values in (("xyz", points), ("xy", observed)):
        if not np.isfinite(values).all():
            raise ValueError(f"{name}: must be finite, row {int(np.argmin(np.isfinite(values).all(axis=1)))} is not")
    return points, observed


def _priors(sigma: dict[str, float], blocks: Mapping[str, Block], values: Mapping[str, Any]) -> list[Term]:
    """One prior per block that has any, centred on the start."""
    known = [name for block in blocks.values() for name in block.names]
    unknown = sorted(set(sigma) - set(known))
    if unknown:
        raise ValueError(f"prior_sigma: {', '.join(unknown)} not free; free are {', '.join(known)}")
    chosen = {key: {n: sigma[n] for n in block.names if n in sigma} for key, block in blocks.items()}
    return [Prior(key, blocks[key], values[key], part) for key, part in chosen.items() if part]


def _camera_prior(cov: ArrayLike, block: CameraBlock, camera: Camera, held: set[str]) -> list[Term]:
    """The prior of the free camera parameters that have a variance, centred on the start."""
    full = np.asarray(cov, dtype=float)
    if full.shape != (len(PARAMETERS),) * 2:
        raise ValueError(f"camera_cov: expected ({len(PARAMETERS)}, {len(PARAMETERS)}), got {full.shape}")
    rows = [n for n, column in enumerate(block.columns) if full[column, column] > 0]
    twice = [block.names[n] for n in rows if block.names[n] in held]
    if twice:
        raise ValueError(f"camera_cov: {twice[0]} is held by prior_sigma, too; expected one of them")
    if not rows:
        return []
    columns = [block.columns[n] for n in rows]
    part = full[np.ix_(columns, columns)]
    sigma = np.sqrt(np.diag(part))
    try:
        half = np.linalg.cholesky(part / np.outer(sigma, sigma))
    except np.linalg.LinAlgError:
        names = ", ".join(block.names[n] for n in rows)
        raise ValueError(f"camera_cov: must be finite and positive definite in {names}") from None
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
        raise ValueError(
            f"cam_from_model: the start puts {int((~valid).sum())} of {len(valid)} points behind the camera or beyond "
            f"the lens' one-to-one range, the first is point {int(np.argmin(valid))}"
        )


def _estimate(
    problem: Problem, values: Mapping[str, Any], system: NormalEquations, report: SolveReport
) -> PoseEstimate:
    term = problem.terms[0]
    assert isinstance(term, Reprojection)
    camera: Camera = values["camera"]
    pose: Pose = values["pose"]
    whitened = term.residual(values)
    assert whitened is not None  # the engine never stands where the model has no prediction
    squared = np.sum(whitened * whitened, axis=-1)
    weights = term.loss.evaluate(squared)[1]
    try:
        cov = covariance(system, problem.names, _gradient_noise(problem, values, system))
    except DegenerateGeometry as error:
        message = f"refine_pose: {_why(term.xyz, weights, pose, camera)}; the solve ended as {report.reason}"
        raise DegenerateGeometry(message, error.weak) from None

    residuals = camera.project(pose.apply(term.xyz))[0] - term.xy
    return PoseEstimate(
        cam_from_model=pose,
        camera=_with_cov(camera, term.free_camera, cov[6:, 6:]),
        cov=cov,
        names=problem.names,
        residuals_px=residuals,
        weights=weights,
        rms_px=float(np.sqrt(np.mean(np.sum(residuals**2, axis=-1)))) if len(residuals) else float("nan"),
        sigma0=_sigma0(problem, values, squared, weights),
        report=report,
    )


def _gradient_noise(problem: Problem, values: Mapping[str, Any], system: NormalEquations) -> Array | None:
    """Covariance of the gradient, in natural units; None where it is the information matrix.

    Of good points J^T W J holds E[w] of the information and the loss wastes 1 - efficiency of it, so the points'
    part of the gradient varies by E[w] / efficiency of their part of J^T W J. Priors have no loss.
    """
    loss = problem.terms[0].loss
    if loss.name == "none":
        return None
    mean_weight, _, efficiency = loss.gaussian_moments()
    ratio = mean_weight / efficiency
    priors = Problem(problem.blocks, problem.terms[1:]).linearise(values)
    assert priors is not None
    return ratio * system.information + (1 - ratio) * priors.information


def _sigma0(problem: Problem, values: Mapping[str, Any], squared: Array, weights: Array) -> float:
    """A posteriori sigma of unit weight: weighted squares over what good points would give, times redundancy."""
    mean_weight, mean_square, _ = problem.terms[0].loss.gaussian_moments()
    parts = [term.residual(values) for term in problem.terms[1:]]
    priors = np.concatenate([np.zeros(0), *(part.ravel() for part in parts if part is not None)])
    # Points of zero weight neither count nor hold a parameter (Kish's effective number of points).
    used = float(weights.sum() ** 2 / max(float(weights @ weights), 1e-300))
    redundant = 1 - (problem.size - len(priors)) / 2 / max(used, 1e-300)
    expected = float(weights.sum()) / mean_weight * mean_square * redundant
    if redundant < 1e-9:
        return float("nan")
    return float(np.sqrt((weights @ squared + priors @ priors * mean_square / 2) / expected))


def _with_cov(camera: Camera, columns: Sequence[int], cov: Array) -> Camera:
    """The camera with the block of its free parameters put into its covariance."""
    if not columns:
        return camera
    full = np.zeros((len(PARAMETERS),) * 2) if camera.cov is None else np.array(camera.cov)
    full[columns, :] = 0.0
    full[:, columns] = 0.0
    full[np.ix_(columns, columns)] = cov
    return replace(camera, cov=full)


def _why(xyz: Array, weights: Array, pose: Pose, camera: Camera) -> str:
    """The likely reason, in words, why the points do not determine the parameters."""
    used = xyz[weights > 1e-3]
    if len(used) < len(xyz):
        return f"the robust loss leaves {len(used)} of {len(xyz)} points"
    if len(used) < 3:
        return f"{len(used)} points, at least 3 are needed"
    _, size, axes = np.linalg.svd(used - used.mean(axis=0), full_matrices=False)
    if size[0] == 0:
        return "all points coincide"
    if size[1] < 1e-3 * size[0]:
        return "the points lie on one line"
    normal_z = abs(float((pose.rotation @ axes[2])[2]))
    if size[2] < 1e-3 * size[0] and normal_z > 0.99:
        return "the points lie in a plane seen frontally"
    return "the points are too few, or too close to a degenerate arrangement, for their noise"
