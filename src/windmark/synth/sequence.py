"""Images of a moving model: the virtual wind tunnel frame by frame."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Pose
from windmark.synth.degrade import Sensor
from windmark.synth.render import render
from windmark.synth.screen import Rays
from windmark.synth.tunnel import WIND_OFF, TunnelTest

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
