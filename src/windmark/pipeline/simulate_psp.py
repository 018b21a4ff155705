"""A synthetic paint test as files: pictures of a polar by two cameras, tables, the project, and the truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.pipeline.simulate import zones_of
from windmark.pipeline.simulate_deforming import axis_point, point_text
from windmark.pipeline.simulate_taps import ETAS, tap_table, write_taps
from windmark.scene import MarkerSet
from windmark.synth import PspTest, psp_test
from windmark.synth.psp import LAMPS, PIVOT, UNEVEN_mm
from windmark.synth.psp_truth import load_truth, node_truth, placed, reference_lengths, section_truth, tap_pressures

Array = NDArray[np.float64]

TAP_SIGMA_Pa, CELL_SIGMA, THERMO_SIGMA_K = 30.0, 0.002, 0.2
"""Standard deviations of the readings: a tap's transducer, the cell's ratio (relative), a thermocouple."""
UNEVEN_K = 1.0
"""Of the wall's temperature about recovery."""

_PROJECT = """\
# A synthetic paint test of windmark's virtual wind tunnel (seed {seed}): a swept wing that moves and bends, painted,
# before two cameras. The folder truth/ holds what a real test never knows; nothing here reads it.
title = "Painted wing, seed {seed}"
length_unit = "mm"

# One row per point of the polar: conditions, and where its pictures are ({{camera}} stands for the camera's name).
[points]
table = "points.csv"

[[camera]]
name = "cam1"
file = "cam1.json"

[[camera]]
name = "cam2"
file = "cam2.json"

[markers]
file = "markers.csv"

[grid]
file = "model.grid"
volumes = {{ {volumes} }}

[look]
radius_px = {radius}

# The model's parts and how they deform: the same laws as for windmark deform.
[[volume]]
name = "body"

[[volume]]
name = "wing"
parent = "body"
law = "beam"
options = {{ root = [{root}], tip = [{tip}], section = [0, 1, 0] }}

# Pictures without light and of even light; grey levels from which on a pixel counts as saturated.
[radiometry]
dark = "calibration/dark-{{camera}}-*.tif"
flat = "calibration/flat-{{camera}}-*.tif"
saturation = {saturation}

# What the paint did in the calibration cell, and its state in the wind-off pictures (columns of points.csv).
[paint]
cell = "paint-cell.csv"

# Where the lamps stand: the model moves in their light between wind-off and wind-on.
{lamps}
[taps]
file = "taps.csv"
pressures = "tap-pressures.csv"
roles = ["tap"]
radius = 0.4

# The wall's temperature: thermocouples where they have readings, else recovery of the stream. It varies over the wall
# by {uneven:g} K, over some {length:.0f} mm.
[temperature]
recovery = 0.896
sigma_K = {uneven:g}
length = {length:.0f}
thermocouples = "thermocouples.csv"
readings = "thermocouple-readings.csv"

[loads]
area = {area:.6g}
chord = {chord:.6g}
moment_point = [{pivot}]

{sections}
[output]
folder = "psp"
"""

_LAMP = "[[lamp]]\nposition = [{0:g}, {1:g}, {2:g}]\npower = {3:g}\n"

_SECTION = """\
[[section]]
name = "eta{0:02.0f}"
point = [0, {1:g}, 0]
normal = [0, 1, 0]
"""


def simulate_psp(
    folder: Path, seed: int, incidences: int = 5, size_px: tuple[int, int] = (960, 600), *, moves: float = 1.0
) -> PspTest:
    """Make a paint test and write it into ``folder`` (existing, empty or not).

    Files: psp.toml, points.csv (a row per point), cam1.json and cam2.json (with poses), markers.csv, model.grid,
    taps.csv and tap-pressures.csv, thermocouples.csv with readings, paint-cell.csv, images/POINT/ and calibration/ (the
    pictures), and truth/ (fields at the nodes, loads, sections, states, the paint, the cameras' gains). ``moves``: see
    `psp_test`.

    Raises
    ------
    ValueError
        For no incidence at all.
    """
    test = psp_test(seed, incidences=incidences, size_px=size_px, taps=tap_table(), moves=moves, uneven_K=UNEVEN_K)
    write_psp_test(folder, test)
    return test


