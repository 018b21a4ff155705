"""What two pictures say about each other: the result of `estimate_two_view`."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from windmark.geometry.pose import Pose
from windmark.geometry.two_view.matrices import essential_from_poses

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class TwoView:
    """Result of `estimate_two_view`; false where no model was found (``model`` "none").

    Parameters
    ----------
    model : what the pairs ask for: "essential" (points in space), "homography-plane" (points on a plane, the plane's
        homography gave the pose), "rotation" (no baseline that shows) or "none"
    inliers : (N,) pairs that agree with the model and are in front of both cameras
    distance : (N,) signed Sampson errors ("essential") or their lengths (the others), in units of sigma; NaN for pairs
        outside the lens model and without a model
    reason : why there is no model, or what is weak in it; "" where all is well
    weak : names of what the pairs do not determine
    b_from_a : relative pose with a baseline of length 1; None without a baseline
    rotation : (3, 3) of b_from_a, or of the model "rotation"
    cov : (6, 6) covariance of ``delta`` in ``exp(delta) @ b_from_a``, rank 5: nothing along the baseline; for
        "rotation" (3, 3); None without a model
    homography : (3, 3) of rays (z = 1), for a plane or a rotation
    normal : (3,) unit normal of the plane in frame a, pointing away from camera a
    alternatives : other poses that explain the pairs as well (the second reading of a plane)
    sigma0 : standard deviation of unit weight, relative to the covariances given; in px where none were given (the
        covariances are then scaled by it)
    parallax_deg, parallax_sigma_deg : median angle between the two rays of a pair, and the median of its sigma
    log10_nfa : decimal logarithm of the false-alarm number: how many models as good chance alone would give
    """

    model: str
    inliers: Mask
    distance: Array
    reason: str = ""
    weak: tuple[str, ...] = ()
    b_from_a: Pose | None = None
    rotation: Array | None = None
    cov: Array | None = None
    homography: Array | None = None
    normal: Array | None = None
    alternatives: tuple[Pose, ...] = field(default=())
    sigma0: float = float("nan")
    parallax_deg: float = float("nan")
    parallax_sigma_deg: float = float("nan")
    log10_nfa: float = float("inf")

    def __bool__(self) -> bool:
        return self.model != "none"

    @property
    def essential(self) -> Array | None:
        """Essential matrix of ``b_from_a``, None without a baseline."""
        return None if self.b_from_a is None else essential_from_poses(self.b_from_a)
