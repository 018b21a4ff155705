"""A focal length from nothing: the start of a calibration with no lens data at all.

Pictures of a flat board give it in closed form (Zhang 2000): the homography of each must map the plane's axes to
perpendicular directions of equal length. Any markers give it by a scan: for each focal length the poses of all pictures
by P3P. Each start is adjusted with one term of radial distortion and the principal point near the middle, so the
lens does not pass for perspective; the best fit wins, and says how well it knows the focal length.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.adjust.levenberg_marquardt import SolveOptions, minimise
from windmark.adjust.loss import Loss
from windmark.adjust.network.covariance import network_covariance
from windmark.calibration.focal_fit import FREE, Fit, Mark, adjusted, distances, problem_of
from windmark.calibration.start import LEAST, start_poses
from windmark.errors import UsageError, g2
from windmark.geometry import PARAMETERS, Camera, DegenerateGeometry, Pose
from windmark.geometry.two_view.homography import robust_homography

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

_SCAN = tuple(np.geomspace(0.4, 25.0, 19))  # picture widths
_FISHEYE_SCAN = tuple(np.geomspace(0.2, 1.6, 13))  # the same: fields of view of 290 to 36 degrees across
_FEW = 120  # marks of a picture that the search uses
_STARTS = 4  # adjusted, the best of the scan
_LENS_PX = 0.01  # of the picture's diagonal: how far distortion moves a point before it is called wrong
_FLAT = 0.01  # thickness by second extent: flat markers
_REJECT = 4.0  # sigma per coordinate: a mark farther off is left out
_FINAL = SolveOptions(max_iterations=100, gradient_tol=1e-3)

CAUSES = {
    "too_few": "no picture has enough marks",
    "no_pose": "no camera sees the marks where they are",
    "perspective": "the pictures hardly show perspective",
}
"""Every cause of a `FocalNotDetermined`, in words."""


@dataclass(frozen=True)
class StartFocal:
    """A focal length, and where the pictures were taken from.

    Parameters
    ----------
    focal_px, sigma_px : focal length and its 1 sigma, from the scatter of the residuals; the principal point is taken
        as known to 2 % of the picture's size and that is in it, distortion beyond k1 is not
    camera : with the focal length, principal point and k1 found: start values, not a calibration
    poses : of each picture, None where it has none
    used : for each picture (K,) which marks fit
    rms_px : of the residuals of those marks
    """

    focal_px: float
    sigma_px: float
    camera: Camera
    poses: tuple[Pose | None, ...]
    used: tuple[Mask, ...]
    rms_px: float

    def __bool__(self) -> bool:
        return True


@dataclass(frozen=True)
class FocalNotDetermined:
    """The pictures say no. Falsy.

    Parameters
    ----------
    reason : why, in words for the user
    cause : key of `CAUSES`
    focal_px, sigma_px : the best fit, not to be trusted; NaN without one
    """

    reason: str
    cause: Literal["too_few", "no_pose", "perspective"]
    focal_px: float = float("nan")
    sigma_px: float = float("nan")

    def __bool__(self) -> bool:
        return False


def start_focal(
    views: Sequence[tuple[ArrayLike, ArrayLike]],
    size_px: tuple[int, int],
    *,
    max_sigma: float = 0.1,
    seed: int = 0,
    lens: str = "brown",
) -> StartFocal | FocalNotDetermined:
    """Focal length of one camera and the pose of every picture, from labelled marks and nothing else.

    Square pixels, principal point near the middle of the picture. A fifth of the labels may be wrong, the marker
    coordinates rough, the lens off by some ten pixels at the border.

    Parameters
    ----------
    views : for each picture (xyz (K, 3), xy (K, 2)): marker coordinates and where they were seen. Each picture may have
        coordinates of its own, as boards labelled from any corner have
    size_px : (width, height) of the pictures
    max_sigma : relative 1 sigma beyond which the focal length counts as not determined
    seed : of the choice of marks
    lens : "brown", or "fisheye", of which the focal length is per radian on the axis

    Returns
    -------
    StartFocal or FocalNotDetermined
        A flat board seen face-on, from however many places, does not tell a long lens far away from a short one near
        by: that is said, not guessed.

    Raises
    ------
    ValueError
        Wrong shapes or values.

    References
    ----------
    Zhang, A flexible new technique for camera calibration, IEEE PAMI 22 (2000), section 3.1.
    """
    marks = [_checked(k, xyz, xy) for k, (xyz, xy) in enumerate(views)]
    if not 0 < max_sigma < np.inf:
        raise UsageError(f"start_focal: max_sigma must be a positive number, got {max_sigma!r}")
    blank = Camera(size_px, float(size_px[0]), lens=lens)
    if not any(len(xy) > LEAST for xy, _ in marks):
        return FocalNotDetermined(f"no picture has more than {LEAST} marks", "too_few")
    few = _thinned(marks, seed)
    best: Fit | None = None
    for camera in _starts(blank, few, seed):
        fit = adjusted(camera, few, seed)
        if fit is not None and (best is None or fit.cost < best.cost):
            best = fit
    if best is None:
        return FocalNotDetermined("no camera sees the marks where they are: wrong labels or coordinates?", "no_pose")
    return _judged(best, marks, max_sigma)


def zhang_focal(homographies: Sequence[Array], camera: Camera) -> float | None:
    """Focal length from maps plane -> picture, principal point and aspect as the camera's; None without perspective.

    Columns h1, h2 of each, centred: h1' w h2 = 0 and h1' w h1 = h2' w h2 with w = diag(1, 1, f^2) (Zhang 2000,
    eq. 3 and 4), divided by |h1| |h2| and solved for f^2 by least squares.
    """
    rows = []
    centre = np.array([[1, 0, -camera.cx], [0, 1 / camera.aspect, -camera.cy / camera.aspect], [0, 0, 1.0]])
    for h in homographies:
        a, b = (centre @ h)[:, :2].T
        size = np.hypot(*a[:2]) * np.hypot(*b[:2])
        rows.append([a[2] * b[2] / size, -(a[:2] @ b[:2]) / size])
        rows.append([(a[2] ** 2 - b[2] ** 2) / 2 / size, (b[:2] @ b[:2] - a[:2] @ a[:2]) / 2 / size])
    m, c = np.array(rows).reshape(-1, 2).T
    if not (m @ c > 0):
        return None
    return float(np.sqrt(m @ c / (m @ m)))


def _checked(k: int, xyz: ArrayLike, xy: ArrayLike) -> tuple[Array, Array]:
    x, p = np.asarray(xyz, dtype=float), np.asarray(xy, dtype=float)
    if x.ndim != 2 or x.shape[1] != 3 or p.shape != (len(x), 2):
        raise ValueError(f"start_focal: views[{k}] must be xyz (K, 3) and xy (K, 2), got {x.shape} and {p.shape}")
    if not (np.isfinite(x).all() and np.isfinite(p).all()):
        raise ValueError(f"start_focal: views[{k}] must be finite")
    return p, x


def _thinned(marks: list[Mark], seed: int) -> list[Mark]:
    """At most so many marks of each picture, drawn at random: enough to find the start; all judge it."""
    rng = np.random.default_rng(seed)
    chosen = [rng.permutation(len(xy))[:_FEW] for xy, _ in marks]
    return [(xy[k], xyz[k]) for (xy, xyz), k in zip(marks, chosen, strict=True)]


def _starts(blank: Camera, marks: list[Mark], seed: int) -> list[Camera]:
    """Cameras to start from: Zhang's, and the best of the scan."""
    rng = np.random.default_rng(seed)
    fisheye = blank.lens == "fisheye"  # it maps no plane by a homography
    width, gate = blank.size_px[0], _LENS_PX * float(np.hypot(*blank.size_px))
    flat = [] if fisheye else [pair for pair in map(_flat, marks) if pair is not None]
    found = [robust_homography(*pair, gate, rng) for pair in flat]
    focal = zhang_focal([f[0] for f in found if f is not None], blank)
    cameras = [replace(blank, focal_px=focal)] if focal is not None else []
    misfit = []
    scan = _FISHEYE_SCAN if fisheye else _SCAN
    for factor in scan:
        trial = replace(blank, focal_px=width * factor)
        median = start_poses(trial, marks, scan_focal=False, rng=np.random.default_rng(seed))[2]
        misfit.append(np.median(median[np.isfinite(median)]) if np.isfinite(median).any() else np.inf)
    order = [k for k in np.argsort(misfit, kind="stable")[:_STARTS] if np.isfinite(misfit[k])]
    return cameras + [replace(blank, focal_px=width * scan[k]) for k in order]


