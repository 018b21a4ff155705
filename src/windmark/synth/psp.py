"""A virtual paint test: a polar of a wing that moves and bends, painted, before two cameras; with its truth."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark.errors import UsageError
from windmark.geometry import Pose
from windmark.scene import MarkerSet, Mesh
from windmark.synth.decals import Decals
from windmark.synth.paint import Paint
from windmark.synth.paint_camera import PaintCamera, Picture
from windmark.synth.polar_flow import PolarFlow
from windmark.synth.pressure_paint import TYPICAL, Air, SensitivePaint, SternVolmer, StillAir
from windmark.synth.render import render
from windmark.synth.screen import Rays
from windmark.synth.sequence import WingState, deformed_world
from windmark.synth.stereo import stereo_wing
from windmark.synth.tunnel import WIND_OFF, TunnelTest
from windmark.synth.world import World

Array = NDArray[np.float64]

LAMPS = ((-350.0, 950.0, 1500.0, 1.9e6), (800.0, 100.0, 1250.0, 0.8e6))
"""Place (mm) and power of each lamp."""
PIVOT = (130.0, 0.0, 0.0)
"""The model turns about it; its reference point for moments."""
_LEVELS = {"wing": 1.0, "body": 0.9, "wall": 0.42}
_WAVES_mm = (400.0, 900.0)
UNEVEN_mm = float(np.sqrt(3 * _WAVES_mm[0] * _WAVES_mm[1]) / (2 * np.pi))
"""Distance over which the wall's temperature keeps about its value: waves of all directions and of these lengths change
along a line as a field with the covariance exp(-d^2 / (2 length^2)) does, 1 / length^2 = mean(|k|^2) / 3."""
_SECONDS = 20.0
"""Of light for a series of pictures."""


@dataclass(frozen=True)
class PspPoint:
    """One point of the polar.

    Parameters
    ----------
    name, alpha_deg : its name and the incidence of the support
    wind, still : the air with wind on and off
    on : the model in each wind-on picture: it vibrates
    off : the model in the wind-off pictures
    lit_s : how long the lamps had been on: wind-off, wind-on
    """

    name: str
    alpha_deg: float
    wind: PolarFlow
    still: StillAir
    on: tuple[WingState, ...]
    off: WingState
    lit_s: tuple[float, float]


@dataclass(frozen=True)
class PspTest:
    """The whole test; `pictures` makes what the cameras deliver.

    Parameters
    ----------
    test : geometry with cameras, markers and the grid at rest
    paint : coating, lamps and its true calibration
    cameras : what each camera does to the light
    taps : places of the pressure taps, at rest
    points : of the polar
    off_frames : wind-off pictures per point and camera
    flicker : relative standard deviation of the lamps from picture to picture
    seed : of the noise
    """

    test: TunnelTest
    paint: SensitivePaint
    cameras: Mapping[str, PaintCamera]
    taps: MarkerSet
    points: tuple[PspPoint, ...]
    off_frames: int
    flicker: float
    seed: int

    @property
    def law(self) -> SternVolmer:
        """The paint's true calibration."""
        return self.paint.law

    @property
    def mesh(self) -> Mesh:
        """The grid at rest, walls and all."""
        return self.test.mesh

    def world(self, state: WingState, air: Air, lit_s: float, lamp_factor: float = 1.0) -> World:
        """What stands in the tunnel at one instant."""
        paint = replace(self.paint, air=air, lit_s=lit_s, lamp_factor=lamp_factor)
        return replace(deformed_world(self.test, state), paint=paint)

    def pictures(self, point: PspPoint) -> Iterator[tuple[str, str, int, Picture]]:
        """("on" or "off", camera, number from 0, picture) of a point; what is made does not depend on other points."""
        number = self.points.index(point)
        rng = np.random.default_rng([self.seed, 21, number])
        lamp = 1 + self.flicker * rng.standard_normal(len(point.on) + self.off_frames)
        rays = {name: Rays.of(camera) for name, camera in self.test.cameras.items()}
        for k, state in enumerate(point.on):
            world = self.world(state, point.wind, point.lit_s[1], lamp[k])
            for c, name in enumerate(self.cameras):
                perfect = render(world, self.test.cameras[name], self.test.cam_from_tunnel[name], rays=rays[name]).image
                yield "on", name, k, self.cameras[name].expose(perfect, self._noise(number, c, 0, k))
        world = self.world(point.off, point.still, point.lit_s[0])
        for c, name in enumerate(self.cameras):
            perfect = render(world, self.test.cameras[name], self.test.cam_from_tunnel[name], rays=rays[name]).image
            for k in range(self.off_frames):
                seen = lamp[len(point.on) + k] * perfect
                yield "off", name, k, self.cameras[name].expose(seen, self._noise(number, c, 1, k))

    def calibration(self, darks: int = 4, flats: int = 16) -> Iterator[tuple[str, str, int, Picture]]:
        """("dark" or "flat", camera, number, picture)."""
        for c, (name, camera) in enumerate(self.cameras.items()):
            for k in range(darks):
                yield "dark", name, k, camera.dark_picture(np.random.default_rng([self.seed, 22, c, k]))
            for k in range(flats):
                yield "flat", name, k, camera.flat(np.random.default_rng([self.seed, 23, c, k]))

    def _noise(self, *key: int) -> np.random.Generator:
        return np.random.default_rng([self.seed, 24, *key])


