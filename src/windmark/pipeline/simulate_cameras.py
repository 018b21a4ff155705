"""A synthetic test of several cameras as files: one picture each at the same moment, to be merged on the surface."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from windmark import io
from windmark.errors import UsageError
from windmark.geometry import Pose
from windmark.pipeline.simulate import RADIUS_PX, true_levels, zones_of
from windmark.pipeline.simulate_taps import write_taps
from windmark.scene import View
from windmark.synth import WIND_OFF, Rays, Sensor, Shot, TunnelTest, default_stations, wind_tunnel
from windmark.synth.tunnel import exposed

MOST = 5
"""Cameras that see the upper side; the next one would look along the wing."""
EXPOSURES = (0.55, 0.36, 0.62, 0.45, 0.29)
"""Share of full scale that unit light gives: every camera has another gain."""

_PROJECT = """\
# A synthetic test of {count} cameras round one model (seed {seed}): one picture each at the same moment, every camera
# with a gain of its own. The folder truth/ holds what a real test never knows; nothing here reads it.
title = "{count} cameras round one model, seed {seed}"
length_unit = "mm"

{cameras}
# The cameras do not move against each other (rig.json, as windmark calibrate --rig writes it), and their pictures are
# of one instant: they are registered together. Their poses to the model are found from its markers.
[rig]
file = "rig.json"

[markers]
file = "markers.csv"
roles = ["model"]

[grid]
file = "model.grid"
volumes = {{ {volumes} }}

[detect]
radius_px = {radius}

# All images of one time point on one surface. Images of several points need point = "..." each.
[merge]
black = {black}

[[view]]
name = "top"
direction = [0, 0, -1]
up = [0, 1, 0]

[[points]]
file = "taps.tgts"

[[line]]
name = "mid-span"
start = [{start}]
end = [{end}]
spacing = 1.0
normal = [0, 1, 0]
"""


def camera_shots(seed: int, count: int, *, size_px: tuple[int, int] = (1280, 1024), nodes: int = 60_000,
                 sensor: Sensor | None = None, clutter: bool = True) -> TunnelTest:  # fmt: skip
    """The default test without wind, seen by several cameras; the pictures are free of the lenses' shading.

    Parameters
    ----------
    seed, count : of everything random; how many cameras (2 to `MOST`)
    size_px, nodes, clutter : of the pictures, the grid and dirt on the model
    sensor : of all cameras, each with its own exposure from `EXPOSURES`; flat-fielded by default

    Raises
    ------
    ValueError
        For fewer than two cameras or more than `MOST`.
    """
    if not 2 <= count <= MOST:
        raise UsageError(f"cameras: expected 2 to {MOST}, got {count}")
    sensor = Sensor(vignetting=0.0) if sensor is None else sensor
    stations = default_stations(np.random.default_rng([seed, 4]), count, size_px)
    options = {} if clutter else {"clutter": None}
    test = wind_tunnel(seed, stations=stations[:1], sensor=None, nodes=nodes, **options)  # type: ignore[arg-type]
    world = test.shot().world
    shots, cameras, poses = [], {}, {}
    for c, (camera, pose) in enumerate(stations):
        key = f"cam{c + 1}"
        expose = partial(exposed, replace(sensor, exposure=EXPOSURES[c]), seed, c, 0)
        view = View(f"{key}-{WIND_OFF}", key, WIND_OFF, pose)
        shots.append(Shot(view, world, camera, pose, partial(Rays.of, camera), expose))
        cameras[key], poses[key] = camera, pose
    return replace(test, cameras=cameras, cam_from_tunnel=poses, shots=tuple(shots))


def simulate_cameras(folder: Path, seed: int, count: int, *, size_px: tuple[int, int] = (1280, 1024),
                     nodes: int = 60_000) -> TunnelTest:  # fmt: skip
    """Make a test of several cameras and write it into ``folder`` (existing, empty or not).

    Files: project.toml, cam1.json, ... (interior parameters, no pose), rig.json (their places to the first one),
    cam1.tif, ..., markers.csv, model.grid (PLOT3D), taps.tgts, taps.csv, and truth/.

    Raises
    ------
    ValueError
        For fewer than two cameras or more than `MOST`.
    """
    test = camera_shots(seed, count, size_px=size_px, nodes=nodes)
    io.write_markers(folder / "markers.csv", test.markers, length_unit="mm")
    io.write_mesh(folder / "model.grid", test.mesh)
    write_taps(folder, test.shape)
    first, *others = test.cam_from_tunnel
    beside = {n: test.cam_from_tunnel[n] @ test.cam_from_tunnel[first].inverse() for n in others}
    io.write_rig(folder / "rig.json", {first: Pose.identity(), **beside}, unit="mm")
    truth = folder / "truth"
    truth.mkdir(exist_ok=True)
    parts = []
    for c, shot in enumerate(test.shots):
        name = shot.view.camera
        io.write_camera(folder / f"{name}.json", test.cameras[name])
        io.write_image(folder / f"{name}.tif", shot.image)
        io.write_camera(truth / f"{name}-camera.json", test.cameras[name], shot.view.cam_from_model, unit="mm")
        levels = true_levels(shot, Sensor(vignetting=0.0, exposure=EXPOSURES[c]))
        io.write_nodes_csv(truth / f"{name}-nodes.csv", test.mesh, {"value": levels}, units={"value": "grey level"})
        parts.append(f'[[camera]]\nname = "{name}"\nfile = "{name}.json"\n\n'
                     f'[[image]]\nfile = "{name}.tif"\ncamera = "{name}"\n')  # fmt: skip
    volumes = ", ".join(f"{name} = {zones}" for name, zones in zones_of(test.mesh).items() if name != "wall")
    start, end = _chord(test)
    text = _PROJECT.format(count=count, seed=seed, cameras="\n".join(parts), volumes=volumes,
                           radius=RADIUS_PX * size_px[0] / 1280, black=Sensor().black, start=start,
                           end=end)  # fmt: skip
    with io.atomic_write(folder / "project.toml") as stream:
        stream.write(text)
    return test


def _chord(test: TunnelTest) -> tuple[str, str]:
    """Two points near the leading and the trailing edge on the upper side at y = 350."""
    patch = test.shape.patches()["wing_upper"]
    t = (350.0 - test.shape.wing_root) / (test.shape.span - test.shape.wing_root)
    xyz, _ = patch.place([0.1, 0.95], [t, t])
    first, last = (", ".join(f"{v:.3f}" for v in p) for p in xyz)
    return first, last
