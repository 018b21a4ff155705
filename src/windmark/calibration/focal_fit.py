"""Camera and poses from a rough focal length: the adjustment that `start_focal` judges its starts by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.adjust.levenberg_marquardt import SolveOptions, minimise
from windmark.adjust.loss import DEFAULT_SCALE, Loss
from windmark.adjust.network import Network, NetworkProblem, NetworkState
from windmark.calibration.start import LEAST, start_poses
from windmark.errors import WindmarkError
from windmark.geometry import Camera, Pose

Array = NDArray[np.float64]
Mark = tuple[Array, Array]
"""Of one picture: xy (K, 2), xyz (K, 3)."""

FREE = ("focal_px", "cx", "cy", "k1")
LEAST_SIGMA_PX = 0.01
_CENTRE = 0.02  # of the picture's size: 1 sigma of the principal point about the middle
_CORNER = 0.05  # of its distance: 1 sigma of the distortion of the picture's corner
_RAYLEIGH = float(np.sqrt(2 * np.log(2.0)))  # median length of a residual of unit sigma per coordinate
_STEPS = SolveOptions(max_iterations=25, gradient_tol=1e-3)
_STAGES, _SETTLED = 6, 0.95  # robust stages at most; one that lowers the scatter by less is the last
_BETTER = 0.7  # times the median residual: another pose is the right one of two


@dataclass(frozen=True)
class Fit:
    """An adjusted start: ``sigma`` is the scatter of its residuals per coordinate, ``cost`` what it is judged by."""

    camera: Camera
    poses: list[Pose | None]
    sigma: float
    cost: float


def adjusted(camera: Camera, marks: list[Mark], seed: int) -> Fit | None:
    """Poses at the start of a camera, then everything together with weights that follow the scatter down."""
    poses = start_poses(camera, marks, scan_focal=False, rng=np.random.default_rng(seed))[1]
    for _ in range(2):
        got = _robust(camera, poses, marks)
        if got is None:
            return None
        camera, poses = got
        # Now that the lens is known, a pose that was the wrong one of two shows.
        again, other = start_poses(camera, marks, scan_focal=False, rng=np.random.default_rng(seed + 1))[1:]
        old = np.array([_median(camera, p, m) for p, m in zip(poses, marks, strict=True)])
        better = other < _BETTER * old
        if not better.any():
            break
        poses = [a if b else p for a, b, p in zip(again, better, poses, strict=True)]
    length = np.concatenate([distances(camera, p, m) for p, m in zip(poses, marks, strict=True) if p is not None])
    sigma = max(float(np.median(length)) / _RAYLEIGH, LEAST_SIGMA_PX)
    return Fit(camera, poses, sigma, float(np.mean(np.log(length**2 + LEAST_SIGMA_PX**2))))


def _robust(camera: Camera, poses: list[Pose | None], marks: list[Mark]) -> tuple[Camera, list[Pose | None]] | None:
    scale = np.inf
    for _ in range(_STAGES):
        there = [k for k, p in enumerate(poses) if p is not None and len(marks[k][0]) > LEAST]
        if not there:
            return None
        length = np.concatenate([distances(camera, poses[k], marks[k]) for k in there])
        if not np.isfinite(length).all():
            return None
        new = max(float(np.median(length)) / _RAYLEIGH, LEAST_SIGMA_PX)
        if new > _SETTLED * scale:
            break
        scale = new
        loss = Loss("cauchy", DEFAULT_SCALE["cauchy"])
        problem, start = problem_of(camera, [(poses[k], *marks[k]) for k in there], scale, loss)
        try:
            state = minimise(problem, start, _STEPS)[0]
        except (np.linalg.LinAlgError, WindmarkError):
            return None
        camera, poses = state.cameras[0], list(poses)
        for n, k in enumerate(there):
            poses[k] = Pose(state.frames.rotation[n], state.frames.translation[n])
    return camera, poses


def problem_of(
    camera: Camera, views: list[tuple[Pose | None, Array, Array]], sigma: float, loss: Loss
) -> tuple[NetworkProblem, NetworkState]:
    """Camera and poses free, points held, the principal point and the distortion near nothing."""
    count = np.array([len(xy) for _, xy, _ in views])
    total = int(count.sum())
    xy, xyz = (np.concatenate([v[k] for v in views]) for k in (1, 2))
    width, height = camera.size_px
    corner = (np.hypot(width, height) / 2 / camera.focal_px) ** 2
    network = Network(
        np.repeat(np.arange(len(views)), count), np.arange(total), xy,
        np.broadcast_to(sigma**2 * np.eye(2), (total, 2, 2)),
        np.zeros(len(views), np.int64), np.arange(len(views)), np.full(len(views), -1), (FREE,),
        np.ones(len(views), bool), np.ones((total, 3), bool), loss=loss,
        camera_value=[{"cx": (width - 1) / 2, "cy": (height - 1) / 2, "k1": 0.0}],
        camera_sigma=[{"cx": _CENTRE * width, "cy": _CENTRE * height, "k1": _CORNER / corner}],
    )  # fmt: skip
    frames = Pose(np.stack([p.rotation for p, _, _ in views if p]), np.stack([p.translation for p, _, _ in views if p]))
    state = NetworkState((camera,), frames, xyz)
    return NetworkProblem(network, state), state


def distances(camera: Camera, pose: Pose | None, mark: Mark) -> Array:
    """(K,) distance of the marks of a picture from where they should be, pixels; inf where there is no prediction."""
    xy, xyz = mark
    if pose is None:
        return np.full(len(xy), np.inf)
    seen, valid = camera.project(pose.apply(xyz))
    return np.where(valid, np.hypot(*(seen - xy).T), np.inf)


def _median(camera: Camera, pose: Pose | None, mark: Mark) -> float:
    return float(np.median(distances(camera, pose, mark))) if pose is not None else np.inf
