"""Is the focal length of a followed sequence the given one, in all images? What none shows alone, all of them may.

The pose gives way to another focal length, and what is left in one image is less than its spots' noise; but it is of
the same sign wherever the error is. So its score is summed over the images: the derivative of the squared residuals by
the focal length, the pose taken out image by image, for a deviation that is constant, that grows, and that begins at
some image (a score test, Rao, Proc. Camb. Phil. Soc. 44, 1948). The rest of the interior may be off by what a
calibration leaves (`lens.prior`, or the camera's own covariance), in all images alike.

How sure that is, the markers themselves tell: each has its own error of the table and of its spot, for the whole
sequence, so that what they say is compared marker by marker and not number by number (the sandwich of Liang and Zeger,
Biometrika 73, 1986, with a marker as a cluster; and once with an image as one, as an image may be blurred or torn).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from windmark.geometry import PARAMETERS, Camera, Pose
from windmark.pipeline.track_results import PoseRow, pov_of
from windmark.pipeline.verdict.lens import INTERIOR, by_pose, lead_of_any_size, prior, smooth
from windmark.scene import MarkerSet

Array = NDArray[np.float64]

MOST = 16_000
"""Sightings of markers that are asked, in images that are evenly spread: more cost time, and tell little more."""
CHANCE, CHANCE_SAME = 0.01, 1e-3
"""Chance, for all shapes in time together, that a sequence without fault has one of them (they are much alike, and a
change has to stand out beside any error that lasts); and that it has a constant one, which an error of the table is."""
TAKEN, LEAST = 4, 8
"""Markers whose numbers a pose and a focal length take, and how many there must be to tell how sure they are."""
LEFT = 0.1
"""What is left of a marker's error at least where the others hardly hold what it says."""
ALIKE = 9.0
"""Squared sigmas by which one shape in time may fit less well than another, and be what happened."""
SURE = 3.0
"""Sigmas by which the beginning, or the end, must be nearer to the given focal length to be what it was given for."""
HELD = 1e12
"""Known so well (over what a calibration leaves, squared) that it does not move."""
FOCAL = INTERIOR.index("focal_px")
_COLUMNS = [PARAMETERS.index(p) for p in INTERIOR]


@dataclass(frozen=True)
class Deviation:
    """A focal length that is not the given one.

    Parameters
    ----------
    kind : "constant", "drift" (in proportion to the time between the first and the last image) or "step"
    part, sigma : by what part of itself it is longer (at the end, or from the step on), and 1 sigma of that
    first : number among the rows of the image from which it is so; 0 for what is no step
    at_end : whether the given one is that at the end, rather than that at the beginning
    either : whether the images do not tell which of the two it is
    smooth : nats that a table that is off smoothly, as a model that bends, is ahead of it in explaining the residuals
    """

    kind: str
    part: float
    sigma: float
    first: int = 0
    at_end: bool = False
    either: bool = False
    smooth: float = 0.0


@dataclass(frozen=True)
class FocalSeries:
    """What a sequence tells of the focal length.

    Parameters
    ----------
    focal_px : the given one
    found : its deviation; None where there is none beyond chance
    shown : the least constant deviation, as a part of it, that would have been found; inf where there is too little
    part : (R,) by what part of itself the focal length of every row may be longer than the given one: of the shapes in
        time that are about as likely as ``found`` the largest; zeros without
    effect : (R, 6) what that has done to the points of view
    """

    focal_px: float
    found: Deviation | None
    shown: float
    part: Array
    effect: Array


class _Looks(NamedTuple):
    """n images of N markers, the poses taken out, zeros where a marker is not seen.

    Number of the row (n,), time (n,), weight (n,), ``seen`` (n, N), residuals ``free`` (n, 2 N), the interior's columns
    ``inner`` (n, 2 N, P), and what part of a marker's numbers the pose ``taken`` (n, N).
    """

    row: NDArray[np.int64]
    time: Array
    weight: Array
    seen: NDArray[np.bool_]
    free: Array
    inner: Array
    taken: Array


class _Sums(NamedTuple):
    """Normal equations of the interior of every image, (n, P, P) and (n, P), and what is known of it before (P, P)."""

    normal: Array
    side: Array
    known: Array


