"""A whole virtual wind-tunnel test: the model wind-off and wind-on before one or more cameras, with its truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial

import numpy as np
from numpy.typing import NDArray

from windmark.errors import UsageError
from windmark.geometry import Camera, Pose, surface_curvature
from windmark.scene import MarkerSet, Mesh, View
from windmark.synth.decals import Decals
from windmark.synth.degrade import Sensor
from windmark.synth.layout import rows_layout
from windmark.synth.marks import Clutter
from windmark.synth.motion import bend
from windmark.synth.paint import Paint, TransonicFlow
from windmark.synth.patch import Patch
from windmark.synth.render import Rendering, render
from windmark.synth.screen import Rays
from windmark.synth.wing import HalfModel
from windmark.synth.world import World

Array = NDArray[np.float64]
Layout = Callable[[HalfModel, Mapping[str, Patch], np.random.Generator], MarkerSet]

WIND_OFF, WIND_ON = "wind-off", "wind-on"
_LAMPS = [(-350.0, 950.0, 1500.0, 1.9e6), (800.0, 100.0, 1250.0, 0.8e6)]
_LEVELS = {"wing": 1.0, "body": 0.9, "wall": 0.42}
_TARGET = np.array([205.0, 290.0, 0.0])


@dataclass(frozen=True)
class Shot:
    """One image and everything that is true of it. The image is made when it is asked for.

    Parameters
    ----------
    view : name, camera and frame keys, and the true cam_from_model
    world : where model and markers were, in the tunnel's frame
    camera, cam_from_tunnel : of the station
    rays : gives `Rays.of` the camera
    expose : what a sensor makes of a perfect image; None where there is none
    """

    view: View
    world: World
    camera: Camera
    cam_from_tunnel: Pose
    rays: Callable[[], Rays]
    expose: Callable[[Array], NDArray[np.generic]] | None = None

    @cached_property
    def perfect(self) -> Rendering:
        """The noise-free rendering: intensity, triangle and depth per pixel, truth of every marker."""
        return render(self.world, self.camera, self.cam_from_tunnel, rays=self.rays())

    @cached_property
    def image(self) -> NDArray[np.generic]:
        """(H, W) uint8 or uint16, what the camera delivers; float64 where there is no sensor."""
        return self.perfect.image if self.expose is None else self.expose(self.perfect.image)


@dataclass(frozen=True)
class TunnelTest:
    """A virtual test. The mesh and the markers are those of the wind-off state, as a user would have them.

    Parameters
    ----------
    mesh, markers : in the model's frame, which is the tunnel's when the wind is off
    cameras : true cameras by key
    cam_from_tunnel : true stations by key
    shots : wind-off and wind-on of each camera
    tunnel_from_model : the true rigid motion from wind-off to wind-on
    shape : the half model
    """

    mesh: Mesh
    markers: MarkerSet
    cameras: Mapping[str, Camera]
    cam_from_tunnel: Mapping[str, Pose]
    shots: tuple[Shot, ...]
    tunnel_from_model: Pose
    shape: HalfModel

    def shot(self, frame: str = WIND_OFF, camera: str = "cam1") -> Shot:
        """The shot of a frame ("wind-off" or "wind-on") by a camera."""
        for s in self.shots:
            if s.view.frame == frame and s.view.camera == camera:
                return s
        raise ValueError(f"TunnelTest.shot: no shot of frame {frame!r} by camera {camera!r}")


def wind_tunnel(
    seed: int = 0,
    *,
    size_px: tuple[int, int] = (1280, 1024),
    stations: Sequence[tuple[Camera, Pose]] | int = 1,
    sensor: Sensor | None = Sensor(),  # noqa: B008 (frozen)
    clutter: Clutter | None = Clutter(),  # noqa: B008 (frozen)
    layout: Layout = rows_layout,
    shape: HalfModel = HalfModel(),  # noqa: B008 (frozen)
    nodes: int = 60_000,
    motion: Pose | None = None,
    tip_fraction: float = 0.0,
    twist_deg: float = 0.0,
    mach: float = 0.8,
    unevenness: float = 0.03,
    grain: float = 0.01,
    clearance: float = 3.0,
    paint: Paint | None = None,
    marker_contrast: float = 0.85,
) -> TunnelTest:
    """Make a test: same seed and options, same bytes.

    Parameters
    ----------
    seed : draws the layout, the paint, the dirt, the stations and the noise, each from its own stream
    size_px : image size of the default cameras
    stations : (camera, cam_from_tunnel) of each camera, or the number of default cameras (`default_stations`)
    sensor : what spoils the images; None leaves them perfect (float64)
    clutter : dirt painted on model and floor; None for a clean model
    layout : (shape, patches, rng) -> MarkerSet
    shape, nodes : the half model and the size of its mesh
    motion : rigid motion of wing and body from wind-off to wind-on; by default 0.5 degree of pitch
        and about 2 mm
    tip_fraction, twist_deg : bending of the wing under wind, see `motion.bend`
    mach, unevenness, grain : see `TransonicFlow` and `Paint.random`
    clearance : dirt keeps this many marker radii from every marker's centre
    paint : coating and lamps instead of the default ones (``unevenness`` and ``grain`` do nothing then)
    marker_contrast : see `World`; negative for markers that shine more than what is round them

    Returns
    -------
    TunnelTest
    """
    if paint is None:
        paint = Paint.random(_stream(seed, 2), _LEVELS, _LAMPS, unevenness=unevenness, grain=grain)
    still = replace(_scene(seed, shape, nodes, layout, paint, clutter, clearance), marker_contrast=marker_contrast)
    motion = _default_motion(shape) if motion is None else motion
    blown = _under_wind(still, shape, motion, tip_fraction, twist_deg, mach)
    if isinstance(stations, int):
        stations = default_stations(_stream(seed, 4), stations, size_px)
    shots: list[Shot] = []
    for c, (camera, pose) in enumerate(stations):
        rays = cache(partial(Rays.of, camera))
        for f, (frame, world) in enumerate(((WIND_OFF, still), (WIND_ON, blown))):
            view = View(f"{_key(c)}-{frame}", _key(c), frame, pose @ world.tunnel_from_model)
            expose = None if sensor is None else partial(exposed, sensor, seed, c, f)
            shots.append(Shot(view, world, camera, pose, rays, expose))
    cameras = {_key(c): camera for c, (camera, _) in enumerate(stations)}
    poses = {_key(c): pose for c, (_, pose) in enumerate(stations)}
    return TunnelTest(still.mesh, still.markers, cameras, poses, tuple(shots), motion, shape)


def exposed(sensor: Sensor, seed: int, camera: int, frame: int, perfect: Array) -> NDArray[np.generic]:
    """What a sensor makes of a frame by a camera; the sensor's own pattern is the same in all frames."""
    return sensor.expose(perfect, _stream(seed, 5, camera, frame), _stream(seed, 6, camera))


