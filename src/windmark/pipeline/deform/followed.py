"""What was said of an instant while the model was followed: what a verdict on any series looks at."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Camera, Pose
from windmark.tasks.deform import displaced
from windmark.tasks.deform.task import DeformationTest, DeformedFrame, Sight

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Standing:
    """Where model and cameras stood at an instant, and how the spots fit: what a report shows in 3D.

    Parameters
    ----------
    tunnel_from_model : rigid motion of the model
    xyz : (N, 3) the test's markers in the tunnel, as the state has them
    cameras : camera -> its lens and its pose in the tunnel
    residuals : camera -> (K,) numbers of the markers whose spots took part, and (K, 2) projected − detected, px
    """

    tunnel_from_model: Pose
    xyz: Array
    cameras: Mapping[str, tuple[Camera, Pose]]
    residuals: Mapping[str, tuple[NDArray[np.int64], Array]]

    @staticmethod
    def of(frame: DeformedFrame, test: DeformationTest) -> Standing | None:
        """Of an instant; None where the model was not found."""
        state, seen = frame.state, frame.observations
        if state is None or seen is None:
            return None
        residuals = {}
        for k, name in enumerate(frame.views):
            mine = (seen.view == k) & state.used
            residuals[name] = seen.point[mine], state.residuals_px[mine]
        cameras = {s.name: (state.cameras.get(s.name, s.camera), state.cam_from_tunnel.get(s.name, s.cam_from_tunnel))
                   for s in test.stations}  # fmt: skip
        return Standing(state.tunnel_from_model, displaced(test.markers, state).xyz, cameras, residuals)


@dataclass(frozen=True)
class Followed:
    """One instant.

    Parameters
    ----------
    key : what it is called, in words
    cameras : camera -> what it saw
    doubts : cause (see `Doubt`) and sentence of what speaks against the state
    sigma0 : residuals over what is stated; 1 without a state
    standing : where everything was; None without a state
    """

    key: str
    cameras: Mapping[str, Sight] = field(default_factory=dict)
    doubts: tuple[tuple[str, str], ...] = ()
    sigma0: float = 1.0
    standing: Standing | None = None

    @staticmethod
    def of(frame: DeformedFrame, key: str, test: DeformationTest) -> Followed:
        """Of an instant under a name."""
        if frame.state is None:
            return Followed(key, frame.cameras)
        doubts = tuple((d.cause, str(d)) for d in frame.state.doubts)
        return Followed(key, frame.cameras, doubts, frame.state.sigma0, Standing.of(frame, test))
