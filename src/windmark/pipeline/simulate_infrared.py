"""A synthetic infrared test as files: pictures in hundredths of a kelvin, and beside them the truth."""

from __future__ import annotations

from pathlib import Path

from windmark import io
from windmark.pipeline.simulate import zones_of
from windmark.synth.infrared import KELVIN_PER_COUNT, InfraredTest, infrared_test

_PROJECT = """\
# A synthetic infrared test of windmark's virtual wind tunnel (seed {seed}). The folder truth/ holds what a real test
# never knows; nothing here reads it. The markers are plugs of plaster, which heat up faster than the model.
title = "Virtual infrared test, seed {seed}"
length_unit = "mm"

[[camera]]
file = "camera.json"

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
file = "{name}.tif"
quantity = "temperature"
unit = "K"
scale = {scale}
"""


def simulate_infrared(folder: Path, seed: int) -> InfraredTest:
    """Make a virtual infrared test and write it into ``folder`` (existing, empty or not).

    Files: project.toml, camera.json (interior parameters, no pose), markers.csv, model.grid (PLOT3D), early.tif and
    late.tif (16 bit, one count is 0.01 K), and truth/ with the markers' images, the pose and the nodes' temperatures.
    """
    made = infrared_test(seed)
    test, shot = made.test, made.shot
    io.write_camera(folder / "camera.json", shot.perfect.camera)
    io.write_markers(folder / "markers.csv", test.markers, length_unit="mm")
    io.write_mesh(folder / "model.grid", test.mesh)
    truth = folder / "truth"
    truth.mkdir(exist_ok=True)
    io.write_camera(truth / "camera.json", shot.perfect.camera, shot.view.cam_from_model, unit="mm")
    seen = shot.perfect.markers
    columns = {"name": test.markers.name, "x": seen.xy[:, 0], "y": seen.xy[:, 1], "visible": seen.visible.astype(int)}
    io.write_table(truth / "markers.csv", columns)
    heat = shot.world.node_intensity()
    for name, picture in made.frames.items():
        io.write_image(folder / f"{name}.tif", picture)
        kelvin = made.temperature(name, heat)
        io.write_nodes_csv(
            truth / f"{name}-nodes.csv", test.mesh, {"temperature": kelvin}, units={"temperature": "K", "length": "mm"}
        )
    volumes = ", ".join(f"{name} = {zones}" for name, zones in zones_of(test.mesh).items() if name != "wall")
    images = "\n".join(_IMAGE.format(name=name, scale=KELVIN_PER_COUNT) for name in made.frames)
    with io.atomic_write(folder / "project.toml") as stream:
        stream.write(_PROJECT.format(seed=seed, images=images, volumes=volumes))
    return made
