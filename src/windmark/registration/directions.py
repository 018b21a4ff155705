"""Weak directions of a pose: motions of the model that the spots hardly tell.

The covariance is looked at in one unit, the root mean square way that the markers move in space: a shift counts as it
is, a rotation about the markers' centre times their root mean square distance from it, a relative change of the focal
length times the distance. The best direction is one in which the markers cross the image (all shifts across it and
the turn about the viewing direction are of that kind), so the ratio of a principal sigma to the smallest one is how
much farther the model moves in space than its markers move in the picture. For the distance this is about distance
over the markers' root mean square radius across the view: 4 for a model that fills a field of view of 60 degrees, 8 at
30, 24 at 10. For a turn of flat markers seen frontally it grows without bound. Where the ratio is above `WEAK`, the
residuals say nothing about that motion to a tenth of what they say about the others, and the direction is named.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.errors import g2
from windmark.geometry import Pose
from windmark.geometry.rotations import hat

Array = NDArray[np.float64]

WEAK = 10.0
"""Ratio of a direction's sigma to that of the best one, from which it is weak."""
NAMED = 0.2
"""A motion is named when it holds at least this part of the squared length of a direction."""
MOTIONS = (
    "rotation about image x", "rotation about image y", "rotation about the viewing direction",
    "along image x", "along image y", "along the viewing direction", "focal length",
)  # fmt: skip
"""Image x and y stand at right angles to the viewing direction, which leads to the markers' centre."""


@dataclass(frozen=True)
class WeakDirection:
    """A motion of the model that is badly determined.

    Parameters
    ----------
    motions : what moves, out of `MOTIONS`, most of it first; several where they can hardly be told apart
    sigma : 1 sigma of each of them: radians of rotations, length units of shifts, pixels of the focal length
    relative : the same: radians of rotations, part of the distance of shifts, part of the focal length
    step : (6,) or (7,) the motion at 1 sigma as [rotation, translation, focal length] of ``exp(delta) @ pose``
    ratio : how many times its sigma is that of the best direction
    """

    motions: tuple[str, ...]
    sigma: tuple[float, ...]
    relative: tuple[float, ...]
    step: Array
    ratio: float

    def words(self, unit: str = "length units") -> str:
        """In words, as "along the viewing direction: 3.2 mm (1 sigma), 0.4 % of the distance"."""
        parts = []
        for motion, sigma, relative in zip(self.motions, self.sigma, self.relative, strict=True):
            if motion.startswith("rotation"):
                parts.append(f"{motion}: {g2(np.degrees(sigma))} deg (1 sigma)")
            elif motion == "focal length":
                parts.append(f"{motion}: {g2(sigma)} px (1 sigma), {g2(100 * relative)} %")
            else:
                parts.append(f"{motion}: {g2(sigma)} {unit} (1 sigma), {g2(100 * relative)} % of the distance")
        return ", together with ".join(parts)


def weak_directions(cam_from_model: Pose, focal_px: float, cov: Array, xyz: Array) -> tuple[WeakDirection, ...]:
    """The weak directions of a pose, weakest first; empty where all are determined about equally well.

    Parameters
    ----------
    cam_from_model, focal_px : the pose and the focal length
    cov : (6, 6) covariance of [rotation, translation] for ``exp(delta) @ pose``; (7, 7) with the focal length
    xyz : (K, 3) the matched markers, in the model's frame
    """
    place = cam_from_model.apply(xyz)
    center = place.mean(axis=0)
    distance = float(np.linalg.norm(center))
    size = float(np.sqrt(((place - center) ** 2).sum(axis=1).mean()))
    view = _view(center / distance)
    motion = np.eye(len(cov))
    motion[3:6, :3] = -hat(center)  # a rotation about the camera moves the centre
    motion[:3] = view @ motion[:3]
    motion[3:6] = view @ motion[3:6]
    unit = np.array([size] * 3 + [1.0] * 3 + [distance / focal_px])[: len(cov)]
    lengths = unit[:, None] * motion
    value, vector = np.linalg.eigh(lengths @ cov @ lengths.T)
    natural = np.sqrt(np.diag(motion @ cov @ motion.T))
    scale = np.array([1.0] * 3 + [distance] * 3 + [focal_px])
    found = []
    for k in range(len(cov) - 1, 0, -1):
        ratio = float(np.sqrt(value[k] / max(value[0], 1e-300)))
        if ratio < WEAK:
            break
        share = vector[:, k] ** 2
        chosen = [int(i) for i in np.argsort(-share) if share[i] >= NAMED]
        found.append(
            WeakDirection(
                tuple(MOTIONS[i] for i in chosen),
                tuple(float(natural[i]) for i in chosen),
                tuple(float(natural[i] / scale[i]) for i in chosen),
                np.linalg.solve(lengths, np.sqrt(value[k]) * vector[:, k]),
                ratio,
            )
        )
    return tuple(found)


def _view(ahead: Array) -> Array:
    """(3, 3) rotation whose rows are image x and y, at right angles to the viewing direction, and that direction."""
    x = np.array([1.0, 0.0, 0.0]) - ahead[0] * ahead
    x /= np.linalg.norm(x)
    return np.stack([x, hat(ahead) @ x, ahead])
