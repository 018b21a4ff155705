"""The values of a network: cameras, poses, points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Camera, Pose

Array = NDArray[np.float64]


@dataclass(frozen=True)
class NetworkState:
    """One point of the parameter space; also what an adjusted network is.

    Parameters
    ----------
    cameras : C cameras
    frames : batch of F poses, ``rig_from_model`` (``cam_from_model`` where there is no rig)
    points : (N, 3)
    offsets : batch of A poses ``cam_from_rig``; None without a rig
    change : (V, 3) what each view differs by from its camera: relative change of the focal length, and shift of the
        principal point (px); None for nothing
    """

    cameras: tuple[Camera, ...]
    frames: Pose
    points: Array
    offsets: Pose | None = None
    change: Array | None = None
