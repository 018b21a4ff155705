"""A swept wing before two cameras 60 degrees apart: rendered tests with known deformation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from windmark import synth
from windmark.deformation import Stations, Volume, Volumes
from windmark.deformation.laws import Beam
from windmark.geometry import Pose
from windmark.pipeline.deform import DeformationTest, Station

TIP, TWIST_DEG, SHIFT, TURN_DEG = 0.02, 1.0, 20.0, 2.0
"""Full size of the motion: rise of the tip over the span, twist of the tip, shift (mm) and turn of the model."""


def volumes(shape: synth.HalfModel, unit: str = "mm") -> Volumes:
    """Wing on body: a beam along the quarter-chord line with streamwise sections."""
    slope, x = np.tan(np.radians(shape.sweep_deg)), 0.25 * shape.root_chord
    root, tip = shape.body_radius, shape.span
    beam = Beam((x + slope * root, root, 0), (x + slope * tip, tip, 0), section=(0, 1, 0), unit=unit)
    return Volumes.of([Volume("body"), Volume("wing", beam, parent="body")])


def true_law(shape: synth.HalfModel, state: synth.WingState) -> np.ndarray:
    """(4,) the laws' parameters of a state: rise b (3 e^2 - e^3) / 2 and twist e^2."""
    rise = state.tip_fraction * (shape.span - shape.body_radius)
    return np.array([1.5 * rise, -0.5 * rise, 0.0, state.twist_deg])


def span_stations(shape: synth.HalfModel, count: int = 11) -> Stations:
    """Chords along the middle of the wing."""
    slope, ends = np.tan(np.radians(shape.sweep_deg)), np.array([shape.body_radius, shape.span])
    middle = slope * ends + 0.5 * shape.chord(ends)
    start, end = np.column_stack([middle, ends, np.zeros(2)])
    return Stations.along(start, end, count, volume="wing", chord=(150.0, 0.0, 0.0))


def deformation_test(
    test: synth.TunnelTest, cameras: Sequence[str] | None = None, *, walls: bool = True, **station: object
) -> DeformationTest:
    """What `follow_deformation` wants, for some of the cameras, with or without the markers on walls."""
    markers = test.markers if walls else test.markers.take(test.markers.role != "wall")
    names = list(test.cameras) if cameras is None else list(cameras)
    places = tuple(Station(n, test.cameras[n], test.cam_from_tunnel[n], **station) for n in names)  # type: ignore[arg-type]
    return DeformationTest(places, markers, volumes(test.shape))


def random_state(
    rng: np.random.Generator, *, shake: bool = False, cameras: Sequence[str] = ("cam1", "cam2")
) -> synth.WingState:
    """Full bending and twist of random sign, a rigid motion of full size in a random direction; cameras that moved."""
    turn, shift = (v / np.linalg.norm(v) for v in rng.standard_normal((2, 3)))
    pivot = np.array([130.0, 0.0, 0.0])
    rotation = Pose.from_rotvec(np.radians(TURN_DEG) * turn, np.zeros(3)).rotation
    motion = Pose(rotation, pivot - rotation @ pivot + SHIFT * shift)
    sign = rng.choice([-1.0, 1.0], 2)
    state = synth.WingState(TIP * sign[0], TWIST_DEG * sign[1], motion)
    return replace(state, shaken={n: _shaken(rng) for n in cameras}) if shake else state


def _shaken(rng: np.random.Generator, shift: float = 2.0, turn_deg: float = 0.2) -> Pose:
    a, b = (v / np.linalg.norm(v) for v in rng.standard_normal((2, 3)))
    return Pose.from_rotvec(np.radians(turn_deg) * a, shift * b)


def rendered(
    test: synth.TunnelTest, state: synth.WingState, sensor: synth.Sensor, seed: Sequence[int]
) -> tuple[dict[str, np.ndarray], dict[str, synth.Rendering]]:
    """Images of all cameras, and the perfect renderings with the truth of every marker."""
    world = synth.deformed_world(test, state)
    images, perfect = {}, {}
    for c, (name, camera) in enumerate(test.cameras.items()):
        pose = test.cam_from_tunnel[name]
        if name in state.shaken:
            pose = state.shaken[name] @ pose
        perfect[name] = synth.render(world, camera, pose)
        images[name] = sensor.expose(
            perfect[name].image, np.random.default_rng([*seed, c]), np.random.default_rng([*seed[:1], c])
        )
    return images, perfect
