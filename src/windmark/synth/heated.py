"""A virtual infrared run: a wing that moves, bends and heats up before two infrared cameras, with its truth."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError
from windmark.geometry import Pose
from windmark.scene import Mesh
from windmark.synth.degrade import gaussian_blur
from windmark.synth.heating import COATED_STEEL, RESIN, Heating
from windmark.synth.paint import Flow, Paint
from windmark.synth.render import render
from windmark.synth.screen import Rays
from windmark.synth.sequence import WingState, deformed_world
from windmark.synth.stereo import stereo_wing
from windmark.synth.thermal_camera import ThermalCamera, band_radiance
from windmark.synth.tunnel import TunnelTest

Array = NDArray[np.float64]
Picture = NDArray[np.uint16]

PIVOT = np.array([130.0, 0.0, 0.0])
PLUG = -0.06
"""Contrast of the markers: plugs of a material of higher emissivity, so they look warmer than the model."""


@dataclass(frozen=True)
class WarmSurface(Paint):
    """What a surface sends to one infrared camera, W / (m2 sr) in its band: its own light and what it reflects.

    Parameters
    ----------
    heating : temperatures
    frame : which instant
    eye : (3,) where the camera stands
    emissivity, index : seen straight on; refractive index that makes it fall with the angle
    """

    heating: Heating | None = None
    frame: int = 0
    eye: Array = field(default_factory=lambda: np.zeros(3))
    emissivity: float = 0.9
    index: float = 1.5

    def shine(self, p: Array, n: Array, p0: Array, n0: Array, volume: str, flow: Flow | None) -> Array:
        """See `Paint.shine`."""
        heating = self.heating
        if heating is None:
            raise UsageError("WarmSurface: heating must be given")
        to_eye = self.eye - p
        cosine = np.einsum("nk,nk->n", to_eye, n) / np.linalg.norm(to_eye, axis=1)
        e = self.emissivity_at(np.degrees(np.arccos(np.clip(cosine, 0.0, 1.0))))
        own = band_radiance(heating.temperature(self.frame, p0, n0, volume))
        return np.asarray(e * own + (1 - e) * band_radiance(heating.cold_K))

    def emissivity_at(self, angle_deg: ArrayLike) -> Array:
        """Fresnel's formulas for unpolarised light that leaves an insulator, scaled to the value seen straight on."""
        inside = np.sqrt(self.index**2 - np.sin(np.radians(np.asarray(angle_deg, dtype=float))) ** 2)
        c = np.cos(np.radians(np.asarray(angle_deg, dtype=float)))
        reflected = 0.5 * (((inside - c) / (inside + c)) ** 2
                           + ((self.index**2 * c - inside) / (self.index**2 * c + inside)) ** 2)  # fmt: skip
        return np.asarray(self.emissivity * (1 - reflected) / (1 - ((self.index - 1) / (self.index + 1)) ** 2))


@dataclass(frozen=True)
class HeatedTest:
    """The whole run; `pictures` makes what the cameras deliver.

    Parameters
    ----------
    test : geometry with cameras, markers and the grid at rest
    heating : flux and temperatures
    surface : emissivity; its ``heating`` is the same
    cameras : what each camera does to the light
    states : (F) the model at each instant
    seed : of the noise
    """

    test: TunnelTest
    heating: Heating
    surface: WarmSurface
    cameras: Mapping[str, ThermalCamera]
    states: tuple[WingState, ...]
    seed: int

    @property
    def mesh(self) -> Mesh:
        """The grid at rest, walls and all."""
        return self.test.mesh

    @property
    def times(self) -> Array:
        """(F,) seconds."""
        return np.array(self.heating.times)

    def pictures(self) -> Iterator[tuple[int, str, Picture]]:
        """(frame, camera, picture)."""
        rays = {name: Rays.of(camera) for name, camera in self.test.cameras.items()}
        for k, state in enumerate(self.states):
            world = deformed_world(self.test, state)
            for c, (name, camera) in enumerate(self.cameras.items()):
                pose = self.test.cam_from_tunnel[name]
                seen = replace(world, paint=replace(self.surface, frame=k, eye=pose.inverse().translation))
                light = render(seen, self.test.cameras[name], pose, rays=rays[name], subpixels=5,
                               background=float(band_radiance(self.heating.cold_K))).image  # fmt: skip
                rng = np.random.default_rng([self.seed, 54, c, k])
                yield k, name, camera.expose(gaussian_blur(light, camera.blur_px), rng)

    def node_truth(self, frame: int) -> tuple[Array, Array]:
        """(V,) temperature and heat flux at the nodes; NaN on what is no model."""
        mesh = self.mesh
        t, q = np.full(len(mesh.vertices), np.nan), np.full(len(mesh.vertices), np.nan)
        normals = mesh.vertex_normals()
        for volume in self.heating.walls:
            v = np.unique(mesh.triangles[mesh.volume == volume])
            t[v] = self.heating.temperature(frame, mesh.vertices[v], normals[v], volume)
            q[v] = self.heating.flux(frame, mesh.vertices[v], normals[v], volume)
        return t, q


