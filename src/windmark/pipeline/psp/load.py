"""From a project file to a paint test: everything but the pictures of the points is read and checked first."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.io.errors import noted
from windmark.paint import TemperaturePaint, TunnelGain, form_factors
from windmark.pipeline.deform.entries import CameraEntry as DeformCamera
from windmark.pipeline.deform.load import Loaded, load
from windmark.pipeline.deform.project import DeformProject
from windmark.pipeline.framing import frame_views
from windmark.pipeline.lengths import Lengths
from windmark.pipeline.points import PointSet, lists_on_grid
from windmark.pipeline.psp.calibration import PaintCalibration, read_calibration, read_temperature_calibration
from windmark.pipeline.psp.cell import calibrate_paint, read_cell
from windmark.pipeline.psp.offs import by_incidence, by_run, read_references, run_remarks
from windmark.pipeline.psp.project import PspProject
from windmark.pipeline.psp.sensors import CameraSensor, read_sensor
from windmark.pipeline.psp.strangers import strangers
from windmark.pipeline.psp.stream import constants_of
from windmark.pipeline.psp.table import PointRow, SensorTable, read_points_table, read_sensors
from windmark.pipeline.results import FramedView
from windmark.pipeline.typed import nearest
from windmark.scene import Mesh
from windmark.tasks.psp import Lamp, Reflecting, left_words

Array = NDArray[np.float64]

TAP_SIGMA_Pa, WELL_SIGMA_K = 50.0, 0.3
"""Of readings whose tables say none."""


@dataclass(frozen=True)
class PspTest:
    """A paint test with everything that does not change from point to point.

    Parameters
    ----------
    project : the settings
    deforming : cameras, markers, laws and the grid, as `windmark deform` has them
    mesh : the grid at rest
    rows : the points
    paint : its calibration
    sensors : camera -> from grey levels to light
    taps, pressures, wells, readings : sensors on the model; None without
    lamps : the light that the model moves in
    temperature_paint : its calibration; None without
    polygons : corners (K, 3) of what is no paint
    reflecting : the light that the model throws on itself, with form factors at rest; None: it is left
    remarks : what is odd but no error
    views : virtual cameras before the grid at rest
    places : lists of places on it at which results are wanted
    read : the files that all this was read from
    """

    project: PspProject
    deforming: Loaded
    mesh: Mesh
    rows: tuple[PointRow, ...]
    paint: PaintCalibration
    sensors: Mapping[str, CameraSensor]
    taps: io.PointList | None
    pressures: SensorTable | None
    wells: io.PointList | None
    readings: SensorTable | None
    lamps: tuple[Lamp, ...]
    temperature_paint: TemperaturePaint | None
    polygons: tuple[Array, ...]
    reflecting: Reflecting | None
    remarks: tuple[str, ...]
    views: tuple[FramedView, ...] = ()
    places: tuple[PointSet, ...] = ()
    read: tuple[Path, ...] = ()


def load_psp(project: PspProject) -> PspTest:
    """Read what a project names.

    Raises
    ------
    FileError
        Naming the project's key, or the file, that is wrong.
    """
    with noted() as read:
        out = _load(project)
    return replace(out, read=tuple(sorted(map(Path, read))))


def _load(project: PspProject) -> PspTest:
    deforming = load(_as_deform(project))
    assert deforming.mesh is not None
    _check_sections(project, deforming.mesh)
    lengths = project.lengths
    paint = _calibrated(project)
    rows = _points(project)
    stations = {c.name: deforming.test.station(c.name) for c in project.camera}
    sensors = {name: read_sensor(project, name, station, rows, deforming.mesh) for name, station in stations.items()}
    taps = wells = pressures = readings = None
    remarks = [*deforming.remarks, *paint.warnings]
    if project.reference is not None and project.reference.mean_of_run:
        remarks += run_remarks(rows, project.points.max_alpha_error_deg)
    remarks += [*(r for s in sensors.values() for r in s.remarks)]
    if project.taps is not None:
        taps = lengths.points(project.taps.file, project.taps.roles, strict=True)
        pressures = read_sensors(project.taps.pressures, "pressure", project.taps.sigma or TAP_SIGMA_Pa)
        remarks += strangers(pressures, taps, [row.name for row in rows])
    warm = project.temperature
    if warm.thermocouples is not None and warm.readings is not None:
        wells = lengths.points(warm.thermocouples, strict=True)
        readings = read_sensors(warm.readings, "temperature", WELL_SIGMA_K)
        remarks += strangers(readings, wells, [row.name for row in rows])
    if not project.lamp and not all("reference" in row.channels for row in rows):
        remarks.append("no [[lamp]] is given: light that changes because the model moves in it is neither corrected "
                       "nor in any sigma")  # fmt: skip
    if project.self_illumination is None:
        remarks += left_words(deforming.mesh)
    polygons = () if project.patches.polygons is None else read_polygons(project.patches.polygons, lengths)
    places = lists_on_grid(project.place, lengths, deforming.mesh)
    lamps = tuple(Lamp(lamp.position, lamp.power) for lamp in project.lamp)
    return PspTest(
        project, deforming, deforming.mesh, rows, paint, sensors, taps, pressures, wells, readings, lamps,
        None if warm.paint is None else read_temperature_calibration(warm.paint), polygons,
        _reflecting(project, deforming.mesh), tuple(remarks), frame_views(project, deforming.mesh),
        places,
    )  # fmt: skip


def _check_sections(project: PspProject, mesh: Mesh) -> None:
    """Every volume that a section is of must be one of the grid's."""
    known = sorted(set(mesh.volume.tolist()))
    for k, entry in enumerate(project.section):
        if entry.volume is not None and entry.volume not in known:
            words = (f"the grid has no volume {entry.volume!r}{nearest(entry.volume, known)}; expected one of "
                     f"{', '.join(known)}")  # fmt: skip
            raise io.FileError(project.path, words, f"section[{k}].volume")


