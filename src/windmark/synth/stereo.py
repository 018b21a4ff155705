"""A deformation test: a swept wing with many markers before two cameras 60 degrees apart."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from windmark.geometry import Camera, Pose
from windmark.scene import MarkerSet
from windmark.synth.layout import rows_layout
from windmark.synth.patch import Patch
from windmark.synth.tunnel import TunnelTest, wind_tunnel
from windmark.synth.wing import HalfModel

TARGET = (225.0, 330.0, 10.0)
"""What the cameras look at (mm): the middle of the wing."""
DISTANCE, FIELD = 1045.0, 640.0
"""Of the cameras from the wing, and the width of their field there (mm)."""


def stereo_layout(shape: HalfModel, patches: Mapping[str, Patch], rng: np.random.Generator) -> MarkerSet:
    """55 markers on the wing, 5 on the body, 72 on the floor, of which each camera sees some 25."""
    return rows_layout(
        shape, patches, rng, upper=(11, 5), lower=(0, 0), body=5, floor=(9, 8), side=0, jitter=4.0, radius=2.5
    )


def stereo_stations(size_px: tuple[int, int] = (1280, 800), angle_deg: float = 60.0) -> list[tuple[Camera, Pose]]:
    """Two cameras with real lenses, upstream and downstream of the wing; 0.5 mm per pixel at 1280 px."""
    target, out = np.array(TARGET), []
    width, height = size_px
    for sign in (-1, 1):
        lean = np.radians(0.5 * angle_deg) * sign
        eye = target + DISTANCE * np.array([np.sin(lean), 0.0, np.cos(lean)])
        camera = Camera(
            size_px,
            DISTANCE / FIELD * width,
            1.0003,
            width / 2 + 5,
            height / 2 - 4,
            k1=-0.1,
            k2=0.05,
            p1=2e-4,
            p2=-1e-4,
        )
        out.append((camera, Pose.look_at(eye, target, [1.0, 0.0, 0.0])))
    return out


def stereo_wing(seed: int = 0, *, size_px: tuple[int, int] = (1280, 800), **options: Any) -> TunnelTest:
    """The wind-off test, clean; options are those of `wind_tunnel`. Its own wind-on state is not meant to be used."""
    return wind_tunnel(seed, stations=stereo_stations(size_px), layout=stereo_layout, clutter=None, **options)
