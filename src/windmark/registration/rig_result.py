"""What `register_rig` gives back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.adjust import SolveReport
from windmark.geometry import Camera, Pose
from windmark.registration.result import Deformation, RunnerUp, Unchecked
from windmark.scene import Matching

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RigRegistration:
    """Which spot is which marker in each of C cameras, and where the model was.

    Parameters
    ----------
    rig_from_model : the pose
    cameras : with a free focal length as found, and moved within ``Camera.cov`` where that was given; else as given
    cam_from_rig : as given, moved within ``rig_cov`` where that was
    matchings : of each camera, the pairs in order of markers; empty where a camera had no spots
    rms_px : root mean square length of all residuals
    residuals : of each camera, (K, 2) projected - detected, pixels, in the order of its matching. Projected is the
        centre of the imaged disc where a marker's normal and radius are known, else the image of its centre
    cov : (6, 6) covariance of [rotation, translation] for ``exp(delta) @ rig_from_model``. It includes the excess, and
        what places of cameras that are slightly off would change
    excess_px : (C,) 1 sigma per coordinate of the misfit beyond the covariances of detections and markers: table
        errors, lens, bending, errors of ``cam_from_rig``; NaN where no marker was matched
    score : log-likelihood ratio in nats against "the spots are where they are by chance", all cameras together
    log10_nfa : decimal logarithm of the false-alarm number: how many labellings this good chance would give
    runner_up : the best distinct other solution, as the first camera would see it; None if the search met none
    n_expected : of each camera, markers that should be seen, matched ones included; 0 where it had no spots
    n_hypotheses : links of three markers to three spots that were tried, in all cameras
    report : why the last adjustment stopped
    xyz : (N, 3) the markers of the table
    deformation : None if the rigid model explains the spots; its ``shift_px`` is that in the first camera
    unchecked : what these pictures cannot tell, though the pose rests on it
    options : everything the registration was made with, by name
    """

    rig_from_model: Pose
    cameras: tuple[Camera, ...]
    cam_from_rig: tuple[Pose, ...]
    matchings: tuple[Matching, ...]
    rms_px: float
    residuals: tuple[Array, ...]
    cov: Array
    excess_px: Array
    score: float
    log10_nfa: float
    runner_up: RunnerUp | None
    n_expected: tuple[int, ...]
    n_hypotheses: int
    report: SolveReport
    xyz: Array
    deformation: Deformation | None = None
    unchecked: tuple[Unchecked, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return True

    @property
    def counts(self) -> tuple[int, ...]:
        """Matched markers of each camera."""
        return tuple(len(m.marker) for m in self.matchings)

    def cam_from_model(self, i: int) -> Pose:
        """The pose as camera i sees it."""
        return self.cam_from_rig[i] @ self.rig_from_model
