"""What two pictures and a few matches by hand give."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Pose
from windmark.geometry.two_view import Fundamental

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class ClickedPair:
    """The geometry of two pictures and their matches; falsy with ``reason`` where the clicks do not determine it.

    Parameters
    ----------
    fundamental : (3, 3) on pixels without lens distortion (`ideal_pixels`), norm 1
    epipole_a, epipole_b : (2,) in these pixels
    pose, pose_cov : b_from_a with a baseline of 1, and its covariance, `Camera.cov` included; None without a camera
    estimate : what the clicks alone gave without a camera; None with one
    click_a, click_b : (N, 2) places that count: the spots that were meant
    click_px : (N,) signed distance of each click's match from the final geometry
    wrong : (N,) clicks that contradict the others, or mean no spot
    unchecked : (N,) clicks in use that the others do not check: a wrong one might not show
    shows_px : (N,) smallest error of each click that the others would show, px; NaN for the wrong ones
    spot_a, spot_b : (K,) all matches as spots, those by hand first where they are spots
    click : (K,) the click that each is, -1 for those found along the lines
    distance_px : (K,)
    sigma0 : residuals over sigma
    notes : what the user should know
    """

    fundamental: Array = field(default_factory=lambda: np.full((3, 3), np.nan))
    epipole_a: Array = field(default_factory=lambda: np.full(2, np.nan))
    epipole_b: Array = field(default_factory=lambda: np.full(2, np.nan))
    pose: Pose | None = None
    pose_cov: Array | None = None
    estimate: Fundamental | None = None
    click_a: Array = field(default_factory=lambda: np.zeros((0, 2)))
    click_b: Array = field(default_factory=lambda: np.zeros((0, 2)))
    click_px: Array = field(default_factory=lambda: np.zeros(0))
    wrong: Mask = field(default_factory=lambda: np.zeros(0, bool))
    unchecked: Mask = field(default_factory=lambda: np.zeros(0, bool))
    shows_px: Array = field(default_factory=lambda: np.zeros(0))
    spot_a: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    spot_b: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    click: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    distance_px: Array = field(default_factory=lambda: np.zeros(0))
    sigma0: float = float("nan")
    notes: tuple[str, ...] = ()
    reason: str = ""

    def __bool__(self) -> bool:
        return not self.reason

    @property
    def by_hand(self) -> Mask:
        """(K,) matches that are clicks."""
        return self.click >= 0
