"""What a pose refinement found, and how sure it is: covariance, residuals, sigma of unit weight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.adjust.determinacy import covariance
from windmark.adjust.problem import NormalEquations, Problem
from windmark.adjust.report import SolveReport
from windmark.adjust.terms import Reprojection
from windmark.errors import UsageError
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
            raise UsageError(f"sigma: name must be one of {', '.join(self.names)}, got {name!r}")
        i = self.names.index(name)
        return float(np.sqrt(self.cov[i, i]))


def pose_estimate(
    problem: Problem, values: Mapping[str, Any], system: NormalEquations, report: SolveReport
) -> PoseEstimate:
    """The estimate at the end of a solve.

    Raises
    ------
    DegenerateGeometry
        Naming the parameters that the points do not determine, and the likely reason.
    """
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
