"""A synthetic infrared run as files: pictures of a model that heats up, calibrations, the projects, and the truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.pipeline.simulate import zones_of
from windmark.pipeline.simulate_deforming import axis_point, point_text
from windmark.synth.heated import HeatedTest, heated_test
from windmark.synth.heating import SolidWall
from windmark.synth.thermal_camera import EVEN_K, KELVIN_PER_COUNT, BAND_um

Array = NDArray[np.float64]

POINTS_Y, POINTS_CHORD = (178.0, 317.0, 503.0), (0.24, 0.74)
"""Places of the points whose histories the project asks for: y in mm, part of the chord."""
EVEN_FRAMES = 8
EMISSIVITY_SIGMA, SURROUNDINGS_SIGMA_K, WALL_SIGMA = 0.005, 0.5, 0.01
"""What is known of the surface and the walls: the project's numbers are so far off the truth (1 sigma)."""

_PROJECT = """\
# A synthetic infrared run of windmark's virtual wind tunnel (seed {seed}): a swept wing that moves, bends and heats up
# before two infrared cameras. The folder truth/ holds what a real test never knows; nothing here reads it.
title = "Heated wing, seed {seed}"
length_unit = "mm"

# This camera's numbers are temperatures of a black body, as makers' software exports them.
[[camera]]
name = "cam1"
file = "cam1.json"
images = "images/cam1-*.tif"
quantity = "temperature"
unit = "K"
scale = {scale}
band_um = [{low:g}, {high:g}]
even = ["calibration/cold-cam1-*.tif", "calibration/warm-cam1-*.tif"]

# This one's are counts, calibrated by a table of black bodies.
[[camera]]
name = "cam2"
file = "cam2.json"
images = "images/cam2-*.tif"
quantity = "counts"
black_bodies = "calibration/black-bodies-cam2.csv"
even = ["calibration/cold-cam2-*.tif", "calibration/warm-cam2-*.tif"]

# Plugs that look warmer than the model.
[markers]
file = "markers.csv"

[grid]
file = "model.grid"
volumes = {{ {volumes} }}

[look]
radius_px = {radius}
polarity = "bright"

# The model's parts and how they deform: the same laws as for windmark deform.
[[volume]]
name = "body"

[[volume]]
name = "wing"
parent = "body"
law = "beam"
options = {{ root = [{root}], tip = [{tip}], section = [0, 1, 0] }}

# When the frames were; those without wind also correct the markers' places.
[sequence]
frames = "frames.csv"
zero = [{zeros}]

[surface]
emissivity = {emissivity}
emissivity_sigma = {emissivity_sigma:g}
surroundings_K = {surroundings}
surroundings_sigma_K = {surroundings_sigma:g}

[heat]
start_s = {start:g}

{walls}
[[points]]
file = "points.csv"

[output]
folder = "infrared"
every = {every}
"""

_WALL = '[[wall]]\nvolumes = ["{0}"]\nback = "{1}"\nrelative_sigma = {2:g}\n{3}'
_LAYER = """\
[[wall.layer]]
thickness_mm = {0:g}
conductivity_W_mK = {1:.5g}
density_kg_m3 = {2:g}
heat_J_kgK = {3:.6g}
"""
_DENSITY = 1000.0

_RUN_PROJECT = """\
# Two frames of the infrared run as pictures of temperature on the grid: windmark run.
title = "Heated wing, two frames, seed {seed}"
length_unit = "mm"

[[camera]]
file = "cam1.json"

{images}
[markers]
file = "markers.csv"
roles = ["model"]

[grid]
file = "model.grid"
volumes = {{ {volumes} }}

[detect]
polarity = "auto"  # dark markers are not there, so the bright ones are taken; radius and polarity are said

[[view]]
name = "top"
direction = [0, 0, -1]
up = [0, 1, 0]
"""

_IMAGE = """\
[[image]]
name = "{name}"
file = "images/cam1-{frame:04d}.tif"
quantity = "temperature"
unit = "K"
scale = {scale}
"""


def simulate_infrared(
    folder: Path, seed: int, frames: int = 40, size_px: tuple[int, int] = (640, 512)
) -> HeatedTest:
    """Make an infrared run and write it into ``folder`` (existing, empty or not).

    Files: infrared.toml, project.toml (its first and last frame for `windmark run`), cam1.json and cam2.json (with
    poses), markers.csv, model.grid, frames.csv (times), points.csv, images/, calibration/ (black bodies), and truth/
    (temperature and heat flux at the nodes of every frame, states, what the project's numbers really are).

    Raises
    ------
    ValueError
        For fewer frames than there are without wind and one.
    """
    test = heated_test(seed, frames=frames, size_px=size_px)
    for name, camera in test.test.cameras.items():
        io.write_camera(folder / f"{name}.json", camera, test.test.cam_from_tunnel[name], unit="mm")
    io.write_markers(folder / "markers.csv", test.test.markers, length_unit="mm")
    io.write_mesh(folder / "model.grid", test.mesh)
    io.write_table(folder / "frames.csv", {"frame": np.arange(frames), "time_s": np.round(test.times, 6)})
    _write_points(folder, test)
    (folder / "images").mkdir(exist_ok=True)
    for k, name, picture in test.pictures():
        io.write_image(folder / "images" / f"{name}-{k:04d}.tif", picture)
    _write_calibration(folder / "calibration", test)
    _write_truth(folder / "truth", test)
    _write_projects(folder, test, size_px)
    return test


