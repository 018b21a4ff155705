"""The discs of a frame that is followed: centres of their images are not images of their centres.

As in `register` the labels are found and weighed as points, and the accepted pose is refined with every projection
moved by the disc's eccentricity. That is known at the predicted pose, and asked for once more where the one that is
found has another. Where discs are imaged larger or smaller than the table says, the covariance has what discs of that
size would change (`judge.discs`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Camera, Pose, imaged_ellipse
from windmark.registration.task import MIN_COUNT
from windmark.registration.track._kernels.motion import difference
from windmark.scene import Detections, MarkerSet
from windmark.scene.units import CommonRatio, common_ratio

if TYPE_CHECKING:
    from windmark.registration.track.step import Stepped

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

SAME = 0.05
"""Sigmas of a spot that eccentricities may be off without being asked for again."""
NOTHING = 0.3
"""Sigmas that a pose changes by at most, where what its spots change by adds up, for which it is not found again."""

@dataclass(frozen=True, eq=False)
class Discs:
    """The markers that are discs, of radii and normals that are known.

    Parameters
    ----------
    row : (D,) which of the N markers
    count : N
    xyz, normal, radius, curvature : of these, see `MarkerSet`
    centre : (3,) of their places
    """

    row: Ints
    count: int
    xyz: Array
    normal: Array
    radius: Array
    curvature: Array
    centre: Array

    @staticmethod
    def of(markers: MarkerSet) -> Discs | None:
        """None where there are none."""
        row = np.flatnonzero(markers.is_disc)
        if not len(row):
            return None
        some = markers.take(row)
        return Discs(row, len(markers), some.xyz, some.normal, some.radius, some.curvature, some.xyz.mean(axis=0))

    def eccentricity(self, camera: Camera, cam_from_model: Pose) -> tuple[Array, Array]:
        """(N, 2) of their images, 0 where there is none, and (N,) geometric mean radius of these, NaN there."""
        seen = imaged_ellipse(
            camera, cam_from_model.apply(self.xyz), cam_from_model.rotate(self.normal), self.radius,
            cam_from_model.rotate_form(self.curvature),
        )  # fmt: skip
        off, size = np.zeros((self.count, 2)), np.full(self.count, np.nan)
        off[self.row] = np.nan_to_num(seen.eccentricity_px)
        size[self.row] = np.sqrt(seen.axes_px[:, 0] * seen.axes_px[:, 1])
        return off, size

    def turned(self, pose: Pose, other: Pose) -> float:
        """How much the view of them changes from one pose to another, relatively: by turning, and by coming nearer.

        The eccentricity is at most r^2 / (2 f) for r pixels, and changes by at most twice this part of it.
        """
        turn = np.arccos(np.clip((np.trace(pose.rotation @ other.rotation.T) - 1.0) / 2.0, -1.0, 1.0))
        here, there = pose.apply(self.centre), other.apply(self.centre)
        return float(turn + np.linalg.norm(here - there) / max(float(np.linalg.norm(here)), 1e-300))


def with_discs(
    run: Callable[[Array], Stepped], discs: Discs, camera: Camera, predicted: Pose, spots: Detections
) -> tuple[Stepped, Array, CommonRatio]:
    """A frame with its discs' eccentricity, (6, 6) more of the pose's covariance, and how large they are imaged.

    ``run`` follows the frame with eccentricities (N, 2). The covariance is of the unit model.
    """
    first, size = discs.eccentricity(camera, predicted)
    done, none = run(first), np.zeros((6, 6))
    if not len(done.marker):
        return done, none, CommonRatio(1.0, np.inf)
    cov, imaged, now = spots.cov[done.spot], np.asarray(spots.radius_px)[done.spot], first
    # The smaller half axis, squared: of two by two numbers, in closed form.
    half, far = (cov[:, 0, 0] + cov[:, 1, 1]) / 2.0, np.hypot((cov[:, 0, 0] - cov[:, 1, 1]) / 2.0, cov[:, 0, 1])
    sigma = np.sqrt(half - far)[:, None]
    largest = float(np.fmax.reduce(size[done.marker], initial=0.0))
    if discs.turned(done.pose, predicted) * largest**2 / camera.focal_px > SAME * sigma.min():
        now, size = discs.eccentricity(camera, done.pose)
        done = run(now) if (np.abs(now - first)[done.marker] > SAME * sigma).any() else done
    ratio = common_ratio(imaged / size[done.marker], imaged, MIN_COUNT)
    change = now[done.marker] * (ratio.ratio**2 - 1.0)
    if ((change / sigma) ** 2).sum() < NOTHING**2:
        return done, none, ratio
    other = run(now * ratio.ratio**2)
    if len(other.marker) != len(done.marker):
        return done, none, ratio
    way = np.empty(6)
    difference(other.rotation, other.translation, done.rotation, done.translation, way)
    return done, np.outer(way, way), ratio
