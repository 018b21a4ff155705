"""From a project file to a paint test: everything but the pictures of the points is read and checked first."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.pipeline.deform.load import Loaded, load
from windmark.pipeline.deform.project import CameraEntry as DeformCamera
from windmark.pipeline.deform.project import DeformProject
from windmark.pipeline.psp.calibration import PaintCalibration, read_calibration
from windmark.pipeline.psp.cell import calibrate_paint, read_cell
from windmark.pipeline.psp.project import PspProject
from windmark.pipeline.psp.sensors import CameraSensor, read_sensor
from windmark.pipeline.psp.table import PointRow, SensorTable, read_points_table, read_sensors
from windmark.scene import Mesh
from windmark.tasks.psp import Lamp

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
    remarks : what is odd but no error
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
    remarks: tuple[str, ...]


def load_psp(project: PspProject) -> PspTest:
    """Read what a project names.

    Raises
    ------
    FileError
        Naming the project's key, or the file, that is wrong.
    """
    deforming = load(_as_deform(project))
    assert deforming.mesh is not None
    lengths = project.lengths
    rows = read_points_table(project.points.table)
    paint = _calibrated(project)
    sensors = {c.name: read_sensor(project, c.name, deforming.test.station(c.name), rows) for c in project.camera}
    taps = wells = pressures = readings = None
    remarks = [*deforming.remarks, *paint.warnings, *(r for s in sensors.values() for r in s.remarks)]
    if project.taps is not None:
        taps = lengths.points(project.taps.file, project.taps.roles)
        pressures = read_sensors(project.taps.pressures, "pressure", project.taps.sigma or TAP_SIGMA_Pa)
        remarks += _strangers(pressures, taps)
    warm = project.temperature
    if warm.thermocouples is not None and warm.readings is not None:
        wells = lengths.points(warm.thermocouples)
        readings = read_sensors(warm.readings, "temperature", WELL_SIGMA_K)
        remarks += _strangers(readings, wells)
    if not project.lamp:
        remarks.append("no [[lamp]] is given: light that changes because the model moves in it is neither corrected "
                       "nor in any sigma")  # fmt: skip
    lamps = tuple(Lamp(lamp.position, lamp.power) for lamp in project.lamp)
    return PspTest(
        project, deforming, deforming.mesh, rows, paint, sensors, taps, pressures, wells, readings, lamps,
        tuple(remarks),
    )  # fmt: skip


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
        return read_calibration(paint.calibration)
    assert paint.cell is not None
    fit = calibrate_paint(
        read_cell(paint.cell), p_ref_Pa=paint.p_ref_Pa, t_ref_K=paint.t_ref_K, orders=paint.orders, key="paint.cell"
    )
    return PaintCalibration.of_fit(fit, paint.cell)


def _strangers(table: SensorTable, places: io.PointList) -> list[str]:
    """Sensors with readings that have no place."""
    known = set(places.name.tolist())
    lost = sorted({n for own in table.of.values() for n in own} - known)
    some = ", ".join(lost[:5]) + (", ..." if len(lost) > 5 else "")
    return [f"{table.path}: {len(lost)} sensors have readings but no place: {some}"] if lost else []