class _Fit(NamedTuple):
    """A shape in time (n,): its amount, the sigma of that by the spots' noise alone, and the constant interior.

    ``beside`` (P,) is the interior without that shape, ``mixed`` (P,) what of it looks like an amount of one, ``loose``
    the sigma of the focal length at the beginning.
    """

    shape: Array
    amount: float
    sigma: float
    beside: Array
    mixed: Array
    loose: float

    @property
    def gain(self) -> float:
        """By how much it lowers the squared residuals in their sigmas."""
        return (self.amount / self.sigma) ** 2

    @property
    def _nearer(self) -> float:
        """By how much the focal length at the beginning is nearer to the given one than that at the end."""
        start = self.beside[FOCAL] - self.mixed[FOCAL] * self.amount
        return float(abs(start + self.amount) - abs(start))

    @property
    def either(self) -> bool:
        """See `Deviation.either`."""
        return bool(np.ptp(self.shape)) and abs(self._nearer) < SURE * self.loose

    @property
    def at_end(self) -> bool:
        """See `Deviation.at_end`."""
        return self._nearer < 0 and not self.either

    @property
    def part(self) -> Array:
        """(n,) how much longer than given the focal length is, as far as this shape tells; of two cases the larger."""
        if not np.ptp(self.shape):
            return self.amount * self.shape
        other = 1 - self.shape if self.either else np.zeros_like(self.shape)
        return self.amount * np.where(other > self.shape, -other, self.shape - self.at_end)


class _Found(NamedTuple):
    """A deviation, its fit, and (n,) how much longer than given the focal length may be at most, in `lens.prior`."""

    deviation: Deviation
    fit: _Fit
    most: Array