def psp_test(
    seed: int = 0,
    *,
    incidences: int = 5,
    size_px: tuple[int, int] = (960, 600),
    nodes: int = 20_000,
    taps: MarkerSet | None = None,
    on_frames: int = 3,
    off_frames: int = 3,
    law: SternVolmer = TYPICAL,
    mach: float = 0.8,
    uneven_K: float = 1.0,
    flicker: float = 0.002,
    fading_per_s: float = 2e-5,
    bending: float = 0.02,
    twist_deg: float = -1.0,
    vibration: float = 0.2,
    moves: float = 1.0,
) -> PspTest:
    """Make a test: same seed and options, same bytes.

    Parameters
    ----------
    seed : draws layout, coating, cameras, conditions, wall temperature, vibration and noise
    incidences : points of the polar, from 0 to 4 degrees
    size_px, nodes : of the pictures and of the grid
    taps : pressure taps, seen as dark spots; None for none
    on_frames, off_frames : pictures of each kind per point and camera
    law, mach : of paint and stream
    uneven_K : standard deviation of the wall temperature about recovery, smooth over the model
    flicker, fading_per_s : of lamps and paint, see `PspTest` and `SensitivePaint`
    bending, twist_deg : of the wing at the last point, see `flex`; less at smaller load
    vibration : standard deviation in mm of the model's and the tip's place from picture to picture
    moves : how far the model moves and bends under load, of what is usual; 0: all pictures of a point show it alike
    """
    if incidences < 1:
        raise UsageError(f"incidences: expected at least 1, got {incidences}")
    still = Paint.random(np.random.default_rng([seed, 31]), _LEVELS, LAMPS, unevenness=0.05, grain=0.01)
    test = stereo_wing(seed, size_px=size_px, nodes=nodes, paint=still, sensor=None)
    if taps is not None:
        test = _with_taps(test, taps)
    paint = SensitivePaint.of(still, law, fading_per_s=fading_per_s)
    rng = np.random.default_rng([seed, 32])
    waves, p0, warm = _waves(rng, uneven_K), 1e5 * (1 + 0.01 * rng.uniform(-1, 1)), 303 + 2 * rng.uniform(-1, 1)
    points = []
    for k in range(incidences):
        alpha = 4.0 * k / max(incidences - 1, 1)
        own = np.random.default_rng([seed, 33, k])
        wind = PolarFlow(test.shape, alpha, mach, p0, warm + 0.4 * k / incidences, uneven=waves)
        air = StillAir(0.995e5 * (1 + 0.002 * own.uniform(-1, 1)), 293.5 + 0.3 * own.uniform(-1, 1))
        load = (alpha + 1.5) / 5.5
        on = tuple(_blown(alpha, load, bending, twist_deg, vibration, moves, own) for _ in range(on_frames))
        # First the wind-off pictures of all incidences, then the polar.
        lit = (_SECONDS * k, _SECONDS * (incidences + k))
        points.append(PspPoint(f"p{k + 1:02d}", alpha, wind, air, on, WingState(motion=_pitched(alpha)), lit))
    cameras = {
        name: PaintCamera.random(np.random.default_rng([seed, 34, c]), camera.size_px, (seed, 35, c))
        for c, (name, camera) in enumerate(test.cameras.items())
    }
    taps = MarkerSet.make([], np.zeros((0, 3))) if taps is None else taps
    return PspTest(test, paint, cameras, taps, tuple(points), off_frames, flicker, seed)


def _waves(rng: np.random.Generator, amplitude: float) -> Array:
    """Three long waves and their total standard deviation."""
    k = rng.standard_normal((3, 3))
    k *= 2 * np.pi / (rng.uniform(*_WAVES_mm, 3) * np.linalg.norm(k, axis=1))[:, None]
    size = np.full((3, 1), amplitude * np.sqrt(2 / 3))
    return np.concatenate([k, rng.uniform(0, 2 * np.pi, (3, 1)), size], axis=1)


def _pitched(alpha_deg: float, shift: tuple[float, float, float] = (0.0, 0.0, 0.0), roll_deg: float = 0.0) -> Pose:
    turn = Pose.from_rotvec(np.radians([roll_deg, alpha_deg, 0.0]), np.zeros(3)).rotation
    pivot = np.array(PIVOT)
    return Pose(turn, pivot - turn @ pivot + np.array(shift))


def _blown(
    alpha: float, load: float, bending: float, twist_deg: float, vibration: float, moves: float,
    rng: np.random.Generator,
) -> WingState:  # fmt: skip
    """The model under load in one picture."""
    shake = vibration * rng.standard_normal(4)
    shift = moves * (0.6 + shake[0]), moves * 0.3 * load, moves * (4 * load + shake[1])
    motion = _pitched(alpha + moves * 0.05 * load, shift, moves * 0.1 * load)
    return WingState(moves * (bending * load + shake[2] / 528), moves * (twist_deg * load + 0.1 * shake[3]), motion)


def _with_taps(test: TunnelTest, taps: MarkerSet) -> TunnelTest:
    """The test with its taps as dark holes."""
    holes = Decals.of_markers(taps, 0.9)

    def drilled(world: World) -> World:
        return replace(world, dirt=Decals.join([world.dirt, holes]))

    shots = tuple(replace(s, world=drilled(s.world)) if s.view.frame == WIND_OFF else s for s in test.shots)
    return replace(test, shots=shots)
