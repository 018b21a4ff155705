"""What one registration has to solve, checked and with its defaults filled in."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, hypot, lgamma, perm, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError
from windmark.geometry import PARAMETERS, Camera, Pose
from windmark.geometry.order import median
from windmark.registration.cached import cached_property
from windmark.scene import Detections, MarkerSet

Array = NDArray[np.float64]


MIN_COUNT = 4
"""Three pairs fix a pose, a fourth is needed to check it."""
SPARSE_SPOTS, SPARSE_MARKERS = 12, 100
"""So few spots are searched in full, with so few markers: three spots can be as many markers in a million ways."""
EXPLAINED, CHECKED = 0.8, 5
"""Part of few spots that must be explained, at least so many: with one less hardly anything checks the pose."""
ROUND = 4
"""Neighbours all round a spot or a marker."""
Visible = Callable[[Pose, Camera], NDArray[np.bool_]]
"""``visible(cam_from_model, camera)`` says which of the N markers nothing hides from there: (N,) bool.

It need not know about the image's border or about normals. It is asked for few poses, those of the best solutions.
"""


Fixed = Mapping[int, int | str] | Sequence[tuple[int, int | str]]
"""Known labels: spot, and index or name of its marker."""
THIN = 1e-4
"""Markers whose distance from their best line is less than this part of their largest extent lie on it."""


@dataclass(frozen=True)
class Task:
    """Markers, spots, camera, and what a solution must obey.

    Parameters
    ----------
    markers, camera : as given
    xy, cov : (M, 2), (M, 2, 2) spots that the lens model can invert, best first, and their covariance
    tolerance_px : neighbourhood of the search
    prior : expected cam_from_model or None
    prior_max_angle_rad : largest angle between a solution and the prior
    prior_max_scale : largest ratio (> 1) between the scale of a solution and of the prior
    focal_factors : focal lengths to try, relative to the camera's; more than one frees the focal length
    fixed : pairs (spot, marker) that a solution must contain
    visible : what hides what, or None
    radius_px : (M,) of the spots as seen, NaN where unknown; None: of none
    binding : the fixed pairs are facts: they are not left however far off their gates they are
    """

    markers: MarkerSet
    camera: Camera
    xy: Array
    cov: Array
    tolerance_px: float
    prior: Pose | None = None
    prior_max_angle_rad: float = np.pi
    prior_max_scale: float = np.inf
    focal_factors: tuple[float, ...] = (1.0,)
    fixed: tuple[tuple[int, int], ...] = ()
    visible: Visible | None = None
    radius_px: Array | None = None
    binding: bool = False

    @property
    def focal_sigma(self) -> float:
        """1 sigma of the logarithm of a free focal length; 0 where it is given."""
        return 0.5 * float(np.log(self.focal_factors[-1])) if self.free_focal else 0.0

    @property
    def free_focal(self) -> bool:
        """Whether the focal length is unknown."""
        return len(self.focal_factors) > 1

    @property
    def sigma_px(self) -> Array:
        """(M,) 1 sigma per coordinate of the spots."""
        return np.asarray(np.sqrt(0.5 * (self.cov[:, 0, 0] + self.cov[:, 1, 1])))

    @cached_property
    def plane_xy(self) -> Array:
        """(M, 2) the spots as a camera without a lens of the same focal length sees them, see `search.plane`."""
        return ideal_pixels(self.camera, self.camera.unproject(self.xy))

    @cached_property
    def near_px(self) -> Array:
        """(M, 4) distances of the nearest other spots, fewer if there are less."""
        return near_px(self.xy)

    @cached_property
    def typical_sigma_px(self) -> float:
        """Median of `sigma_px`."""
        return median(self.sigma_px)

    @property
    def prior_share(self) -> float:
        """Share of all rotations and scales (within a factor of ten either way) that the prior allows."""
        if self.prior is None:
            return 1.0
        angle = min(self.prior_max_angle_rad, np.pi)
        return float((angle - np.sin(angle)) / np.pi * min(1.0, np.log10(self.prior_max_scale)))

    @property
    def least_explained(self) -> int:
        """Of few spots, those that a solution must explain; 0 where there are too many spots or markers to try all."""
        spots = len(self.xy)
        if not (MIN_COUNT <= spots <= SPARSE_SPOTS and len(self.markers) <= SPARSE_MARKERS):
            return 0
        return min(spots, max(CHECKED, ceil(EXPLAINED * spots)))

    @property
    def sparse_links(self) -> int:
        """Ways to take three spots for three markers that the search in full tries."""
        if not (least := self.least_explained):
            return 0
        return (len(self.xy) - least + 1) * perm(len(self.markers), 3) * len(self.focal_factors)

    def log_label_share(self, spots: int, pairs: int) -> float:
        """Logarithm of the share of all ways to pair so many markers and spots that the fixed pairs leave."""
        known = min(len(self.fixed), pairs)
        return _log_choices(len(self.markers) - known, spots - known, pairs - known) - _log_choices(
            len(self.markers), spots, pairs
        )

    def keeps(self, match: NDArray[np.int32]) -> bool:
        """Whether (N,) spots of the markers contain all fixed pairs."""
        return all(match[marker] == spot for spot, marker in self.fixed)

    def may_keep(self, match: NDArray[np.int32]) -> bool:
        """Whether they contain one fixed pair or more, and others may be added: neither is their spot another marker's,
        nor the other way round.
        """  # fmt: skip
        kept = [match[marker] == spot for spot, marker in self.fixed]
        others = ((match[marker] == -1 and spot not in match) for spot, marker in self.fixed)
        return any(kept) and all(own or other for own, other in zip(kept, others, strict=True))

    def label_of(self, match: NDArray[np.int32]) -> tuple[int, int] | None:
        """Which marker of (N,) spots has the first fixed spot, and which one is to have it; None if none has."""
        for spot, marker in self.fixed:
            if len(has := np.flatnonzero(match == spot)):
                return int(has[0]), marker
        return None

    def hidden_from(self, pose: Pose, camera: Camera) -> NDArray[np.bool_]:
        """(N,) markers that something hides from a camera."""
        if self.visible is None:
            return np.zeros(len(self.markers), dtype=bool)
        seen = np.asarray(self.visible(pose, camera))
        if seen.dtype != bool or seen.shape != (len(self.markers),):
            raise ValueError(
                f"register: visible must return ({len(self.markers)},) bool, got {seen.dtype} {seen.shape}"
            )
        return ~seen

    def allows(self, pose: Pose, focal_px: float) -> bool:
        """Whether a pose is near enough to the prior in angle and scale (AIAA 2005-5007, section III.C)."""
        if self.prior is None:
            return True
        if pose.angle_to(self.prior) > self.prior_max_angle_rad:
            return False
        return bool(1 / self.prior_max_scale < self.distance_ratio(pose, focal_px) < self.prior_max_scale)

    def distance_ratio(self, pose: Pose, focal_px: float) -> float:
        """How many times the prior's distance (for the same focal length) the markers are away; 1 without a prior."""
        if self.prior is None:
            return 1.0
        depth, expected = pose.apply(self.markers.xyz)[:, 2], self.prior.apply(self.markers.xyz)[:, 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            return float(np.median(depth / expected)) * self.camera.focal_px / focal_px


@dataclass(frozen=True)
class Limits:
    """Thresholds of acceptance; all must be passed.

    Parameters
    ----------
    log10_nfa : largest false-alarm number
    score : smallest log-likelihood ratio in nats, without a prior; a prior lowers it by what it rules out
    margin : smallest lead in nats over the best distinct solution
    focal_sigma : largest relative 1 sigma of a free focal length
    table_error : largest 1 sigma per coordinate by which markers may be off their table beyond its sigma, as part of
        the distance to the nearest other marker
    deformation : largest displacement of a marker by a deformation, as part of the model's size; 0: it is rigid
    """

    log10_nfa: float
    score: float
    margin: float
    focal_sigma: float
    table_error: float
    deformation: float = 0.0


def _log_choices(markers: int, spots: int, pairs: int) -> float:
    """Logarithm of the number of ways to pair some of the markers with spots."""
    if markers < pairs or spots < pairs:
        return 0.0
    ways = lgamma(markers + 1.0) - lgamma(markers - pairs + 1.0) - lgamma(pairs + 1.0)
    return ways + lgamma(spots + 1.0) - lgamma(spots - pairs + 1.0)


def near_px(points: Array) -> Array:
    """(N, 4) distances of the nearest other points (N, d), fewer if there are less."""
    from windmark.registration._kernels.near import nearest  # this brings numba

    return nearest(points, min(ROUND, len(points) - 1))[1]


def is_bent(camera: Camera) -> bool:
    """Whether the lens does anything but a pinhole does."""
    return camera.lens == "fisheye" or any(getattr(camera, name) != 0.0 for name in PARAMETERS[4:])


def ideal_pixels(camera: Camera, rays: Array) -> Array:
    """Ideal pixels (M, 2) of unprojected points (M, 3): principal point at the origin, square."""
    return np.ascontiguousarray(camera.focal_px * rays[:, :2])


def with_focal(camera: Camera, focal_px: float) -> Camera:
    """The camera with another focal length and the same distortion in the image (sensor tilts are kept).

    The coefficients of a fisheye lens belong to the angle: they stay.
    """
    q = focal_px / camera.focal_px
    if camera.lens == "fisheye":
        return replace(camera, focal_px=focal_px)
    k1, k2, k3, p1, p2 = camera.k1 * q**2, camera.k2 * q**4, camera.k3 * q**6, camera.p1 * q, camera.p2 * q
    k4, k5, k6 = camera.k4 * q**2, camera.k5 * q**4, camera.k6 * q**6
    return replace(camera, focal_px=focal_px, k1=k1, k2=k2, k3=k3, p1=p1, p2=p2, k4=k4, k5=k5, k6=k6)


def used_spots(usable: NDArray[np.bool_], excluded: ArrayLike | None) -> NDArray[np.bool_]:
    """(M,) spots that take part: those the lens model can invert and that are not excluded (indices or a mask)."""
    if excluded is None:
        return usable
    given, count = np.asarray(excluded), len(usable)
    if given.dtype == bool:
        if given.shape != (count,):
            raise ValueError(f"register: excluded as a mask must be ({count},) as there are so many spots, "
                             f"got {given.shape}")  # fmt: skip
        return usable & ~given
    if given.ndim != 1 or (given.size and not np.issubdtype(given.dtype, np.integer)):
        raise ValueError(f"register: excluded must be indices of spots or a mask, got {excluded!r}")
    bad = [int(i) for i in given if not 0 <= i < count]
    if bad:
        raise ValueError(f"register: excluded must be indices of the {count} spots, got {bad[0]}")
    used = usable.copy()
    used[given.astype(np.int64)] = False
    return used


def fixed_pairs(
    fixed: Fixed | None, detections: Detections, markers: MarkerSet, used: NDArray[np.bool_]
) -> tuple[tuple[int, int], ...]:
    """Pairs (spot among the used ones, marker index) of labels (spot, marker index or name).

    Raises
    ------
    ValueError
        For a spot or a marker that does not exist or takes no part, or comes twice.
    """
    given = list(fixed.items()) if isinstance(fixed, Mapping) else list(fixed or ())
    if not given:
        return ()
    names = markers.name.tolist()
    place = np.cumsum(used) - 1
    pairs: list[tuple[int, int]] = []
    for spot, label in given:
        if not 0 <= spot < len(detections):
            raise ValueError(f"register: fixed must name spots by their index below {len(detections)}, got {spot}")
        if not used[spot]:
            x, y = detections.xy[spot]
            raise UsageError(f"register: label {label} at ({x:.1f}, {y:.1f}): fixed spot {spot} is excluded, or the "
                             "lens model cannot invert it")  # fmt: skip
        if isinstance(label, str):
            if label not in names:
                raise UsageError(f"register: fixed label {label!r} is not the name of a marker that takes part")
            marker = names.index(label)
        else:
            marker = int(label)
            if not 0 <= marker < len(markers):
                raise ValueError(
                    f"register: fixed must name markers by name or index below {len(markers)}, got {label}"
                )
        pairs.append((int(place[spot]), marker))
    for k, what in ((0, "spot"), (1, "marker")):
        seen = [pair[k] for pair in pairs]
        if len(set(seen)) < len(seen):
            raise UsageError(f"register: every {what} may be fixed only once, got {given}")
    return tuple(pairs)


ON_LINE_PX = 0.5
"""Spots that are no farther from a line than this beyond their noise lie on it: no pose that rests on less is one."""


def off_line(points: Array) -> float:
    """Root mean square distance of points (N, 2) or (N, 3) from their best line."""
    off = points - points.sum(axis=0) / len(points)  # `mean` takes longer than all the rest
    squares = off.T @ off
    if len(squares) == 2:
        # The small root without a difference of large numbers; numpy's solver takes longer for two by two.
        (a, b), (_, c) = squares.tolist()
        large = 0.5 * (a + c + hypot(a - c, 2 * b))
        return sqrt(max(a * c - b * b, 0.0) / large / len(points)) if large > 0 else 0.0
    return float(np.sqrt(max(np.linalg.eigvalsh(squares)[:-1].sum(), 0.0) / len(points)))


def on_line(xyz: Array) -> bool:
    """Whether markers (N, 3) lie on one line."""
    return not off_line(xyz) > THIN * float(np.ptp(xyz, axis=0).max())