def focal_series(rows: Sequence[PoseRow], markers: MarkerSet, camera: Camera) -> FocalSeries:
    """Ask the rows of a followed sequence; ``markers`` are those that it was followed with, ``camera`` the given one.

    What it costs does not grow with the sequence's length beyond `MOST` sightings: a tenth of a second at most.
    """
    none = np.zeros(len(rows)), np.zeros((len(rows), 6))
    asked = [k for k, row in enumerate(rows) if row.cam_from_model is not None and row.matched >= LEAST]
    asked = [k for k in asked if rows[k].spot_px > 0]
    if not asked:
        return FocalSeries(camera.focal_px, None, np.inf, *none)
    most = min(max(MOST // len(markers), LEAST), len(asked))
    spread = np.array(asked)[np.linspace(0, len(asked) - 1, most).round().astype(int)]
    unit = prior(camera)
    looks = _looks(rows, spread, markers, camera)
    weighted = looks.weight[:, None, None] * looks.inner
    side = np.einsum("nip,ni->np", weighted, looks.free)
    sums = _Sums(weighted.transpose(0, 2, 1) @ looks.inner, side, _known(camera, unit))
    size = float(unit[FOCAL] / camera.focal_px)
    found, shown = _constant(looks, sums, camera, size)
    found = _changed(looks, sums, size) or found
    if found is None:
        return FocalSeries(camera.focal_px, None, shown, *none)
    deviation = replace(found.deviation, smooth=_smoother(rows, looks, found.fit.shape, markers, camera))
    part, effect = size * np.interp(np.arange(len(rows)), spread, found.most), none[1]
    for k, row in enumerate(rows):
        if part[k] and row.cam_from_model is not None:
            effect[k] = pov_change(row, markers, camera, part[k])
    return FocalSeries(camera.focal_px, deviation, shown, part, effect)


def pov_change(row: PoseRow, markers: MarkerSet, camera: Camera, part: float) -> Array:
    """(6,) how far the point of view is off where the focal length is longer by a part of itself, to first order."""
    assert row.cam_from_model is not None, "focal_series: a row without a pose"
    off = row.pov - pov_of(Pose.exp(pose_step(row, markers, camera, part)) @ row.cam_from_model)
    off[:3] = (off[:3] + 180.0) % 360.0 - 180.0
    return np.asarray(off)


def pose_step(row: PoseRow, markers: MarkerSet, camera: Camera, part: float) -> Array:
    """(6,) the same as ``exp(step) @ cam_from_model`` that leads from the pose of a row to the true one."""
    assert row.cam_from_model is not None, "focal_series: a row without a pose"
    pose, inner = _jacobians(row.cam_from_model.apply(markers.xyz[row.matches[0]]), camera)
    by_part = inner[:, FOCAL] * (camera.focal_px / prior(camera)[FOCAL])
    return -part * np.asarray(np.linalg.lstsq(pose, by_part, rcond=None)[0])


def _jacobians(xyz: Array, camera: Camera) -> tuple[Array, Array]:
    """(..., 2 K, 6) and (..., 2 K, P) image of places (..., K, 3) by pose, and by interior in units of `lens.prior`."""
    _, _, by_xyz, by_camera = camera.project_jacobian(xyz)
    flat = (*xyz.shape[:-2], 2 * xyz.shape[-2], -1)
    return by_pose(by_xyz, xyz).reshape(flat), (by_camera[..., _COLUMNS] * prior(camera)).reshape(flat)


def _looks(rows: Sequence[PoseRow], which: NDArray[np.int64], markers: MarkerSet, camera: Camera) -> _Looks:
    count, some = (len(which), len(markers)), [rows[k] for k in which]
    seen, off = np.zeros(count, bool), np.zeros((*count, 2))
    for i, row in enumerate(some):
        seen[i, row.matches[0]] = True
        off[i, row.matches[0]] = -row.matches[1][:, 2:]  # observed - projected
    poses = [row.cam_from_model for row in some if row.cam_from_model is not None]
    turn, shift = np.array([p.rotation for p in poses]), np.array([p.translation for p in poses])
    xyz = markers.xyz @ turn.transpose(0, 2, 1) + shift[:, None]
    xyz[~seen] = shift.repeat(count[1], axis=0).reshape(xyz.shape)[~seen]  # what is not seen may be behind the camera
    pose, inner = _jacobians(xyz, camera)
    own = np.repeat(seen, 2, axis=1)[..., None]
    pose, both = pose * own, np.concatenate([off.reshape(count[0], -1, 1), inner], axis=2) * own
    basis = np.linalg.qr(pose / np.linalg.norm(pose, axis=1, keepdims=True))[0]
    both -= basis @ (basis.transpose(0, 2, 1) @ both)
    noise = np.array([np.hypot(row.excess_px, row.spot_px) for row in some])
    taken = (basis**2).sum(axis=2).reshape(*count, 2).mean(axis=2)
    time = np.array([row.instant for row in some])
    return _Looks(which, time, noise**-2.0, seen, both[..., 0], both[..., 1:], taken)


def _known(camera: Camera, unit: Array) -> Array:
    """What is known of the interior in units of `lens.prior`, as an inverse covariance."""
    if camera.cov is None:
        return np.eye(len(unit))
    cov = np.asarray(camera.cov)[np.ix_(_COLUMNS, _COLUMNS)] / np.outer(unit, unit)
    return np.asarray(np.linalg.inv(cov + 1e-8 * np.eye(len(unit))))


def _constant(looks: _Looks, sums: _Sums, camera: Camera, size: float) -> tuple[_Found | None, float]:
    """The same deviation in all images, and the least that would be found."""
    loose = np.linalg.inv(sums.known)
    rest = np.arange(len(loose)) != FOCAL
    known = np.diag(np.where(rest, 0.0, HELD))  # the shape that is asked for is a column of its own
    known[np.ix_(rest, rest)] = np.linalg.inv(loose[np.ix_(rest, rest)])
    (fit,) = _fits(np.ones((1, len(looks.row))), sums._replace(known=known))
    sigma, limit = _sure(looks, fit, CHANCE_SAME)
    before = 0.0 if camera.cov is None else float(loose[FOCAL, FOCAL])
    shown = limit * float(np.hypot(sigma, np.sqrt(before)))
    found = _Found(Deviation("constant", size * fit.amount, size * sigma), fit, fit.part)
    return (found if abs(fit.amount) > shown else None), size * shown


def _changed(looks: _Looks, sums: _Sums, size: float) -> _Found | None:
    """One that grows, or begins at some image, whatever the focal length is at the beginning."""
    count, time = len(looks.row), looks.time - looks.time[0]
    if count < 2:
        return None
    shapes = np.tril(np.ones((count, count)), -1)[:, :-1].T  # row k: from image k + 1 on
    if count > 2:
        shapes = np.vstack([shapes, time / time[-1]])
    fits = _fits(shapes, sums)
    best = max(fits, key=lambda fit: fit.gain)
    sigma, limit = _sure(looks, best, CHANCE / len(shapes))
    if not abs(best.amount) > limit * sigma:
        return None
    alike = [fit for fit in fits if fit.gain > best.gain - ALIKE]
    if count > 2 and fits[-1].gain > best.gain - ALIKE:
        best = fits[-1]  # that somebody touched the lens at one instant is said where that is clear
    parts = np.array([fit.part for fit in alike])
    parts = np.take_along_axis(parts, np.abs(parts).argmax(axis=0)[None], axis=0)[0]
    first = int(np.argmax(best.shape > 0))
    kind, row = ("step", int(looks.row[first])) if best.shape[first] == 1.0 else ("drift", 0)
    return _Found(Deviation(kind, size * best.amount, size * sigma, row, best.at_end, best.either), best, parts)


def _fits(shapes: Array, sums: _Sums) -> list[_Fit]:
    """Of shapes in time (S, n), the constant interior taken out."""
    whole, side, own = sums.normal.sum(axis=0) + sums.known, sums.side.sum(axis=0), sums.normal[:, :, FOCAL]
    beside, across = np.linalg.inv(whole), shapes @ own
    mixed = across @ beside
    told = np.maximum(shapes**2 @ own[:, FOCAL] - (across * mixed).sum(axis=1), np.finfo(float).tiny)
    amount = (shapes @ sums.side[:, FOCAL] - mixed @ side) / told
    free = beside @ side
    return [
        _Fit(x, float(a), float(t) ** -0.5, free, m, float(np.sqrt(beside[FOCAL, FOCAL] + m[FOCAL] ** 2 / t)))
        for x, a, t, m in zip(shapes, amount, told, mixed, strict=True)
    ]  # fmt: skip


def _sure(looks: _Looks, fit: _Fit, false: float) -> tuple[float, float]:
    """1 sigma of an amount by what markers and images say of it, and how many of these are no chance.

    What is left of a marker is less than its error by the part that it has in the amount and in the poses (HC3).
    """
    count, times = looks.seen.sum(axis=0), looks.weight[:, None] * fit.sigma**2
    own = fit.shape[:, None] * looks.inner[..., FOCAL] - looks.inner @ fit.mixed
    left = looks.free - looks.inner @ fit.beside - own * fit.amount
    free = int((2 * count > len(looks.row)).sum()) - TAKEN
    if free < LEAST - TAKEN:
        return np.inf, np.inf
    told = (times * own * left).reshape(*looks.seen.shape, 2).sum(axis=2)
    part = (times * own**2).reshape(*looks.seen.shape, 2).sum(axis=(0, 2))
    part += looks.taken.sum(axis=0) / np.maximum(count, 1)
    of_marker = np.linalg.norm(told.sum(axis=0) / np.maximum(1 - part, LEFT))
    sigma = max(fit.sigma, float(of_marker), float(np.linalg.norm(told.sum(axis=1))))
    return sigma, float(student.isf(false / 2, free))


def _smoother(rows: Sequence[PoseRow], looks: _Looks, shape: Array, markers: MarkerSet, camera: Camera) -> float:
    """See `Deviation.smooth`: of the residuals that have this shape in time, as those of one image in their middle."""
    times = looks.weight * (shape - (0.0 if np.ptp(shape) == 0 else np.average(shape, weights=looks.weight)))
    seen = np.flatnonzero(2 * looks.seen.sum(axis=0) > len(looks.row))
    middle = rows[looks.row[len(looks.row) // 2]].cam_from_model
    assert middle is not None, "focal_series: a row without a pose"
    xyz = middle.apply(markers.xyz[seen])
    by_place = camera.project_jacobian(xyz)[2] @ middle.rotation
    pose, inner = _jacobians(xyz, camera)
    free = np.linalg.qr(pose / np.linalg.norm(pose, axis=0), mode="complete")[0][:, 6:]
    left = (times @ looks.free / (times @ shape)).reshape(-1, 2)[seen].reshape(-1)
    bent = free.T @ smooth(markers.xyz[seen], by_place)
    return lead_of_any_size(free.T @ left, bent) - lead_of_any_size(free.T @ left, free.T @ inner[:, [FOCAL]])