def heated_test(
    seed: int = 0,
    *,
    frames: int = 40,
    size_px: tuple[int, int] = (640, 512),
    nodes: int = 20_000,
    rate_hz: float = 20.0,
    still_s: float = 0.28,
    bending: float = 0.015,
    vibration: float = 0.3,
    netd_K: float = 0.03,
    unequal_K: float = 0.3,
) -> HeatedTest:
    """Make a test: same seed and options, same bytes.

    Parameters
    ----------
    seed : draws layout, cameras, heat flux, vibration and noise
    frames, rate_hz, still_s : pictures per camera, how many a second, and the time without wind
    size_px, nodes : of the pictures and of the grid
    bending, vibration : rise of the tip under load as part of the span; standard deviation in mm of the model's place
    netd_K, unequal_K : noise of a pixel, and how unequal pixels are, both in kelvin at 300 K
    """
    times = np.arange(frames) / rate_hz
    least = int(still_s * rate_hz) + 3  # two of them with wind
    if frames < least:
        raise UsageError(f"frames: expected at least {least}, some of them with wind, got {frames}")
    paint = Paint.random(np.random.default_rng([seed, 51]), {}, (), unevenness=0.0, grain=0.0)
    test = stereo_wing(seed, size_px=size_px, nodes=nodes, paint=paint, sensor=None, marker_contrast=PLUG)
    rng = np.random.default_rng([seed, 52])
    heating = Heating(test.shape, {"wing": RESIN, "body": COATED_STEEL}, still_s, tuple(times.tolist()),
                      rng.uniform(0.8, 1.3), rng.uniform(0, 2 * np.pi), 303.0 + rng.uniform(-1, 1),
                      288.0 + rng.uniform(-1, 1))  # fmt: skip
    surface = WarmSurface(heating=heating, emissivity=float(rng.uniform(0.86, 0.93)))
    kinds = ("temperature", "counts")
    cameras = {
        name: ThermalCamera.random(np.random.default_rng([seed, 53, c]), size_px, kinds[c % 2], netd_K, unequal_K)
        for c, name in enumerate(test.cameras)
    }
    states = tuple(_state(float(t), still_s, bending, vibration, rng) for t in times)
    return HeatedTest(test, heating, surface, cameras, states, seed)


def _state(time: float, still_s: float, bending: float, vibration: float, rng: np.random.Generator) -> WingState:
    """At rest at first; then the load comes within a third of a second, and the model shakes."""
    shake = vibration * rng.standard_normal(5)
    x = float(np.clip((time - still_s) / 0.35, 0.0, 1.0))
    load = x * x * (3 - 2 * x)
    if not load:
        return WingState()
    turn = Pose.from_rotvec(np.radians([0.1 * load, 0.7 * load, 0.0]), np.zeros(3)).rotation
    motion = Pose(turn, PIVOT - turn @ PIVOT + load * np.array([1.5 + shake[0], 0.5 * shake[1], 4.0 + shake[2]]))
    return WingState(load * bending + shake[3] / 528, load * (-0.6 + 0.1 * shake[4]), motion)
