"""Results of a paint test as files: a folder for every point, and tables over all of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.paint import SECTION_LOADS, LoadReference
from windmark.pipeline.psp.load import PspTest
from windmark.pipeline.psp.places import place_columns
from windmark.pipeline.psp.point import PointOutcome
from windmark.pipeline.psp.project import PspProject
from windmark.pipeline.psp.record import PointRecord, load_columns
from windmark.resection import PixelMap, map_pixels
from windmark.tasks.psp import PointTask, ReducedPoint, section_loads

Array = NDArray[np.float64]

FIELDS = "fields.nc"
"""Of every point, whatever grids are wanted; the report reads it."""


def write_point(folder: Path, test: PspTest, done: PointOutcome, record: PointRecord) -> None:
    """Write the folder of a point: fields at the nodes, sections, taps, results at listed places."""
    place, reduced, project = folder / record.name, done.reduced, test.project
    place.mkdir(exist_ok=True)
    fields, units = node_fields(reduced)
    units["length"] = project.length_unit
    history = {"point": record.name, "alpha_deg": record.alpha_deg, "causes": record.causes, "fit": record.fit}
    io.write_nodes_netcdf(place / FIELDS, reduced.mesh, fields, units=units, history=_plain(history))
    mesh = reduced.mesh
    if "vtk" in project.output.grid:
        io.write_nodes_vtk(place / "fields.vtp", mesh, fields, units=units)
    if "tecplot" in project.output.grid:
        io.write_tecplot(place / "fields.dat", mesh, fields, units=units)
    if "csv" in project.output.grid:
        io.write_nodes_csv(place / "fields.csv", mesh, fields, units=units)
    if "plot3d" in project.output.grid and mesh.blocks:
        io.write_plot3d_function(place / "fields.f", mesh, fields, units=units, layout=_layout(project))
    write_views(place, test, reduced)
    write_span(place, test, reduced, done.task)
    for of in test.places:
        io.write_table(place / f"points-{of.name}.csv", place_columns(of, test.mesh, reduced))
    write_tables(place, record)


def write_span(place: Path, test: PspTest, reduced: ReducedPoint, task: PointTask) -> None:
    """``span.csv``: normal force, axial force and moment of every section, see `tasks.psp.section_loads`."""
    axes = LoadReference(1.0, 1.0, 1.0) if task.reference is None else task.reference
    found = section_loads(test.mesh, reduced.cp, task.sections, axes, seen=reduced.shown)
    if not found:
        return
    of = [loads for _, loads in found]
    columns: dict[str, NDArray] = {
        "section": np.array([name for name, _ in found]), "station": np.concatenate([s.station for s in of]),
        "chord": np.concatenate([s.chord for s in of]),
    }  # fmt: skip
    for k, name in enumerate(SECTION_LOADS):
        columns |= {name: np.array([s.value[0, k] for s in of]), f"sigma_{name}": np.array([s.sigma[0, k] for s in of])}
    io.write_table(place / "span.csv", {**columns, "unseen": np.concatenate([s.unseen for s in of])})


def write_views(place: Path, test: PspTest, reduced: ReducedPoint) -> None:
    """Cp and ratio as virtual images, ``view-NAME-cp.tif`` and ``view-NAME-ratio.tif``, with the camera beside them.

    They show the grid at rest, so that images of all points can be laid over each other; NaN where a node of the
    triangle that a pixel shows has no value.
    """
    for view in test.views:
        pixels = map_pixels(test.mesh, view.camera, view.cam_from_model, cull_backfaces=True)
        for name, field in (("cp", reduced.cp), ("ratio", reduced.ratio)):
            image = on_pixels(field.value, pixels)
            io.write_image(place / f"view-{view.name}-{name}.tif", image, description=f"{name} ({reduced.name})")
        unit = test.project.length_unit
        io.write_camera(place / f"view-{view.name}.json", view.camera, view.cam_from_model, unit=unit)


def on_pixels(values: Array, pixels: PixelMap) -> NDArray[np.float32]:
    """(H, W) values (V,) of nodes at the places that pixels show, straight between nodes; NaN where one is missing."""
    out = np.full(pixels.valid.shape, np.nan, np.float32)
    at = pixels.triangle[pixels.valid]
    second, third = pixels.barycentric[pixels.valid].T
    corners = values[pixels.mesh.triangles[at]]
    out[pixels.valid] = (1 - second - third) * corners[:, 0] + second * corners[:, 1] + third * corners[:, 2]
    return out


def write_tables(place: Path, record: PointRecord) -> None:
    """``sections.csv`` and ``taps.csv`` of a point."""
    if record.sections:
        parts = record.sections
        io.write_table(place / "sections.csv", {
            "section": np.concatenate([np.full(len(s.x_c), s.name) for s in parts]),
            "line": np.concatenate([s.line for s in parts]),
            **{a: np.concatenate([s.xyz[:, k] for s in parts]) for k, a in enumerate("xyz")},
            "x_c": np.concatenate([s.x_c for s in parts]),
            "upper": np.concatenate([s.upper.astype(int) for s in parts]),
            "cp": np.concatenate([s.cp for s in parts]), "sigma_cp": np.concatenate([s.sigma for s in parts]),
        })  # fmt: skip
    if record.taps is not None and len(record.taps.names):
        t = record.taps
        io.write_table(place / "taps.csv", {
            "name": np.array(t.names), "cp_tap": t.cp, "sigma_tap": t.cp_sigma, "cp_paint": t.paint,
            "sigma_paint": t.paint_sigma, "reason": np.array(t.words),
        })  # fmt: skip


def node_fields(reduced: ReducedPoint) -> tuple[dict[str, NDArray], dict[str, str]]:
    """Name -> (V,) values and units: everything with its sigma; single precision, far below any sigma."""
    out: dict[str, NDArray] = {}
    units: dict[str, str] = {}
    for name, field in (("cp", reduced.cp), ("pressure", reduced.pressure), ("temperature", reduced.temperature),
                        ("ratio", reduced.ratio)):  # fmt: skip
        out[name] = field.value.astype(np.float32)
        out[f"sigma_{name}"] = np.where(field.known, field.sigma, np.nan).astype(np.float32)
    units |= {"cp": "1", "pressure": "Pa", "temperature": "K", "ratio": "1"}
    units |= {f"sigma_{name}": unit for name, unit in list(units.items())}
    out["flags"], out["filled"] = reduced.flags.astype(np.int32), reduced.filled.astype(np.int32)
    if reduced.merged.self_lit is not None:
        out["self_illumination"] = reduced.merged.self_lit.ratio.astype(np.float32)
    out["camera"] = reduced.merged.source.astype(np.int32)
    return out, units


def write_all(folder: Path, test: PspTest, records: Sequence[PointRecord]) -> None:
    """Tables over all points, and the collection that shows them in ParaView one after the other."""
    io.write_table(folder / "points.csv", {
        "point": np.array([r.name for r in records], dtype=np.str_),
        "alpha_deg": np.array([r.alpha_deg for r in records]),
        "status": np.array([r.status for r in records], dtype=np.str_),
        "alpha_seen_deg": np.array([r.alpha_seen_deg for r in records]),
        "rms_px": np.array([r.rms_px for r in records]),
        "pictures_on": np.array([r.pictures_used[0] for r in records]),
        "pictures_off": np.array([r.pictures_used[1] for r in records]),
        "seen": np.array([r.seen for r in records]),
        "median_sigma_cp": np.array([r.median_sigma_cp for r in records]),
        "taps": np.array([r.fit.get("taps", np.nan) for r in records]),
        "taps_leave_one_out_rms_Pa": np.array([r.fit.get("leave_one_out_rms_Pa", np.nan) for r in records]),
        "reason": np.array([r.reason for r in records], dtype=np.str_),
    })  # fmt: skip
    with_loads = [r for r in records if r.loads]
    if with_loads:
        io.write_table(folder / "loads.csv", load_columns(with_loads))
    if "vtk" in test.project.output.grid:
        _write_collection(folder, records)


def _write_collection(folder: Path, records: Sequence[PointRecord]) -> None:
    """A ParaView collection: the incidence is its time."""
    files = {f"{r.name}/fields.vtp": r.alpha_deg for r in records}
    io.write_collection(folder / "polar.pvd", [(at, file) for file, at in files.items() if (folder / file).exists()])


def _layout(project: PspProject) -> io.Plot3dLayout:
    """Results get the layout of the grid's own file; double precision where that has none."""
    try:
        return io.detect_plot3d(project.grid.file)
    except io.FileError:
        return io.Plot3dLayout()


def _plain(history: Mapping[str, Any]) -> Mapping[str, Any]:
    """What JSON can hold: numbers that are none become None."""

    def clean(v: Any) -> Any:
        if isinstance(v, Mapping):
            return {k: clean(x) for k, x in v.items()}
        if isinstance(v, list | tuple):
            return [clean(x) for x in v]
        return None if isinstance(v, float) and not np.isfinite(v) else v

    return {k: clean(v) for k, v in history.items()}