def default_stations(
    rng: np.random.Generator, count: int = 1, size_px: tuple[int, int] = (1280, 1024)
) -> list[tuple[Camera, Pose]]:
    """Cameras with real lenses above the wing: the first looks down, the others from alternating sides.

    Lens, distance and field are those of a 1280 px camera of 34 degrees at 1.45 m; other widths keep
    the field. Lenses and stations differ a little from draw to draw.
    """
    if count < 1:
        raise UsageError(f"default_stations: count must be at least 1, got {count}")
    width, height = size_px
    scale = width / 1280
    out = []
    for k in range(count):
        side = 0.0 if k == 0 else np.radians(28.0 * ((k + 1) // 2) * (1 if k % 2 else -1))
        d = rng.uniform(-1, 1, 6)
        eye = _TARGET + 1450 * np.array([np.sin(side) - 0.08, 0.2, np.cos(side)]) + 25 * d[:3]
        camera = Camera(
            size_px, 2090 * scale * (1 + 0.004 * d[3]), 1.0005, (width - 1) / 2 + 8.3 * scale,
            (height - 1) / 2 - 6.7 * scale, k1=-0.118 + 0.004 * d[4], k2=0.085, p1=4e-4, p2=-3e-4,
        )  # fmt: skip
        out.append((camera, Pose.look_at(eye, _TARGET, [0.05 + 0.03 * d[5], 1.0, 0.0])))
    return out


def _stream(seed: int, *key: int) -> np.random.Generator:
    """A generator of its own for each purpose, so that one option does not change the draws of another."""
    return np.random.default_rng([seed, *key])


def _key(camera: int) -> str:
    return f"cam{camera + 1}"


def _scene(
    seed: int, shape: HalfModel, nodes: int, layout: Layout, paint: Paint, clutter: Clutter | None, clearance: float
) -> World:
    """The wind-off world."""
    patches = shape.patches(nodes)
    markers = layout(shape, patches, _stream(seed, 1))
    if not len(markers):
        raise UsageError("wind_tunnel: layout must give at least one marker")
    mesh = shape.mesh(nodes)
    form = surface_curvature(mesh.vertices, mesh.triangles, markers.xyz, markers.normal, markers.radius)
    markers = replace(markers, curvature=form)
    world = World(mesh, markers, paint)
    if clutter is None:
        return world
    radius = float(np.median(markers.radius))
    return replace(world, dirt=_dirt(patches, clutter, markers, radius, clearance, _stream(seed, 3)))


def _default_motion(shape: HalfModel) -> Pose:
    """Half a degree of pitch (nose up) about the wing root's middle, and about 2 mm of shift."""
    pivot = np.array([0.5 * shape.root_chord, 0.0, 0.0])
    turn = Pose.from_rotvec(np.radians([0.06, 0.5, -0.04]), np.zeros(3))
    return Pose(turn.rotation, pivot - turn.rotation @ pivot + np.array([0.7, 0.25, 1.9]))


def _under_wind(
    still: World, shape: HalfModel, motion: Pose, tip_fraction: float, twist_deg: float, mach: float
) -> World:
    world = replace(still, flow=TransonicFlow(shape, mach))
    if tip_fraction or twist_deg:
        world = world.deformed(
            lambda xyz: bend(
                xyz, tip_fraction, twist_deg, root=shape.body_radius, span=shape.span, sweep_deg=shape.sweep_deg,
                axis_x=0.25 * shape.root_chord,
            )
        )  # fmt: skip
    return world.moved(motion)


def _dirt(
    patches: Mapping[str, Patch], what: Clutter, markers: MarkerSet, radius: float, clearance: float,
    rng: np.random.Generator,
) -> Decals:  # fmt: skip
    """Clutter at random places of the upper wing, the body's upper half and the floor, clear of the markers."""
    names, share = ("wing_upper", "body", "floor"), (0.6, 0.15, 0.25)
    parts = []
    for item in what.items(rng, radius):
        reach = float((np.linalg.norm(item.center, axis=1) + item.reach).max())
        for _ in range(30):
            patch = patches[names[rng.choice(3, p=share)]]
            s, t = rng.uniform(0.08, 0.92), rng.uniform(0.1, 0.9) * (0.45 if patch.name == "body" else 1.0)
            xyz, normal = patch.place([s], [t])
            turned = item.turned(rng.uniform(0, 2 * np.pi), np.zeros(2))
            if np.linalg.norm(markers.xyz - xyz[0], axis=1).min() >= reach + clearance * radius:
                parts.append(Decals.on_surface(turned, xyz[0], normal[0], patch.volume))
                break
    return Decals.join(parts)