def _write_points(folder: Path, test: HeatedTest) -> None:
    """Six points on the wing's upper side, between the markers."""
    shape = test.test.shape
    y, chord = np.repeat(POINTS_Y, len(POINTS_CHORD)), np.tile(POINTS_CHORD, len(POINTS_Y))
    t = (y - shape.wing_root) / (shape.span - shape.wing_root)
    xyz, normal = shape.patches()["wing_upper"].place(np.arccos(1 - 2 * chord) / np.pi, t)
    io.write_table(folder / "points.csv", {
        "name": np.array([f"P{a:.0f}-{100 * c:.0f}" for a, c in zip(y, chord, strict=True)]),
        **{a: np.round(xyz[:, k], 4) for k, a in enumerate("xyz")},
        **{f"n{a}": np.round(normal[:, k], 6) for k, a in enumerate("xyz")}, "volume": np.full(len(y), "wing"),
    })  # fmt: skip


def _write_calibration(folder: Path, test: HeatedTest) -> None:
    """Even pictures of two black bodies, and the table of the camera that counts."""
    folder.mkdir(exist_ok=True)
    for c, (name, camera) in enumerate(test.cameras.items()):
        rng = np.random.default_rng([test.seed, 61, c])
        for kind, kelvin in zip(("cold", "warm"), EVEN_K, strict=True):
            for k in range(EVEN_FRAMES):
                io.write_image(folder / f"{kind}-{name}-{k}.tif", camera.even(kelvin, rng))
        if camera.kind == "counts":
            rows = np.array(list(camera.calibration(np.linspace(280, 330, 11), rng)))
            io.write_table(folder / f"black-bodies-{name}.csv", {
                "temperature_K": rows[:, 0], "counts": np.round(rows[:, 1], 3), "sigma": np.round(rows[:, 2], 4),
            })  # fmt: skip


def _write_truth(folder: Path, test: HeatedTest) -> None:
    folder.mkdir(exist_ok=True)
    for k in range(len(test.states)):
        t, q = test.node_truth(k)
        io.write_nodes_netcdf(folder / f"{k}.nc", test.mesh, {"temperature": t, "heat_flux": q},
                              units={"temperature": "K", "heat_flux": "W/m2", "length": "mm"})  # fmt: skip
    states = test.states
    io.write_table(folder / "states.csv", {
        "frame": np.arange(len(states)), "time_s": test.times,
        "tip_fraction": np.array([s.tip_fraction for s in states]),
        "twist_deg": np.array([s.twist_deg for s in states]),
        **{a: np.array([s.motion.translation[i] for s in states]) for i, a in enumerate("xyz")},
    })  # fmt: skip
    io.write_json(folder / "surface.json", {
        "emissivity": test.surface.emissivity, "index": test.surface.index, "surroundings_K": test.heating.cold_K,
        "start_s": test.heating.start_s,
        "walls": {n: [list(layer) for layer in wall.layers] for n, wall in test.heating.walls.items()},
    })  # fmt: skip


def _write_projects(folder: Path, test: HeatedTest, size_px: tuple[int, int]) -> None:
    """The projects; what they say of surface and walls is off the truth as much as its sigma says."""
    rng, shape = np.random.default_rng([test.seed, 62]), test.test.shape
    volumes = ", ".join(f"{name} = {zones}" for name, zones in zones_of(test.mesh).items() if name != "wall")
    walls = [_wall(name, wall, 1 + WALL_SIGMA * rng.standard_normal()) for name, wall in test.heating.walls.items()]
    still = [k for k, t in enumerate(test.times) if t <= test.heating.start_s]
    text = _PROJECT.format(
        seed=test.seed, scale=KELVIN_PER_COUNT, low=BAND_um[0], high=BAND_um[1], volumes=volumes,
        radius=round(2.5 / 640.0 * size_px[0], 1), root=point_text(axis_point(shape, shape.body_radius)),
        tip=point_text(axis_point(shape, shape.span)), zeros=", ".join(f'"{k}"' for k in still[:3]),
        emissivity=round(test.surface.emissivity * (1 + EMISSIVITY_SIGMA * rng.standard_normal()), 4),
        emissivity_sigma=EMISSIVITY_SIGMA, surroundings_sigma=SURROUNDINGS_SIGMA_K,
        surroundings=round(test.heating.cold_K + SURROUNDINGS_SIGMA_K * rng.standard_normal(), 2),
        start=test.heating.start_s, walls="\n".join(walls), every=max(len(test.states) // 20, 1),
    )  # fmt: skip
    with io.atomic_write(folder / "infrared.toml") as stream:
        stream.write(text)
    last = len(test.states) - 1
    shown = (("early", 0), ("late", last))
    images = "\n".join(_IMAGE.format(name=name, frame=k, scale=KELVIN_PER_COUNT) for name, k in shown)
    with io.atomic_write(folder / "project.toml") as stream:
        stream.write(_RUN_PROJECT.format(seed=test.seed, images=images, volumes=volumes))


def _wall(volume: str, wall: SolidWall, factor: float) -> str:
    """A wall of a project file, its effusivities off by a factor; a single thick layer counts as semi-infinite."""
    layers = "".join(
        _LAYER.format(1e3 * thickness, conductivity * factor, _DENSITY, capacity * factor / _DENSITY)
        for thickness, conductivity, capacity in wall.layers
    )
    return _WALL.format(volume, "semi-infinite" if len(wall.layers) == 1 else "adiabatic", WALL_SIGMA, layers)