def write_psp_test(folder: Path, test: PspTest) -> None:
    """Write the files of a test, see `simulate_psp`."""
    for name, camera in test.test.cameras.items():
        io.write_camera(folder / f"{name}.json", camera, test.test.cam_from_tunnel[name], unit="mm")
    io.write_markers(folder / "markers.csv", test.test.markers, length_unit="mm")
    io.write_mesh(folder / "model.grid", test.mesh)
    write_taps(folder, test.test.shape)
    _write_pictures(folder, test)
    _write_points(folder, test)
    _write_readings(folder, test)
    _write_cell(folder, test)
    _write_truth(folder / "truth", test)
    _write_project(folder, test)


def _write_pictures(folder: Path, test: PspTest) -> None:
    for point in test.points:
        own = folder / "images" / point.name
        own.mkdir(parents=True, exist_ok=True)
        for kind, camera, k, picture in test.pictures(point):
            io.write_image(own / f"{kind}-{camera}-{k}.tif", picture)
    (folder / "calibration").mkdir(exist_ok=True)
    for kind, camera, k, picture in test.calibration():
        io.write_image(folder / "calibration" / f"{kind}-{camera}-{k}.tif", picture)


def _write_points(folder: Path, test: PspTest) -> None:
    points = test.points
    columns: dict[str, NDArray] = {
        "point": np.array([p.name for p in points]),
        "alpha_deg": np.array([p.alpha_deg for p in points]),
        "mach": np.array([p.wind.mach for p in points]),
        "p_inf_Pa": np.round([p.wind.p_inf_Pa for p in points], 1),
        "q_inf_Pa": np.round([p.wind.q_inf_Pa for p in points], 1),
        "T0_K": np.round([p.wind.T0_K for p in points], 2),
        "p_off_Pa": np.round([p.still.p_Pa for p in points], 1),
        "T_off_K": np.round([p.still.T_K for p in points], 2),
        "on": np.array([f"images/{p.name}/on-{{camera}}-*.tif" for p in points]),
        "off": np.array([f"images/{p.name}/off-{{camera}}-*.tif" for p in points]),
    }
    io.write_table(folder / "points.csv", columns)


def _write_readings(folder: Path, test: PspTest) -> None:
    """What transducers and thermocouples say."""
    rng = np.random.default_rng([test.seed, 41])
    wells = _thermocouples(test)
    io.write_markers(folder / "thermocouples.csv", wells, length_unit="mm")
    pressure, warm = [], []
    for point in test.points:
        p = tap_pressures(test, point.wind)
        pressure.append(np.round(p + TAP_SIGMA_Pa * rng.standard_normal(len(p)), 1))
        T = point.wind.state(wells.xyz, wells.normal, "wing")[1]
        warm.append(np.round(T + THERMO_SIGMA_K * rng.standard_normal(len(T)), 3))
    for file, names, column, rows, sigma in (
        ("tap-pressures.csv", test.taps.name, "pressure_Pa", pressure, TAP_SIGMA_Pa),
        ("thermocouple-readings.csv", wells.name, "temperature_K", warm, THERMO_SIGMA_K),
    ):
        n = len(names)
        io.write_table(folder / file, {
            "point": np.repeat([p.name for p in test.points], n), "name": np.tile(names, len(test.points)),
            column: np.concatenate(rows), f"sigma_{column.rpartition('_')[2]}": np.full(n * len(rows), sigma),
        })  # fmt: skip


def _thermocouples(test: PspTest) -> MarkerSet:
    """Eight of them, under the wing's upper skin."""
    shape = test.test.shape
    eta, chord = np.repeat([0.2, 0.45, 0.7, 0.92], 2), np.tile([0.25, 0.75], 4)
    t = (eta * shape.span - shape.wing_root) / (shape.span - shape.wing_root)
    xyz, normal = shape.patches()["wing_upper"].place(np.arccos(1 - 2 * chord) / np.pi, t)
    names = [f"T{k + 1}" for k in range(len(eta))]
    return MarkerSet.make(names, np.round(xyz, 4), normal=normal, volume="wing", role="virtual", length_unit="mm")