def _flat(mark: Mark) -> tuple[Array, Array] | None:
    """Coordinates in the plane of flat markers, and the picture's; None of others."""
    xy, xyz = mark
    if len(xy) <= LEAST:
        return None
    away = xyz - xyz.mean(axis=0)
    _, extent, axes = np.linalg.svd(away, full_matrices=False)
    return (away @ axes[:2].T, xy) if extent[2] < _FLAT * extent[1] else None


def _judged(fit: Fit, marks: list[Mark], max_sigma: float) -> StartFocal | FocalNotDetermined:
    """Least squares of the marks that fit, and whether it determines the focal length."""
    used = [distances(fit.camera, p, m) < _REJECT * fit.sigma for p, m in zip(fit.poses, marks, strict=True)]
    there = [k for k, u in enumerate(used) if u.sum() > LEAST]
    camera, poses = fit.camera, [p if k in there else None for k, p in enumerate(fit.poses)]
    if not there:
        return FocalNotDetermined("no camera sees the marks where they are: wrong labels or coordinates?", "no_pose")
    views = [(poses[k], marks[k][0][used[k]], marks[k][1][used[k]]) for k in there]
    problem, start = problem_of(camera, views, fit.sigma, Loss())
    state, system, report = minimise(problem, start, _FINAL)
    residual = problem.residual(state)
    assert residual is not None
    redundancy = 2 * len(residual) - 6 * len(there) - len(FREE)
    factor = np.sqrt((residual**2).sum() / redundancy) if redundancy > 0 else 1.0
    camera = state.cameras[0]
    try:
        column = problem.layout.columns.camera[0][PARAMETERS.index("focal_px")]
        variance = network_covariance(system, problem.layout).dense[column, column]
        sigma = float(np.sqrt(variance) * problem.units(state).camera[0][0] * factor)
    except DegenerateGeometry:
        sigma = np.inf
    focal = camera.focal_px
    if not (report.converged and sigma <= max_sigma * focal):
        return FocalNotDetermined(
            f"the focal length is not determined: {focal:.0f} px is the best fit, with a 1 sigma of {g2(sigma)} px."
            " Flat markers seen face-on, or small in the picture, show no perspective: tilt the board or come nearer",
            "perspective", focal, sigma,
        )  # fmt: skip
    for n, k in enumerate(there):
        poses[k] = Pose(state.frames.rotation[n], state.frames.translation[n])
    rms = float(np.sqrt((residual**2).sum(axis=1).mean()) * fit.sigma)
    return StartFocal(focal, sigma, camera, tuple(poses), tuple(u & (k in there) for k, u in enumerate(used)), rms)
