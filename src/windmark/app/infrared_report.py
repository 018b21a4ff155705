"""The report of an infrared run."""

from __future__ import annotations

from datetime import datetime
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

import windmark
from windmark import io
from windmark.app.infrared_pictures import flags_map, histories_picture, medians_picture
from windmark.app.infrared_scene import infrared_scene
from windmark.app.marked_photo import standing_photo
from windmark.app.psp_pictures import cp_map
from windmark.app.report import Report, measured
from windmark.errors import g3
from windmark.pipeline.alike import alike, listed
from windmark.pipeline.deform.pictures import read
from windmark.pipeline.infrared import FAILED, FrameRecord, InfraredResult, InfraredRun, reduced
from windmark.pipeline.infrared.outputs import FRAMES
from windmark.pipeline.infrared.run import MEAN
from windmark.pipeline.points import PointSet
from windmark.scene import Mesh

MAPS = 3
"""Frames whose fields are drawn."""
CAUSES = 3
DRAWN = (
    ("temperature", "temperature, K"), ("sigma_temperature", "sigma of the temperature, K"),
    ("heat_flux", "heat flux, W/m²"), ("sigma_heat_flux", "sigma of the heat flux, W/m²"),
)  # fmt: skip
FILES = (
    ("frames.csv", "every frame with its state, medians and what is to be said of it"),
    ("frames/FRAME.nc", "temperature, heat flux, their sigmas and flags at the nodes of the moved grid"),
    ("frames/FRAME.vtp, run.pvd", "the same for ParaView; all frames at their times"),
    ("points-NAME.csv", "histories at the wanted points"),
    ("summary.json", "the figures of this page"),
)


def infrared_page(run: InfraredRun, result: InfraredResult, folder: Path) -> Report:
    """The page; what could not be drawn is in its ``failed``."""
    when = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    unit = run.project.length_unit
    report = Report(run.project.title, f"windmark {windmark.__version__}, {when}, length unit: {unit}")
    done, heat = reduced(result.records), run.project.heat
    _frames(report, result)
    if done:
        start = None if heat is None else heat.start_s
        report.drawing("picture of the medians", lambda: medians_picture(done, start), "Medians over the nodes")
        report.heading("On the surface")
        written = [r for r in done if (folder / FRAMES / f"{r.key}.nc").exists()]
        drawn = [r for r in written if np.isfinite(r.median_q)] or written
        if result.steady is not None:
            _maps(report, run, folder, MEAN, "mean of the frames")
        pick = np.unique(np.linspace(0, len(drawn) - 1, min(MAPS, len(drawn))).astype(int))
        for r in [drawn[k] for k in pick]:
            _maps(report, run, folder, r.key, f"frame {r.key}, {g3(r.time_s)} s")
        _pictures(report, run, [r for r in done if r.followed.standing is not None])
        report.heading("In 3D")
        report.scene("3D view", lambda: infrared_scene(run, written, lambda key: _fields(folder, key)),
                     "Heat flux and temperature of the frames, all on one scale, where the model was in the tunnel; "
                     "grey: no value. Under the cursor: values with their sigma, names, residuals.")  # fmt: skip
        for of in run.points:
            report.heading(f"Histories at {of.name}")
            draw = partial(histories_of, result, of)
            report.drawing(f"histories at {of.name}", draw, "Bands: 2 sigma")
    _set_up(report, run)
    report.heading("Files beside this report")
    report.table(["file", "content"], FILES)
    return report


def histories_of(result: InfraredResult, of: PointSet) -> Figure:
    """Temperature and heat flux at a list of points."""
    rows = result.points.rows[of.name]
    return histories_picture(of.names.tolist(), np.array([r[1] for r in rows]), np.stack([r[2] for r in rows]))


def _frames(report: Report, result: InfraredResult) -> None:
    columns = ["frame", "time s", "state", "cameras", "RMS px", "seen %", "T K", "sigma K", "q W/m²", "sigma W/m²",
               "flagged %", "sigma of T by", "sigma of q by"]  # fmt: skip
    rows = [
        [r.key, r.time_s, r.status, " ".join(r.cameras), r.rms_px, _percent(r.seen),
         *measured(r.median_T, r.median_sigma_T), *measured(r.median_q, r.median_sigma_q), _percent(r.flagged),
         _causes(r, "T"), _causes(r, "q")]
        for r in result.records
    ]  # fmt: skip
    report.table(columns, rows, scroll=len(rows) > 15)
    good = [r for r in result.records if r.status != FAILED]
    failed = alike((r.key, r.reason) for r in result.records if r.status == FAILED)
    for said, style in ((failed, "bad"), (alike((r.key, words) for r in good for words in r.remarks), "soft")):
        for words, names in said.items():
            report.text(f"{listed('Frame', names)}: {words}", style)
    for remark in result.remarks:
        report.text(remark, "bad")


