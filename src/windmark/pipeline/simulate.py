"""A synthetic test as files: what a user would have, and beside it the truth that a user never has."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from windmark import io
from windmark.pipeline.simulate_taps import write_taps
from windmark.scene import Mesh
from windmark.synth import Sensor, Shot, TunnelTest, degrade, wind_tunnel

RADIUS_PX = 4.0
"""Radius of the default test's markers in its images, as an engineer would read it off a picture."""

_PROJECT = """\
# A synthetic test of windmark's virtual wind tunnel (seed {seed}). The folder truth/ holds what a real test
# never knows; nothing here reads it.
title = "Virtual wind tunnel, seed {seed}"
length_unit = "mm"

[[camera]]
file = "camera.json"

{images}
# The model moves between the images and the walls do not, so the pose is found from the model's markers alone.
[markers]
file = "markers.csv"
roles = ["model"]

[grid]
file = "model.grid"
volumes = {{ {volumes} }}

[detect]
radius_px = {radius}

[[view]]
name = "top"
direction = [0, 0, -1]
up = [0, 1, 0]

[[section]]
name = "mid-span"
point = [0, 350, 0]
normal = [0, 1, 0]

[align]
reference = "wind-off"
"""


def simulate(folder: Path, seed: int) -> TunnelTest:
    """Make the default virtual test and write it into ``folder`` (existing, empty or not).

    Files: project.toml, camera.json (interior parameters, no pose), markers.csv, model.grid (PLOT3D),
    wind-off.tif, wind-on.tif, taps.tgts and taps.csv (pressure taps), and truth/.
    """
    test = wind_tunnel(seed)
    io.write_camera(folder / "camera.json", test.cameras["cam1"])
    io.write_markers(folder / "markers.csv", test.markers, length_unit="mm")
    io.write_mesh(folder / "model.grid", test.mesh)
    write_taps(folder, test.shape)
    truth = folder / "truth"
    truth.mkdir(exist_ok=True)
    for shot in test.shots:
        io.write_image(folder / f"{shot.view.frame}.tif", shot.image)
        _write_truth(truth, test, shot)
    images = "\n".join(f'[[image]]\nfile = "{shot.view.frame}.tif"\n' for shot in test.shots)
    volumes = ", ".join(f"{name} = {zones}" for name, zones in zones_of(test.mesh).items() if name != "wall")
    text = _PROJECT.format(seed=seed, images=images, radius=RADIUS_PX, volumes=volumes)
    with io.atomic_write(folder / "project.toml") as stream:
        stream.write(text)
    return test


def zones_of(mesh: Mesh) -> dict[str, list[str]]:
    """The zones of the grid file that make up each volume (PLOT3D files number their zones, they have no names)."""
    zones: dict[str, list[str]] = {}
    for number, block in enumerate(mesh.blocks, start=1):
        mine = (mesh.triangles[:, 0] >= block.first) & (mesh.triangles[:, 0] < block.first + block.size)
        zones.setdefault(str(mesh.volume[mine][0]), []).append(f"zone{number:02d}")
    return zones


def _write_truth(truth: Path, test: TunnelTest, shot: Shot) -> None:
    """Markers' images, the pose and the noise-free grey levels of the nodes."""
    name, markers = shot.view.frame, shot.perfect.markers
    columns = {
        "name": test.markers.name, "x": markers.xy[:, 0], "y": markers.xy[:, 1],
        "ellipse_x": markers.ellipse_xy[:, 0], "ellipse_y": markers.ellipse_xy[:, 1],
        "visible": markers.visible.astype(int),
    }  # fmt: skip
    io.write_table(truth / f"{name}-markers.csv", columns)
    io.write_camera(truth / f"{name}-camera.json", shot.perfect.camera, shot.view.cam_from_model, unit="mm")
    levels = true_levels(shot, Sensor())
    io.write_nodes_csv(truth / f"{name}-nodes.csv", test.mesh, {"value": levels}, units={"value": "grey level"})


def true_levels(shot: Shot, sensor: Sensor) -> np.ndarray:
    """(V,) noise-free grey level of every node of the mesh in this image, lens shading included, dirt and markers not.

    Given for hidden nodes too (what they would show if nothing were before them); NaN out of the image.
    """
    camera = shot.perfect.camera
    xy, _ = camera.project(shot.perfect.cam_from_tunnel.apply(shot.world.mesh.vertices))
    shading = degrade.vignette(np.ones(camera.size_px[::-1]), sensor.vignetting)
    inside = camera.in_image(xy)
    column, row = np.minimum(np.round(xy[inside]).astype(int), np.array(camera.size_px) - 1).T
    full = 2.0**sensor.bits - 1 - sensor.black
    levels = np.full(len(xy), np.nan)
    levels[inside] = sensor.black + full * sensor.exposure * (
        shot.world.node_intensity()[inside] * shading[row, column]
    )
    return levels
