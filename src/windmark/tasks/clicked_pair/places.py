"""Where the matched spots of two pictures are in space, with the first camera's frame and the baseline as the unit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.errors import UsageError
from windmark.geometry import Camera, Pose, Triangulation, triangulate
from windmark.scene import Detections
from windmark.tasks.clicked_pair.result import ClickedPair

Array = NDArray[np.float64]

STEP = 1e-6
"""Of a rotation in radians and of a baseline of one, for the derivative by the pose: far above rounding, far below
what bends the places."""


def places(
    result: ClickedPair, spots: tuple[Detections, Detections], cameras: tuple[Camera, Camera]
) -> Triangulation:
    """All matches as points in the first camera's frame, lengths in baselines.

    Parameters
    ----------
    result : with a pose
    spots, cameras : of both pictures

    Returns
    -------
    Triangulation
        Its covariance holds that of the spots, larger by sigma0 where residuals are larger than they say, and that of
        the pose; the latter is one for all places: they move together more than these ellipsoids say.

    Raises
    ------
    UsageError
        For a result without a pose.
    """
    if result.pose is None:
        raise UsageError("places: expected a pair with a pose, as a camera gives it")
    xy = np.stack([spots[0].xy[result.spot_a], spots[1].xy[result.spot_b]])
    cov = np.stack([spots[0].cov[result.spot_a], spots[1].cov[result.spot_b]])
    if result.sigma0 > 1:
        cov = cov * result.sigma0**2
    pose = result.pose
    found = triangulate(cameras, [Pose.identity(), pose], xy, cov)
    if result.pose_cov is None or not np.isfinite(result.pose_cov).all():
        return found
    slope = np.empty((len(found.xyz), 3, 6))
    for k, delta in enumerate(STEP * np.eye(6)):
        ends = [triangulate(cameras, [Pose.identity(), Pose.exp(sign * delta) @ pose], xy, cov).xyz for sign in (1, -1)]
        slope[:, :, k] = (ends[0] - ends[1]) / (2 * STEP)
    return replace(found, cov=found.cov + slope @ result.pose_cov @ np.swapaxes(slope, 1, 2))