def _write_cell(folder: Path, test: PspTest) -> None:
    """Measurements of a sample of the paint in a calibration cell."""
    rng = np.random.default_rng([test.seed, 42])
    p, T = (a.ravel() for a in np.meshgrid(np.linspace(20e3, 130e3, 12), np.linspace(278.15, 313.15, 8)))
    ratio = test.law.ratio(p, T) * (1 + CELL_SIGMA * rng.standard_normal(len(p)))
    io.write_table(folder / "paint-cell.csv", {
        "pressure_Pa": np.round(p, 1), "temperature_K": np.round(T, 2), "ratio": np.round(ratio, 6),
        "sigma": np.round(CELL_SIGMA * ratio, 6),
    })  # fmt: skip


def _write_truth(truth: Path, test: PspTest) -> None:
    truth.mkdir(exist_ok=True)
    loads, states, sections = [], [], []
    for point in test.points:
        at = node_truth(test, point)
        io.write_nodes_netcdf(
            truth / f"{point.name}.nc", test.mesh, {"cp": at.cp, "p": at.p_Pa, "T": at.T_K, "ratio": at.ratio},
            units={"cp": "1", "p": "Pa", "T": "K", "ratio": "1", "length": "mm"},
        )  # fmt: skip
        mesh = placed(test, point.on[0])
        loads += [(point.name, of.volume, of.cl, of.cd, of.cm) for of in load_truth(test, mesh, point.on[0], at.cp)]
        states += [(point.name, k, s.tip_fraction, s.twist_deg, *s.motion.translation) for k, s in enumerate(point.on)]
        for eta in ETAS:
            x, side, cp = section_truth(test, point.wind, eta)
            sections += [(point.name, eta, *row) for row in zip(x, side, cp, strict=True)]
    _rows(truth / "loads.csv", ("point", "volume", "CL", "CD", "CM"), loads)
    _rows(truth / "states.csv", ("point", "picture", "tip_fraction", "twist_deg", "x", "y", "z"), states)
    _rows(truth / "sections.csv", ("point", "eta", "x_c", "side", "cp"), sections)
    io.write_json(truth / "paint.json", {
        "coefficients": test.law.coefficients.tolist(), "p_ref_Pa": test.law.p_ref_Pa, "T_ref_K": test.law.T_ref_K,
        "fading_per_s": test.paint.fading_per_s, "flicker": test.flicker,
        "electrons_per_level": {name: camera.electrons_per_level for name, camera in test.cameras.items()},
    })  # fmt: skip


def _rows(path: Path, names: tuple[str, ...], rows: list[tuple]) -> None:
    io.write_table(path, {name: np.array(column) for name, column in zip(names, zip(*rows, strict=True), strict=True)})


def _write_project(folder: Path, test: PspTest) -> None:
    shape = test.test.shape
    size_px = next(iter(test.test.cameras.values())).size_px
    area, chord = reference_lengths(test)
    sensor = next(iter(test.cameras.values())).sensor
    volumes = ", ".join(f"{name} = {zones}" for name, zones in zones_of(test.mesh).items() if name != "wall")
    text = _PROJECT.format(
        seed=test.seed, volumes=volumes, radius=round(2.5 / 640.0 * size_px[0], 1),
        root=point_text(axis_point(shape, shape.body_radius)), tip=point_text(axis_point(shape, shape.span)),
        saturation=2**sensor.bits - 1, lamps="\n".join(_LAMP.format(*lamp) for lamp in LAMPS), area=area, chord=chord,
        pivot=", ".join(f"{v:g}" for v in PIVOT), uneven=UNEVEN_K, length=UNEVEN_mm,
        sections="\n".join(_SECTION.format(100 * eta, eta * shape.span) for eta in ETAS),
    )  # fmt: skip
    with io.atomic_write(folder / "psp.toml") as stream:
        stream.write(text)
