"""How good a calibration is, by more than its own covariance.

On real lenses the formal covariance is optimistic: what the lens model cannot follow is no noise. Maps of the residuals
over the sensor show it, and two halves of the pictures that are calibrated apart say by how much.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark.calibration.datum import Fixed, Free
from windmark.calibration.result import Calibration, NotCalibrated
from windmark.calibration.self_calibrate import self_calibrate
from windmark.errors import DataError, UsageError
from windmark.geometry import PARAMETERS, Camera
from windmark.geometry.similarity import align
from windmark.scene import MarkerSet, Observations

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ResidualMap:
    """Mean residuals in cells of the sensor.

    Parameters
    ----------
    x, y : (B + 1,), (A + 1,) edges of the cells in pixels
    radial, tangential : (A, B) mean residual away from the principal point, and across it (clockwise in the image)
    sigma : (A, B) 1 sigma of these means from the scatter in the cell; NaN with fewer than two marks
    count : (A, B) marks
    """

    x: Array
    y: Array
    radial: Array
    tangential: Array
    sigma: Array
    count: NDArray[np.int64]

    @property
    def excess(self) -> float:
        """Root mean square of the cell means beside what noise alone would give: 1 if the lens model misses nothing."""
        good = self.count > 2
        power = (self.radial**2 + self.tangential**2)[good] / (2 * self.sigma[good] ** 2)
        return float(np.sqrt(power.mean())) if good.any() else float("nan")


def residual_map(result: Calibration, camera: str, columns: int = 12) -> ResidualMap:
    """Residuals of the used marks of one camera over its sensor; cells are square."""
    found = _camera(result, camera)
    mine = result.used & (np.array([v.camera for v in result.views])[result.observations.view] == camera)
    xy, r = result.observations.xy[mine], result.residuals[mine]
    width, height = found.size_px
    rows = max(1, round(columns * height / width))
    x, y = np.linspace(-0.5, width - 0.5, columns + 1), np.linspace(-0.5, height - 0.5, rows + 1)
    arm = xy - [found.cx, found.cy]
    along = arm / np.maximum(np.linalg.norm(arm, axis=1, keepdims=True), 1e-9)
    radial, across = (r * along).sum(axis=1), along[:, 0] * r[:, 1] - along[:, 1] * r[:, 0]
    column = np.clip(np.searchsorted(x, xy[:, 0]) - 1, 0, columns - 1)
    row = np.clip(np.searchsorted(y, xy[:, 1]) - 1, 0, rows - 1)
    cell = row * columns + column
    count = np.bincount(cell, minlength=rows * columns)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = [np.bincount(cell, v, minlength=rows * columns) / count for v in (radial, across)]
        power = np.bincount(cell, (r**2).sum(axis=1), minlength=rows * columns) / (2 * count)
        spread = power - (mean[0] ** 2 + mean[1] ** 2) / 2
        sigma = np.sqrt(np.maximum(spread, 0.0) / np.maximum(count - 1, 0))
    shape = (rows, columns)
    sigma = np.where(count > 1, sigma, np.nan)
    return ResidualMap(x, y, mean[0].reshape(shape), mean[1].reshape(shape), sigma.reshape(shape), count.reshape(shape))


def projection_sigma(camera: Camera, columns: int = 24) -> tuple[Array, Array, Array]:
    """How well the camera knows where a far point is seen, over its sensor.

    A turn of the camera as a whole is left out: every pose takes it up (as in mrcal's projection uncertainty).

    Parameters
    ----------
    camera : with the covariance of its parameters

    Returns
    -------
    x, y : (B,), (A,) pixels
    sigma : (A, B) 1 sigma per coordinate in pixels (root mean square of both)
    """
    if camera.cov is None:
        raise DataError("projection_sigma: the camera has no covariance")
    width, height = camera.size_px
    rows = max(2, round(columns * height / width))
    x, y = np.linspace(0, width - 1, columns), np.linspace(0, height - 1, rows)
    pixel = np.stack(np.meshgrid(x, y), axis=-1)
    ray = camera.unproject(pixel)
    _, valid, d_xyz, d_camera = camera.project_jacobian(ray)
    turn = np.cross(ray[..., None, :], d_xyz)  # d . (w x ray) = w . (ray x d)
    good = valid[..., None, None] & np.isfinite(d_camera)
    a, b = np.where(good[..., :1], turn, 0.0).reshape(-1, 3), np.where(good, d_camera, 0.0).reshape(-1, len(PARAMETERS))
    left = b - a @ np.linalg.lstsq(a, b, rcond=None)[0]
    variance = np.einsum("ni,ij,nj->n", left, camera.cov, left).reshape(rows, columns, 2).mean(axis=2)
    return x, y, np.where(valid, np.sqrt(np.maximum(variance, 0.0)), np.nan)


@dataclass(frozen=True)
class Comparison:
    """Two independent calibrations of the same markers.

    Parameters
    ----------
    name : (K,) markers that both have
    difference : (K, 3) second less first, fitted to each other (turn, shift and scale; by the markers that both datums
        hold, where there are three of them), in the length unit
    sigma : (K, 3) 1 sigma of the difference by both covariances
    chi2 : (K,) squared difference in units of them, three on average; NaN for markers that a datum holds
    ratio : root mean square of difference / sigma: 1 where the covariances tell the whole story
    rms : root mean square length of the differences
    """

    name: NDArray[np.str_]
    difference: Array
    sigma: Array
    chi2: Array
    ratio: float
    rms: float


@dataclass(frozen=True)
class KnownMarkers:
    """Coordinates and their covariances: all that `compare` needs of a calibration.

    Parameters
    ----------
    markers : N of them
    marker_cov : (N, 3, 3)
    """

    markers: MarkerSet
    marker_cov: Array


def compare(first: Calibration | KnownMarkers, second: Calibration | KnownMarkers) -> Comparison:
    """The paper's cross-check: markers of two sets of pictures beside each other (AIAA 2005-5007, section IV.D).

    The ratio is right for two free networks (seven of the differences are taken up by the fit, and missing in the
    covariances) and for two with the same markers held; with another datum, or known distances, it comes out too small.
    """
    name, a, b = np.intersect1d(first.markers.name, second.markers.name, return_indices=True)
    if len(name) < 4:
        raise DataError(f"compare: the calibrations have {len(name)} markers in common; four are needed")
    fixed = (first.markers.sigma[a] == 0).all(axis=1) & (second.markers.sigma[b] == 0).all(axis=1)
    by = fixed if fixed.sum() >= 3 else np.ones(len(name), dtype=np.bool_)
    fit = align(second.markers.xyz[b][by], first.markers.xyz[a][by])
    difference = fit.apply(second.markers.xyz[b]) - first.markers.xyz[a]
    cov = first.marker_cov[a] + fit.scale**2 * (fit.rotation @ second.marker_cov[b] @ fit.rotation.T)
    sigma = np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
    # Covariances of inner constraints have the seven motions taken out already.
    held = np.asarray(~(sigma > 0).all(axis=1))
    inverse = np.linalg.inv(np.where(held[:, None, None], np.eye(3), cov))
    squares = np.where(held, np.nan, np.einsum("ni,nij,nj->n", difference, inverse, difference))
    return Comparison(
        name, difference, sigma, squares, float(np.sqrt(np.nanmean(squares) / 3)),
        float(np.sqrt((difference**2).sum(axis=1).mean())),
    )  # fmt: skip


@dataclass(frozen=True)
class SplitHalf:
    """Every second picture against the others.

    Parameters
    ----------
    comparison : of the two halves' markers, None where all were held
    change : interior parameter -> (second less first, 1 sigma of it), of each camera
    ratio : of the comparison; where all markers were held, the same of the interior parameters with their correlations
    """

    comparison: Comparison | None
    change: dict[str, dict[str, tuple[float, float]]]
    ratio: float


def split_half(result: Calibration, *, seed: int = 0) -> SplitHalf | NotCalibrated:
    """Calibrate two random halves of the pictures apart and compare.

    Each is a free network, unless the datum holds all markers. Rigs are split by
    frames. Where a half is too small for a calibration its `NotCalibrated` comes back.
    """
    frames = list(dict.fromkeys(v.frame if result.options["rig"] else v.name for v in result.views))
    if len(frames) < 2:
        return NotCalibrated("a single picture has no halves", "too_few")
    order = np.random.default_rng(seed).permutation(len(frames))
    halves = []
    for part in (0, 1):
        mine = {frames[i] for i in order[part::2]}
        keep = np.array([(v.frame if result.options["rig"] else v.name) in mine for v in result.views])
        half = _calibrate_again(result, keep)
        if isinstance(half, NotCalibrated):
            return half
        halves.append(half)
    change: dict[str, dict[str, tuple[float, float]]] = {}
    for name in result.cameras:
        a, b = (h.cameras[name] for h in halves)
        change[name] = {
            p: (getattr(b, p) - getattr(a, p), float(np.hypot(halves[0].sigma(name, p), halves[1].sigma(name, p))))
            for p in result.options["free"]
        }
    if result.options["datum"] == Fixed():
        return SplitHalf(None, change, _interior_ratio(halves[0], halves[1]))
    comparison = compare(halves[0], halves[1])
    return SplitHalf(comparison, change, comparison.ratio)


def _interior_ratio(first: Calibration, second: Calibration) -> float:
    """Root mean square change of the cameras' parameters, in units of both covariances."""
    square, count = 0.0, 0
    for name in first.cameras:
        a, b = first.cameras[name], second.cameras[name]
        if a.cov is None or b.cov is None:
            continue
        free = np.flatnonzero(np.diagonal(a.cov) > 0)
        change = np.array([getattr(b, PARAMETERS[k]) - getattr(a, PARAMETERS[k]) for k in free])
        scale = np.sqrt(np.diagonal(a.cov)[free])
        cov = (a.cov + b.cov)[np.ix_(free, free)] / np.outer(scale, scale)
        square += float(change / scale @ np.linalg.solve(cov, change / scale))
        count += len(free)
    return float(np.sqrt(square / count)) if count else float("nan")


def _calibrate_again(result: Calibration, keep: NDArray[np.bool_]) -> Calibration | NotCalibrated:
    """The same job on some of the views, from the result, without its gross errors."""
    obs, options = result.observations, result.options
    datum = Fixed() if options["datum"] == Fixed() else Free()
    mine = keep[obs.view] & result.used
    views = [v for v, k in zip(result.views, keep, strict=True) if k]
    there = {v.name for v in views}
    observations = Observations((np.cumsum(keep) - 1)[obs.view[mine]], obs.point[mine], obs.xy[mine], obs.cov[mine])
    return self_calibrate(
        observations, replace(result.markers, sigma=np.full_like(result.markers.sigma, np.nan)),
        {n: replace(c, cov=None) for n, c in result.cameras.items()}, views, datum=datum, free=options["free"],
        rig=options["rig"], eccentricity=options["eccentricity"], prior_sigma=options["prior_sigma"],
        free_focal=[n for n in options["free_focal"] if n in there],
        free_principal=[n for n in options["free_principal"] if n in there],
        reject=options["reject"], max_sigma0=options["max_sigma0"],
    )  # fmt: skip


def _camera(result: Calibration, name: str) -> Camera:
    if name not in result.cameras:
        raise UsageError(f"camera must be one of {', '.join(result.cameras)}, got {name!r}")
    return result.cameras[name]
