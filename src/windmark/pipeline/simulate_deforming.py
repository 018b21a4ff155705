"""A synthetic deformation test as files: images of a bending wing by two cameras, the project, and the truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.errors import UsageError
from windmark.geometry import Pose
from windmark.pipeline.simulate import zones_of
from windmark.pipeline.simulate_taps import write_taps
from windmark.synth import HalfModel, Sensor, TunnelTest, WingState, deforming_sequence, stereo_wing

Array = NDArray[np.float64]

ZEROS = 2
"""Frames without wind at the start."""
GRIDS = 12
"""Of longer sequences about so many frames get a grid."""
RATE_HZ, SLOW_HZ, SLOW_START_S = 50, 30, -0.0263
"""Pictures per second; where cameras have clocks of their own the second one is slower, and not in step."""
STILL_S, SWING_HZ = 0.045, 4.0
"""With clocks: no wind until then, and how often the wing swings after it."""
MACH = 0.7
"""Of the wind that the paint feels in the others."""

_PROJECT = """\
# A synthetic deformation test of windmark's virtual wind tunnel (seed {seed}): a swept wing that bends and twists.
# The folder truth/ holds what a real test never knows; nothing here reads it.
title = "Bending wing, seed {seed}"
length_unit = "mm"

[[camera]]
name = "cam1"
file = "cam1.json"
images = "images/cam1-*.tif"{clock1}

[[camera]]
name = "cam2"
file = "cam2.json"
images = "images/cam2-*.tif"{clock2}

[markers]
file = "markers.csv"

[grid]
file = "model.grid"
volumes = {{ {volumes} }}

[look]
radius_px = {radius}

[[volume]]
name = "body"

[[volume]]
name = "wing"
parent = "body"
{law}

[stations]
volume = "wing"
start = [{start}]
end = [{end}]
chord = [150, 0, 0]

[sequence]
{rate}frames = "frames.csv"
zero = [{zeros}]

[values]
cameras = ["cam1"]
black = {black}

[[points]]
file = "taps.csv"

[output]
folder = "{folder}"
grid = ["vtk"]
every = {every}
"""

_BEAM = """\
law = "beam"
options = {{ root = [{root}], tip = [{tip}], section = [0, 1, 0] }}"""

_OWN = """\
law = "my_law.py:wing"
options = {{ root = [{root}], end = [{tip}] }}"""

_LAW = """\
import numpy as np
from scipy.spatial.transform import Rotation
from windmark.deformation import law


@law(tip="mm", twist="deg")
def wing(xyz, tip, twist, *, root=({root}), end=({tip})):
    along, up, span = np.subtract(end, root), np.array([0, 0, 1]), np.array([0, 1, 0])
    length = np.linalg.norm(along)
    e = np.maximum((xyz[:, 1] - root[1]) / along[1], 0)  # station: 0 at the root, 1 at the tip
    foot = root + np.outer(e, along)  # where its section meets the elastic axis
    slope = tip / length * 1.5 * e * (2 - e)  # a load at the tip: tip * e^2 (3 - e) / 2
    turn = Rotation.from_rotvec(np.outer(np.radians(twist) * e**2, span))
    lean = Rotation.from_rotvec(np.outer(np.arcsin(slope), np.cross(along / length, up)))
    short = 1.125 * (tip / length) ** 2 * (4 * e**3 / 3 - e**4 + e**5 / 5)  # the axis keeps its length
    return foot + lean.apply(turn.apply(xyz - foot)) + np.outer(tip * e**2 * (3 - e) / 2, up) - np.outer(short, along)