def _pictures(report: Report, run: InfraredRun, records: list[FrameRecord]) -> None:
    """What each camera saw of the worst frame."""
    if not records:
        return
    r = max(records, key=lambda r: r.rms_px)
    images = run.timeline.frames[r.index].images
    report.heading("What the cameras saw")
    for name in r.cameras:
        with report.part(f"picture of {name}"):
            image = read(images[name], run.deforming.test.station(name))
            assert r.followed.standing is not None
            report.raw(standing_photo(image, r.followed.standing, name, run.deforming.test.markers,
                                      f"{name}, frame {r.key}, the one with the largest residuals."))  # fmt: skip


def _percent(part: float) -> str | None:
    return f"{100 * part:.1f}" if np.isfinite(part) else None


def _causes(r: FrameRecord, what: str) -> str:
    return ", ".join(f"{name} {100 * share:.0f} %" for name, share in r.causes.get(what, [])[:CAUSES])


def _maps(report: Report, run: InfraredRun, folder: Path, key: str, title: str) -> None:
    with report.part(f"pictures of {title}"):
        from windmark.app.pictures import png

        mesh, fields = _fields(folder, key)
        pose = run.deforming.test.stations[0].cam_from_tunnel
        view = {"direction": pose.rotation[2], "up": -pose.rotation[1]}
        count = 0
        for name, label in DRAWN:
            values = fields.get(name, np.zeros(0))
            if np.isfinite(values).any():
                report.picture(png(cp_map(mesh, values, f"{title}: {label}", label, **view), 70), f"{title}: {label}")
                count += 1
        if "heat_flux" in fields and np.isfinite(flux := fields["heat_flux"]).any():
            flags = fields["flags"].astype(int)
            report.picture(png(flags_map(mesh, flags, flux, f"{title}: flags", **view), 70), f"{title}: flags")
            count += 1
        report.side_by_side(count)


def _fields(folder: Path, key: str) -> tuple[Mesh, dict[str, NDArray[np.float64]]]:
    """Grid and fields of a frame as they were written."""
    mesh, fields = io.read_nodes_netcdf(folder / FRAMES / f"{key}.nc")[:2]
    return mesh, {name: np.asarray(values, dtype=float) for name, values in fields.items()}


def noise_kelvin(run: InfraredRun, camera: str) -> float:
    """Noise of a camera's pixel at the surroundings' temperature."""
    sensor = run.sensors[camera]
    return float(np.sqrt(sensor.noise) / sensor.radiance.slope(run.surface.surroundings))


def _set_up(report: Report, run: InfraredRun) -> None:
    report.heading("Cameras, surface and walls")
    for name, sensor in run.sensors.items():
        low, high = sensor.radiance.t_range
        dead = 0 if sensor.dead is None else int(sensor.dead.sum())
        noise = f"{1e3 * noise_kelvin(run, name):.0f} mK at {run.surface.surroundings:g} K"
        report.text(f"Camera {name}: {sensor.entry.quantity}, {low:.4g} to {high:.4g} K, noise of a pixel {noise}, "
                    f"{dead} dead pixels")  # fmt: skip
    s = run.project.surface
    emissivity = f"{s.emissivity}" if s.table is None else f"by {s.table.name}"
    report.text(f"Surface: emissivity {emissivity}, relative sigma {s.emissivity_sigma:g}, surroundings "
                f"{s.surroundings_K:g} ± {s.surroundings_sigma_K:g} K")  # fmt: skip
    for entry in run.project.wall:
        of = ", ".join(entry.volumes) or "all volumes"
        layers = ", ".join(
            f"{'' if one.thickness_mm is None else f'{one.thickness_mm:g} mm of '}effusivity {one.layer.effusivity:.4g}"
            for one in entry.layer
        )
        report.text(f"Wall of {of}: {layers} W s½/(m² K), {entry.back}, relative sigma {entry.relative_sigma:g}")
    for remark in run.remarks:
        report.text(remark, "soft")
