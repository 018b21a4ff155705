from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.scene import MarkerSet
from windmark.synth import HalfModel, Paint, TunnelTest, World, assemble, wind_tunnel
from windmark.synth.patch import rectangle


@pytest.fixture(scope="session")
def small_test() -> TunnelTest:
    """A whole test, small enough to be made in a second."""
    return wind_tunnel(3, size_px=(480, 384), nodes=12_000)


@pytest.fixture(scope="session")
def half_model() -> HalfModel:
    return HalfModel()


@pytest.fixture(scope="session")
def lens() -> Camera:
    return Camera((200, 160), 900, 1.0005, 103.2, 76.1, k1=-0.12, k2=0.05, p1=4e-4, p2=-3e-4)


@pytest.fixture(scope="session")
def make_plate() -> Callable[..., World]:
    """A flat plate, 200 x 160 units, z = 0, outward +z, unit light, with discs at given places."""

    def make(xy: object, radius: float = 3.0, *, contrast: float = 0.8, paint: Paint | None = None) -> World:
        plate = rectangle("plate", "wing", (-100, -80, 0), (200, 0, 0), (0, 160, 0), 21, 17)
        points = np.asarray(xy, dtype=float).reshape(-1, 2)
        markers = MarkerSet.make(
            [f"M{k}" for k in range(len(points))],
            np.column_stack([points, np.zeros(len(points))]),
            radius=radius,
            normal=np.tile([0.0, 0, 1], (len(points), 1)),
            volume="wing",
        )
        return World(assemble([plate]), markers, Paint() if paint is None else paint, marker_contrast=contrast)

    return make


@pytest.fixture(scope="session")
def tilted_view() -> Callable[[float], Pose]:
    """cam_from_plate of a camera 1000 units away, looking at the origin under an angle to the plate's normal."""

    def make(tilt_deg: float, distance: float = 1000.0) -> Pose:
        a = np.radians(tilt_deg)
        return Pose.look_at(distance * np.array([np.sin(a), 0, np.cos(a)]), np.zeros(3), [0.0, 1, 0])

    return make
