"""What a check of markers assumes of the test to come, and the directions that it looks from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError
from windmark.geometry import Camera

Array = NDArray[np.float64]

DEFAULT_CAMERA = Camera((2048, 1536), 1024 / float(np.tan(np.radians(15.0))))
"""Where none is given: 2048 x 1536 px with a field of view of 30 degrees."""
VIEWS_PER_DIRECTION = 3
FEWEST_VIEWS = 24


@dataclass(frozen=True)
class CheckSettings:
    """The assumptions of a check.

    Parameters
    ----------
    view_from : (azimuth, elevation) in degrees of the middle of the region where the camera may stand, seen from the
        model: azimuth from x towards y, elevation from the x-y plane towards z. None: all round
    within_deg : half angle of that region about its middle
    views : virtual images in the first round, three per direction
    hidden_percent : share of the markers in view that the detector misses
    false_percent : false spots, as share of the markers in view
    noise_px : 1 sigma per coordinate of a spot
    fill : the model fills from the first to the second part of the image's width or height
    max_obliquity_deg : a marker seen more obliquely is not detected
    advise : look for changes of the layout where it cannot be identified
    seed : of every random choice

    Raises
    ------
    ValueError
        For a value out of range, by name.
    """

    view_from: tuple[float, float] | None = None
    within_deg: float = 40.0
    views: int = 360
    hidden_percent: float = 30.0
    false_percent: float = 50.0
    noise_px: float = 0.2
    fill: tuple[float, float] = (0.6, 0.9)
    max_obliquity_deg: float = 75.0
    advise: bool = True
    seed: int = 0

    def __post_init__(self) -> None:
        if self.view_from is not None:
            azimuth, elevation = self.view_from
            if not (np.isfinite(azimuth) and abs(elevation) <= 90):
                raise UsageError(
                    f"view_from: expected azimuth and elevation in degrees, elevation -90 to 90, got {self.view_from}"
                )
        ranges = (
            ("within_deg", 0, 180), ("hidden_percent", 0, 95), ("false_percent", 0, 1000), ("noise_px", 0.01, 10),
            ("max_obliquity_deg", 1, 89.9), ("views", FEWEST_VIEWS, 100_000),
        )  # fmt: skip
        for name, least, most in ranges:
            if not least <= getattr(self, name) <= most:
                raise UsageError(f"{name}: must be {least} to {most}, got {getattr(self, name)}")
        if self.within_deg == 0:
            raise UsageError("within_deg: must be > 0, got 0")
        if not 0 < self.fill[0] <= self.fill[1] <= 1:
            raise UsageError(f"fill: expected two parts of the image, rising, up to 1, got {self.fill}")

    @property
    def everywhere(self) -> bool:
        """No region was asked for."""
        return self.view_from is None

    @property
    def cell_rad(self) -> float:
        """Standard deviation, per axis, of a direction in the part of the sphere that one direction stands for."""
        within = 180.0 if self.view_from is None else self.within_deg
        return float(np.sqrt((1 - np.cos(np.radians(within))) / (2 * (self.views // VIEWS_PER_DIRECTION))))

    def directions(self) -> Array:
        """(D, 3) unit vectors from the model to the camera, each standing for the same solid angle."""
        count = self.views // VIEWS_PER_DIRECTION
        if self.view_from is None:
            return spread_directions(count, np.array([0.0, 0.0, 1.0]), 180.0)
        return spread_directions(count, direction_of(*self.view_from), self.within_deg)


def direction_of(azimuth_deg: float, elevation_deg: float) -> Array:
    """Unit vector of an azimuth (from x towards y) and an elevation (towards z)."""
    azimuth, elevation = np.radians([azimuth_deg, elevation_deg])
    return np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])


def azimuth_elevation_deg(direction: ArrayLike) -> Array:
    """(..., 2) azimuth and elevation of vectors (..., 3), degrees; azimuth 0 at the poles."""
    x, y, z = np.moveaxis(np.asarray(direction, dtype=float), -1, 0)
    across = np.hypot(x, y)
    azimuth = np.where(across > 1e-12, np.degrees(np.arctan2(y, x)), 0.0)
    return np.stack([azimuth, np.degrees(np.arctan2(z, across))], axis=-1)


def spread_directions(count: int, middle: Array, within_deg: float) -> Array:
    """(count, 3) unit vectors spread evenly within an angle about ``middle`` (Fibonacci's spiral)."""
    i = np.arange(count) + 0.5
    z = 1 - (1 - np.cos(np.radians(within_deg))) * i / count
    turn = np.pi * (1 + np.sqrt(5)) * i
    r = np.sqrt(np.maximum(1 - z * z, 0))
    side = np.cross(middle, [1.0, 0.0, 0.0] if abs(middle[0]) < 0.9 else [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    return np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=-1) @ np.stack([side, np.cross(middle, side), middle])
