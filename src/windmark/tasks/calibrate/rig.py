"""The cameras of a rig to each other, in figures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from windmark.calibration import Calibration

Record = dict[str, Any]


@dataclass(frozen=True)
class Beside:
    """A camera of a rig beside the first one.

    Parameters
    ----------
    camera : its name
    distance, distance_sigma : between the centres, in the length unit
    angle_deg, angle_sigma_deg : of the turn from one to the other
    """

    camera: str
    distance: float
    distance_sigma: float
    angle_deg: float
    angle_sigma_deg: float


def beside(result: Calibration) -> tuple[Beside, ...]:
    """Every camera of the rig but the first; empty without a rig."""
    out = []
    for name in list(result.cam_from_rig)[1:]:
        pose, cov = result.cam_from_rig[name], result.rig_cov[name]
        distance = float(np.linalg.norm(pose.translation))
        turn = pose.log()[:3]
        angle = float(np.linalg.norm(turn))
        # exp(delta) turns about the axis by its part along it, and a turn does not change the length of t.
        along = [v / n if n > 0 else np.zeros(3) for v, n in ((pose.translation, distance), (turn, angle))]
        sigma = [np.sqrt(max(float(a @ c @ a), 0.0)) for a, c in zip(along, (cov[3:, 3:], cov[:3, :3]), strict=True)]
        out.append(Beside(name, distance, sigma[0], float(np.degrees(angle)), float(np.degrees(sigma[1]))))
    return tuple(out)


def beside_record(one: Beside) -> Record:
    """A camera beside the first one, for the summary."""
    return {
        "camera": one.camera, "distance": {"value": one.distance, "sigma": one.distance_sigma},
        "angle_deg": {"value": one.angle_deg, "sigma": one.angle_sigma_deg},
    }  # fmt: skip