def _points(project: PspProject) -> tuple[PointRow, ...]:
    """The rows of the table of points, with what the project says of all of them and with their references."""
    how = project.reference
    rows = read_points_table(project.points.table, constants_of(project.conditions), references=how is not None)
    if how is None:
        return rows
    return by_run(rows) if how.table is None else by_incidence(rows, read_references(how.table))


def _as_deform(project: PspProject) -> DeformProject:
    """The part of the project that `windmark deform` knows; its pictures come from the table of points."""
    none = "(table of points)"
    cameras = tuple(DeformCamera(name=c.name, file=c.file, mask=c.mask, images=none) for c in project.camera)
    return DeformProject(
        path=project.path, title=project.title, length_unit=project.length_unit, camera=cameras,
        markers=project.markers, volume=project.volume, motion=project.motion, look=project.look, grid=project.grid,
    )  # fmt: skip


def _calibrated(project: PspProject) -> PaintCalibration:
    """The paint's calibration: that of a file, or made of its table of cell measurements."""
    paint = project.paint
    if paint.calibration is not None:
        found = read_calibration(paint.calibration)
        mean = project.reference is not None and project.reference.mean_of_run
        gain = isinstance(found.law, TunnelGain)
        if gain != mean or gain != (paint.steady is not None):
            raise io.FileError(
                project.path, "the tunnel's gain form (a calibration of kind gain), its steady pressure (paint.steady) "
                "and reference.mean_of_run = true belong together, for its changes are those about the mean of a run; "
                + (f"{paint.calibration.name} is of kind gain" if gain else
                   f"{paint.calibration.name} is of kind pressure"), "paint.calibration",
            )  # fmt: skip
        return found
    if paint.steady is not None or (project.reference is not None and project.reference.mean_of_run):
        raise io.FileError(project.path, "cell makes a calibration of pressure; paint.steady and reference.mean_of_run "
                           "need one of the tunnel's gain form (a file of kind gain)", "paint.cell")  # fmt: skip
    assert paint.cell is not None
    fit = calibrate_paint(
        read_cell(paint.cell), p_ref_Pa=paint.p_ref_Pa, t_ref_K=paint.t_ref_K, orders=paint.orders, key="paint.cell"
    )
    return PaintCalibration.of_fit(fit, paint.cell)


def _reflecting(project: PspProject, mesh: Mesh) -> Reflecting | None:
    how = project.self_illumination
    if how is None:
        return None
    return Reflecting(how.reflectivity, how.sigma, form_factors(mesh, facets=how.facets))


def read_polygons(path: Path, lengths: Lengths) -> tuple[Array, ...]:
    """A CSV table ``name,x,y,z``: the corners of each polygon in order; in the job's length unit.

    Raises
    ------
    FileError
        For a polygon of fewer than three corners, or whose corners lie on one line.
    """
    lengths.agree(path, io.read_marker_unit(path))
    table = io.read_table(path, required=("name", "x", "y", "z"), known=None)
    names = np.array(table.text("name"))
    xyz = np.stack([table.numbers(a) for a in "xyz"], axis=1)
    out = []
    for name in dict.fromkeys(names.tolist()):
        corners = xyz[names == name]
        size = np.linalg.svd(corners - corners.mean(axis=0), compute_uv=False)
        if len(corners) < 3 or not size[1] > 1e-9 * size[0]:
            what = f"polygon {name!r} has {len(corners)} corners, on one line; expected at least three round a surface"
            raise io.FileError(path, what, "name")
        out.append(corners)
    return tuple(out)
