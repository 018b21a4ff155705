"""The report of a paint test."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

import windmark
from windmark import io
from windmark.app.marked_photo import standing_photo
from windmark.app.psp_pictures import cp_map, loads_picture, section_picture, taps_picture
from windmark.app.psp_scene import psp_scene
from windmark.app.report import Report, fixed, measured
from windmark.app.wording import duration
from windmark.pipeline.alike import alike, listed
from windmark.pipeline.deform.pictures import read
from windmark.pipeline.psp import REDUCED, PointRecord, PspTest, grouped, reduced
from windmark.pipeline.psp.outputs import FIELDS
from windmark.pipeline.psp.sensors import pictures_named

MAPS = 4
"""Points whose fields are drawn."""
CAUSES = 3
"""Causes of each sigma that are named."""
FILES = (
    ("points.csv, loads.csv", "every point with its state; forces and moments with sigma"),
    ("POINT/fields.nc", "Cp, pressure, temperature, ratio and their sigmas at the nodes of the deformed grid"),
    ("POINT/fields.vtp, polar.pvd", "the same for ParaView; all points, incidence as time"),
    ("POINT/sections.csv, POINT/taps.csv, POINT/points-NAME.csv", "Cp along the cuts; paint against taps; at places"),
    ("summary.json", "the figures of this page"),
)


def psp_page(test: PspTest, records: list[PointRecord], folder: Path) -> Report:
    """The page; what could not be drawn is in its ``failed``."""
    when = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    unit = test.project.length_unit
    report = Report(test.project.title, f"windmark {windmark.__version__}, {when}, length unit: {unit}")
    done = reduced(records)
    _points(report, records)
    if done:
        if any(r.loads for r in done):
            report.heading("Loads")
            loaded = [r for r in done if r.loads]
            report.drawing("picture of the loads", lambda: loads_picture(loaded),
                           "Pressure loads of what cameras show, by volume; error bars: 2 sigma")  # fmt: skip
            _loads(report, loaded)
            _references(report, test)
        report.heading("Cp on the surface")
        report.scene("3D view", lambda: psp_scene(test, done, lambda r: _fields(folder / r.name / FIELDS)),
                     "Cp of each point, or its sigma, all on one scale, each on its deformed grid, with cameras, "
                     "markers and residuals of its first picture with wind; grey: seen by no camera, or not well "
                     "enough for a value.")  # fmt: skip
        _pictures(report, test, done)
        for r in [done[k] for k in np.unique(np.linspace(0, len(done) - 1, min(MAPS, len(done))).astype(int))]:
            _maps(report, test, r, folder)
        if test.project.section:
            report.heading("Sections")
            for section in test.project.section:

                def draw(name: str = section.name) -> Figure:
                    return section_picture(done, name)

                report.drawing(f"picture of section {section.name}", draw, "Bands: 2 sigma of the paint; rings: taps")
        if any(r.taps is not None for r in done):
            report.heading("Paint against taps")
            report.drawing("picture of the taps", lambda: taps_picture(done),
                           "Error bars: 2 sigma of tap and paint; crosses: taps that do not count")  # fmt: skip
            _taps(report, done)
    _notes(report, records)
    _paint(report, test)
    report.heading("Files beside this report")
    report.table(["file", "content"], FILES)
    return report


def _points(report: Report, records: list[PointRecord]) -> None:
    columns = ["point", "incidence °", "state", "seen °", "pictures on/off", "RMS px", "seen %", "sigma Cp",
               "dominated by", "s"]  # fmt: skip
    rows = [
        [r.name, r.alpha_deg, r.status, fixed(r.alpha_seen_deg, 3), f"{r.pictures_used[0]}/{r.pictures_used[1]}",
         r.rms_px, fixed(100 * r.seen, 1), measured(r.median_sigma_cp, r.median_sigma_cp)[1], _causes(r, "Cp"),
         duration(sum(r.seconds.values()))] for r in records
    ]  # fmt: skip
    report.table(columns, rows, scroll=len(records) > 15)
    for words, names in alike((r.name, r.reason) for r in records if r.status != REDUCED).items():
        report.text(f"{listed('Point', names)}: {words}", "bad")


def _notes(report: Report, records: list[PointRecord]) -> None:
    """What is to be said of the points: behind the results."""
    if grouped(records):
        report.heading("Notes")
    for remark, names in grouped(records).items():
        some = "all points" if len(names) == len(records) > 1 else ", ".join(names[:6]) + (", ..." if names[6:] else "")
        report.text(f"{some}: {remark}", "soft")


def _causes(r: PointRecord, what: str) -> str:
    return ", ".join(f"{name} {100 * share:.0f} %" for name, share in r.causes.get(what, [])[:CAUSES])


def _loads(report: Report, records: list[PointRecord]) -> None:
    names = ("CL", "CD", "Cm", "CN", "CA")
    rows = [
        [r.name, r.alpha_deg, v, f"{100 * r.shown.get(v, np.nan):.0f} %",
         *(" ± ".join(measured(*of[c], sign="+")) for c in names), _causes(r, "CL") if v == "all" else ""]
        for r in records for v, of in r.loads.items()
    ]  # fmt: skip
    columns = ["point", "incidence °", "volume", "area shown", *names, "sigma of CL by"]
    report.table(columns, rows, scroll=len(rows) > 15)
    report.text("Loads are those of the part of each volume's area that cameras show, against p_inf.", "soft")


def _references(report: Report, test: PspTest) -> None:
    """What the coefficients are by."""
    by, unit = test.project.loads, test.project.length_unit
    if by is None:
        return
    of = f"{by.span:g} {unit} span" if by.span else "the chord, for no loads.span is given"
    about = ", ".join(f"{x:g}" for x in by.moment_point)
    report.text(f"Forces are by {by.area:g} {unit}²; Cm by that and {by.chord:g} {unit} chord, Cl and Cn by that and "
                f"{of}; moments are about ({about}) {unit}.", "soft")  # fmt: skip


def _pictures(report: Report, test: PspTest, done: list[PointRecord]) -> None:
    """What each camera saw first of the point with the largest residuals."""
    r = max(done, key=lambda r: r.rms_px)
    standing = r.followed[0].standing if r.followed else None
    row = next((row for row in test.rows if row.name == r.name), None)
    if standing is None or row is None:
        return
    report.heading("What the cameras saw", 3)
    for station in test.deforming.test.stations:
        with report.part(f"picture of {station.name}"):
            files = pictures_named(test.project, row.on, station.name)
            if files:
                report.raw(standing_photo(read(files[0], station), standing, station.name, test.deforming.test.markers,
                                          f"{station.name}, {files[0].name}, point {r.name}."))  # fmt: skip


def _maps(report: Report, test: PspTest, r: PointRecord, folder: Path) -> None:
    with report.part(f"pictures of point {r.name}"):
        mesh, fields = _fields(folder / r.name / FIELDS)
        pose = test.deforming.test.stations[0].cam_from_tunnel
        view = {"direction": pose.rotation[2], "up": -pose.rotation[1]}
        from windmark.app.pictures import png

        for name, label in (("cp", "Cp"), ("sigma_cp", "sigma of Cp")):
            title = f"{r.name}, {r.alpha_deg:g}°: {label}"
            report.picture(png(cp_map(mesh, fields[name], title, label, **view), 70), title)
        report.side_by_side(2)


def _fields(path: Path) -> tuple[windmark.Mesh, dict[str, NDArray[np.float64]]]:
    """Grid and fields of a point as they were written."""
    mesh, fields = io.read_nodes_netcdf(path)[:2]
    return mesh, {name: np.asarray(values, dtype=float) for name, values in fields.items()}


def _taps(report: Report, records: list[PointRecord]) -> None:
    rows = []
    for r in records:
        if r.taps is not None:
            out = ", ".join(n for n, w in zip(r.taps.names, r.taps.words, strict=True) if w not in ("", "not seen"))
            rows.append([r.name, r.fit.get("taps"), r.taps.rms, r.fit.get("slope"), r.fit.get("offset_Pa"),
                         r.fit.get("leave_one_out_rms_Pa"), r.fit.get("scatter_Pa"), out])  # fmt: skip
    report.table(["point", "taps that count", "RMS in Cp", "slope", "offset Pa", "leave-one-out RMS Pa", "scatter Pa",
                  "left out"], rows)  # fmt: skip


def _paint(report: Report, test: PspTest) -> None:
    report.heading("Paint and cameras")
    report.text(f"Calibration: {test.paint}.")
    for name, sensor in test.sensors.items():
        gain = sensor.model.gain
        report.text(f"Camera {name}: {gain:.4g} grey levels per photo-electron ({sensor.gain_from})")
    for remark in test.remarks:
        report.text(remark, "soft")
