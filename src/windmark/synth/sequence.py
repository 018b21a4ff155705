"""Images of a moving model: the virtual wind tunnel frame by frame."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Pose
from windmark.synth.degrade import Sensor
from windmark.synth.motion import flex
from windmark.synth.paint import TransonicFlow
from windmark.synth.render import render
from windmark.synth.screen import Rays
from windmark.synth.tunnel import WIND_OFF, TunnelTest
from windmark.synth.world import World

Array = NDArray[np.float64]


def tunnel_sequence(
    test: TunnelTest,
    motions: Iterable[Pose],
    *,
    camera: str = "cam1",
    sensor: Sensor | None = Sensor(),  # noqa: B008 (frozen)
    seed: int = 0,
) -> Iterator[tuple[NDArray[np.generic], Pose]]:
    """Images of the wind-off model, moved, with the true poses; one is made when it is asked for.

    Parameters
    ----------
    test : where model, markers and cameras come from
    motions : rigid motions tunnel_from_model of wing and body
    camera : key of the camera
    sensor : what spoils the images; None leaves them perfect (float64)
    seed : of the noise; that of a frame does not depend on how many frames there are

    Yields
    ------
    (H, W) image and cam_from_model
    """
    world, lens, station = test.shot(WIND_OFF, camera).world, test.cameras[camera], test.cam_from_tunnel[camera]
    rays = Rays.of(lens)
    for k, motion in enumerate(motions):
        image: NDArray[np.generic] = render(world.moved(motion), lens, station, rays=rays).image
        if sensor is not None:
            image = sensor.expose(image, np.random.default_rng([seed, k]), np.random.default_rng([seed]))
        yield image, station @ motion


def swinging(frames: int, *, period: float = 20.0, angle_deg: float = 1.0, shift: float = 4.0) -> list[Pose]:
    """Motions of a model that swings: mostly pitch by ``angle_deg``, and up and down by ``shift`` length units."""
    out = []
    for k in range(frames):
        w = 2 * np.pi * k / period
        turn = np.radians(angle_deg) * np.array([0.12 * np.sin(w), np.sin(w + 0.3), 0.1 * np.cos(w)])
        place = shift * np.array([0.5 * np.sin(w), 0.25 * np.cos(w), np.sin(w + 1.0)])
        out.append(Pose.from_rotvec(turn, place))
    return out


@dataclass(frozen=True)
class WingState:
    """The model at one instant.

    Parameters
    ----------
    tip_fraction, twist_deg : see `motion.flex`
    motion : rigid motion tunnel_from_model
    shaken : camera -> motion of that camera in its own frame: its pose is ``shaken @ cam_from_tunnel``
    mach : of the wind that pressure-sensitive paint feels, see `TransonicFlow`; 0 for wind off
    """

    tip_fraction: float = 0.0
    twist_deg: float = 0.0
    motion: Pose = field(default_factory=Pose.identity)
    shaken: Mapping[str, Pose] = field(default_factory=dict)
    mach: float = 0.0


def deformed_world(test: TunnelTest, state: WingState) -> World:
    """The wind-off world with its wing bent and twisted and the model moved, and with its wind."""
    world, shape = test.shot(WIND_OFF).world, test.shape
    if state.mach:
        world = replace(world, flow=TransonicFlow(shape, state.mach))
    if state.tip_fraction or state.twist_deg:
        world = world.deformed(
            lambda xyz: flex(
                xyz, state.tip_fraction, state.twist_deg, root=shape.body_radius, span=shape.span,
                sweep_deg=shape.sweep_deg, axis_x=0.25 * shape.root_chord,
            )
        )  # fmt: skip
    return world.moved(state.motion)


def deforming_sequence(
    test: TunnelTest,
    states: Iterable[WingState],
    *,
    sensor: Sensor | None = Sensor(),  # noqa: B008 (frozen)
    seed: int = 0,
    cameras: Sequence[str] | None = None,
) -> Iterator[dict[str, NDArray[np.generic]]]:
    """Images of a bending, moving model by the cameras of a test; one set is made when it is asked for.

    Parameters
    ----------
    test : where model, markers and cameras come from
    states : the model at each instant
    sensor : what spoils the images; None leaves them perfect (float64)
    seed : of the noise; that of a frame does not depend on how many frames there are
    cameras : only these; None takes all

    Yields
    ------
    camera -> (H, W) image
    """
    wanted = tuple(test.cameras) if cameras is None else tuple(cameras)
    rays = {name: Rays.of(test.cameras[name]) for name in wanted}
    for k, state in enumerate(states):
        world, images = deformed_world(test, state), {}
        for c, (name, camera) in enumerate(test.cameras.items()):
            if name not in wanted:
                continue
            station = test.cam_from_tunnel[name]
            if name in state.shaken:
                station = state.shaken[name] @ station
            image: NDArray[np.generic] = render(world, camera, station, rays=rays[name]).image
            if sensor is not None:
                image = sensor.expose(image, np.random.default_rng([seed, k, c]), np.random.default_rng([seed, c]))
            images[name] = image
        yield images