"""


def simulate_deforming(
    folder: Path, seed: int, frames: int = 12, size_px: tuple[int, int] = (960, 600), *, clocks: bool = False
) -> TunnelTest:
    """Make a deformation test and write it into ``folder`` (existing, empty or not).

    With ``clocks`` the cameras are not synchronised and the wing swings: cam1 takes `RATE_HZ` pictures per second, cam2
    30 at times that a table says, and ``frames`` are those of cam1.

    Files: deform.toml and deform-own-law.toml (the same with my_law.py), cam1.json and cam2.json (with poses),
    markers.csv, model.grid, taps.csv and taps.tgts (pressure taps), frames.csv (angle of attack), images/, and
    truth/states.csv. With clocks also cam2-times.csv.

    Raises
    ------
    ValueError
        For fewer than three frames.
    """
    if frames <= ZEROS:
        raise UsageError(f"frames: expected at least {ZEROS + 1} ({ZEROS} without wind), got {frames}")
    test = stereo_wing(seed, size_px=size_px, nodes=20_000)
    time_s = np.arange(frames) / RATE_HZ
    states = [_swinging(t) for t in time_s] if clocks else _states(frames)
    for name, camera in test.cameras.items():
        io.write_camera(folder / f"{name}.json", camera, test.cam_from_tunnel[name], unit="mm")
    io.write_markers(folder / "markers.csv", test.markers, length_unit="mm")
    io.write_mesh(folder / "model.grid", test.mesh)
    write_taps(folder, test.shape)
    (folder / "images").mkdir(exist_ok=True)
    names = list(test.cameras)
    _write_images(folder, test, states, seed, names[:1] if clocks else names)
    if clocks:
        slow = SLOW_START_S + np.arange(int(np.ceil((time_s[-1] - SLOW_START_S) * SLOW_HZ)) + 1) / SLOW_HZ
        _write_images(folder, test, [_swinging(t) for t in slow], seed, names[1:])
        images = np.array([f"cam2-{k:04d}.tif" for k in range(len(slow))])
        io.write_table(folder / "cam2-times.csv", {"image": images, "time_s": np.round(slow, 6)})
    _write_tables(folder, states, time_s if clocks else None)
    _write_projects(folder, seed, test, round(2.5 / 640.0 * size_px[0], 1), max(frames // GRIDS, 1), clocks)
    return test


def _write_images(folder: Path, test: TunnelTest, states: list[WingState], seed: int, cameras: list[str]) -> None:
    for k, images in enumerate(deforming_sequence(test, states, seed=seed, cameras=cameras)):
        for name, image in images.items():
            io.write_image(folder / "images" / f"{name}-{k:04d}.tif", image)


def _swinging(time_s: float) -> WingState:
    """Wind off at first; then the wing swings about a mean load that grows within a quarter of a second."""
    x = min(max((time_s - STILL_S) / 0.25, 0.0), 1.0)
    load, angle = x * x * (3 - 2 * x), 2 * np.pi * SWING_HZ * (time_s - STILL_S)
    turn = Pose.from_rotvec(np.radians([0.0, 0.5 * load, 0.0]), np.zeros(3)).rotation
    pivot = np.array([130.0, 0.0, 0.0])
    return WingState(
        load * (0.01 + 0.012 * np.sin(angle)), -load * (0.4 + 0.4 * np.sin(angle + 0.8)),
        Pose(turn, pivot - turn @ pivot), mach=MACH * (time_s > STILL_S),
    )  # fmt: skip


def _states(frames: int) -> list[WingState]:
    """Wind off, then a polar: pitch, bending and twist grow together, with a little flutter on top."""
    out = []
    for k in range(frames):
        load = max(k - ZEROS + 1, 0) / (frames - ZEROS)
        flutter = 0.06 * np.sin(2.1 * k) * (load > 0)
        turn = Pose.from_rotvec(np.radians([0.1 * load, 2.0 * load, -0.05 * load]), np.zeros(3)).rotation
        pivot = np.array([130.0, 0.0, 0.0])
        motion = Pose(turn, pivot - turn @ pivot + load * np.array([1.0, 0.5, 6.0]))
        out.append(WingState(0.02 * (load + flutter), -1.0 * (load - flutter), motion, mach=MACH * (load > 0)))
    return out


def _write_tables(folder: Path, states: list[WingState], time_s: Array | None) -> None:
    number = np.arange(len(states))
    alpha = np.array([np.degrees(np.arcsin(s.motion.rotation[0, 2])) for s in states])
    io.write_table(folder / "frames.csv", {"frame": number, "alpha_deg": np.round(alpha, 3)})
    (folder / "truth").mkdir(exist_ok=True)
    times = {} if time_s is None else {"time_s": time_s}
    io.write_table(folder / "truth" / "states.csv", {
        "frame": number, **times, "tip_fraction": np.array([s.tip_fraction for s in states]),
        "twist_deg": np.array([s.twist_deg for s in states]),
    })  # fmt: skip


def _write_projects(folder: Path, seed: int, test: TunnelTest, radius_px: float, every: int, clocks: bool) -> None:
    shape = test.shape
    root, tip = (axis_point(shape, y) for y in (shape.body_radius, shape.span))
    start, end = (_middle(shape, y) for y in (shape.body_radius, shape.span))
    volumes = ", ".join(f"{name} = {zones}" for name, zones in zones_of(test.mesh).items() if name != "wall")
    common = {
        "seed": seed, "volumes": volumes, "radius": radius_px, "start": point_text(start), "end": point_text(end),
        "clock1": f"\nrate_hz = {RATE_HZ}" if clocks else "", "clock2": '\ntimes = "cam2-times.csv"' if clocks else "",
        "rate": "" if clocks else f"rate_hz = {RATE_HZ}\n",
        "black": Sensor().black, "every": every, "zeros": ", ".join(f'"{k}"' for k in range(ZEROS)),
    }  # fmt: skip
    for name, law, out in (("deform", _BEAM, "deformation"), ("deform-own-law", _OWN, "deformation-own-law")):
        text = law.format(root=point_text(root), tip=point_text(tip))
        with io.atomic_write(folder / f"{name}.toml") as stream:
            stream.write(_PROJECT.format(**common, law=text, folder=out))
    with io.atomic_write(folder / "my_law.py") as stream:
        stream.write(_LAW.format(root=point_text(root), tip=point_text(tip)))


def axis_point(shape: HalfModel, y: float) -> tuple[float, float, float]:
    """The quarter-chord line of the virtual wing, about which it twists."""
    return 0.25 * shape.root_chord + float(np.tan(np.radians(shape.sweep_deg))) * y, y, 0.0


def _middle(shape: HalfModel, y: float) -> tuple[float, float, float]:
    return float(shape.leading_edge(y) + 0.5 * shape.chord(y)), y, 0.0


def point_text(point: tuple[float, float, float]) -> str:
    """A point as a project file has it, without its brackets."""
    return ", ".join(f"{v:.6g}" for v in point)
