"""The report of a deformation test, and its film."""

from __future__ import annotations

from collections import Counter
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

import windmark
from windmark.app.deform_curves import history_picture, parameter_picture, span_picture, spectrum_picture
from windmark.app.deform_film import deformation_size, film, magnification, magnified, since, used_nodes, view_of
from windmark.app.deform_pictures import compared_picture
from windmark.app.deform_scene import deform_scene
from windmark.app.marked_photo import pictured_photo
from windmark.app.pictures import png, surface_picture
from windmark.app.report import Report, measured
from windmark.app.wording import named
from windmark.errors import g2, g3
from windmark.pipeline.deform import Loaded, Sequence
from windmark.pipeline.deform.pictures import read
from windmark.pipeline.deform.record import DOUBTFUL
from windmark.pipeline.surface import surface_view
from windmark.tasks.deform.zero import MOTION

Array = NDArray[np.float64]

SHOWN_DOUBTFUL = 12
SHOWN_FEW = 200
WORDS = {
    "cold": "found without help", "tracked": "followed from the frame before", "lost": "no deformation, see the reason",
    "misfit": "laws or table do not explain it, see the reason; its sigmas contain what is left",
}  # fmt: skip


def deform_page(loaded: Loaded, sequence: Sequence, record: dict[str, Any], folder: Path) -> Report:
    """The page, what could not be drawn in its ``failed``; the film goes into ``folder``."""
    project, unit = loaded.project, loaded.project.length_unit
    when = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    report = Report(project.title, f"windmark {windmark.__version__}, {when}, length unit: {unit}")
    _overview(report, loaded, sequence, record)
    rows = sequence.good
    if rows:
        x, label = _abscissa(loaded, sequence)
        if loaded.stations is not None:
            report.heading("Bending and twist along the span")
            caption = "By the laws alone, the rigid motion removed; error bars: 2 sigma"
            eta = loaded.stations.eta
            report.drawing("picture of bending and twist", lambda: span_picture(rows, eta, unit), caption)
        report.heading("Against " + label.split(",")[0])
        report.drawing("picture of the history", lambda: history_picture(sequence.records, x, label, unit),
                       "Bands: 2 sigma; red lines: lost frames. Shift of the markers' centre and rotation vector, both "
                       "in the tunnel's axes")  # fmt: skip
        names = loaded.test.volumes.names
        if names:
            units = [p.unit for p in loaded.test.volumes.parameters]
            report.drawing("picture of the parameters",
                           lambda: parameter_picture(sequence.records, names, units, x, label),
                           "Parameters of the laws, less the wind-off zero; bands: 2 sigma")  # fmt: skip
        if loaded.stations is not None:
            report.drawing("picture of the spectrum",
                           lambda: spectrum_picture(rows, project.sequence.rate_hz, unit),
                           "Spectrum of the tip (Hann window)")  # fmt: skip
        _surface(report, loaded, sequence)
    _cameras(report, sequence, record)
    _pictures(report, loaded, sequence)
    _tables(report, loaded, sequence)
    if project.output.film and len(sequence.film) > 1:
        with report.part("film"):
            film(loaded, sequence, folder / "deformation.gif")
    _files(report, folder)
    return report


def _overview(report: Report, loaded: Loaded, sequence: Sequence, record: dict[str, Any]) -> None:
    test = loaded.test
    report.table(["status", "frames", "meaning"], [[k, record[k], words] for k, words in WORDS.items()])
    if sequence.good:
        text = (
            f"Median: {record['median_spots']:.0f} spots, RMS {g3(record['median_rms_px'])} px, sigma0 "
            f"{g3(record['median_sigma0'])}, {record['median_frame_ms']:.0f} ms per frame from images to result; "
            f"{record['outliers']} spots left out as gross errors."
        )
        report.text(text)
    if doubt := Counter(spot for r in sequence.good for spot in r.doubtful):
        worst = ", ".join(f"{spot} ({n})" for spot, n in doubt.most_common(SHOWN_DOUBTFUL))
        more = ", ..." if len(doubt) > SHOWN_DOUBTFUL else ""
        report.text(
            f"Doubtful spots, and in how many frames: {worst}{more}. Their image is disturbed: an edge or another part "
            "of the model beside them or over them, a highlight, dirt. Their sigma, more than "
            f"{DOUBTFUL:g} times the usual one, says so, and they hardly count."
        )
    for words, frames in record.get("warnings", {}).items():
        report.text(f"{words} ({frames} of {len(sequence.good)} frames).", "bad")
    for words, frames in record.get("unchecked", {}).items():
        report.text(f"Not to be told from these pictures: {words} ({frames} of {len(sequence.good)} frames).", "soft")
    if sequence.zero is not None and sequence.moved is not None:
        size = np.linalg.norm(sequence.moved, axis=1)
        report.text(
            f"Wind-off zero: mean of {sequence.zero.frames} frames. It moved the markers by {g3(np.median(size))} "
            f"{loaded.project.length_unit} (median) from their table, at most {g3(size.max())}; and "
            f"{sequence.zero.words(loaded.project.length_unit)}."
        )
    else:
        report.text("No wind-off zero: values are relative to the table of markers, whose errors they contain.", "bad")
    moving = [s.name for s in test.stations if s.moves]
    fixed = [s.name for s in test.stations if not s.moves]
    if fixed:
        report.text(
            f"Taken as fixed: {', '.join(fixed)}. One that moved is named where markers on walls or other cameras tell."
        )
    if moving:
        report.text(f"Found in every frame by markers on walls: {', '.join(moving)}.")
    for words in record.get("weak", ()):
        report.text(f"Seen least: {words}.")
    report.text(
        "Every sigma is 1 sigma, from the spots' and the markers' covariances; where the residuals are larger than "
        "these explain, it contains what is left.",
        "soft",
    )


def _cameras(report: Report, sequence: Sequence, record: dict[str, Any]) -> None:
    """What every camera saw, and why it saw little."""
    report.heading("Cameras")
    if sequence.clock:
        report.text(
            f"The instants are the pictures of {sequence.clock}. Cameras that took none just then take part with their "
            "spots interpolated between their own pictures, whose covariance holds what that may leave; where the "
            "pictures before and after are too far apart they take no part."
        )
    for remark in sequence.remarks:
        report.text(remark, "bad")
    report.table(["camera", "median of its spots", "frames with few", "largest lag, ms"], [
        [name, of["median_spots"], len(of["few"]), None if of["max_lag_s"] is None else 1e3 * of["max_lag_s"]]
        for name, of in record["cameras"].items()
    ])  # fmt: skip
    few = [[f["frame"], name, f["spots"], f["expected"], f["reason"]]
           for name, of in record["cameras"].items() for f in of["few"]]  # fmt: skip
    if few:
        report.table(["frame", "camera", "spots", "expected", "why so few"], few[:SHOWN_FEW], scroll=len(few) > 15)
        if len(few) > SHOWN_FEW:
            report.text(f"{len(few) - SHOWN_FEW} more are in cameras.csv.", "soft")


def _pictures(report: Report, loaded: Loaded, sequence: Sequence) -> None:
    """What each camera saw first, and of the frame with the largest residuals."""
    for number, one in enumerate(sequence.gallery.shown()):
        what = "the first one found" if number == 0 else "the largest residuals"
        report.heading(f"What the cameras saw: frame {one.row.key}, {what}", 3)
        report.text(f"RMS of the residuals {g3(one.row.rms_px)} px, {one.row.spots} spots. Green: spots that took "
                    "part; diamonds: markers that the state puts in sight and that have no spot.", "soft")  # fmt: skip
        for station in loaded.test.stations:
            if station.name not in one.images.images:
                report.text(f"{station.name} has no picture of this frame.", "soft")
                continue
            with report.part(f"picture of {station.name}, frame {one.row.key}"):
                image = read(one.images.images[station.name], station)
                caption = f"{station.name}, frame {one.row.key}."
                report.raw(pictured_photo(image, one, station.name, loaded.test.markers, caption))


def _abscissa(loaded: Loaded, sequence: Sequence) -> tuple[Array, str]:
    """What the curves are drawn over."""
    rows, wanted = sequence.records, loaded.project.sequence.against
    if wanted is not None and wanted in sequence.table.columns:
        column = sequence.table.columns[wanted]
        at = [sequence.table.row(r.key) for r in rows]
        return np.array([np.nan if k is None else column[k] for k in at]), wanted
    time = np.array([r.time_s for r in rows])
    if np.isfinite(time).all():
        return time, "time, s"
    return np.array([r.instant for r in rows]), "frame"


def _tables(report: Report, loaded: Loaded, sequence: Sequence) -> None:
    unit = loaded.project.length_unit
    names, units = loaded.test.volumes.names, [p.unit for p in loaded.test.volumes.parameters]
    report.heading("Every frame")
    laws = [f"{n}, {u}" if u else n for n, u in zip(names, units, strict=True)]
    motion = [named(m) if m.endswith("_deg") else f"{named(m)}, {unit}" for m in MOTION]
    head = ["frame", "status", "spots", "out", "doubtful", "RMS px", "sigma0", *laws, *motion, "reason"]
    report.table(head, [
        [r.key, r.status, r.spots, r.outliers, len(r.doubtful), r.rms_px, r.sigma0, *_earned(r.q, r.q_sigma),
         *_earned(r.motion, r.motion_sigma), r.reason]
        for r in sequence.records
    ], scroll=True)  # fmt: skip


def _earned(values: Array, sigmas: Array) -> list[str]:
    """Numbers with the digits that their sigmas earn them."""
    return [measured(v, s)[0] for v, s in zip(values, sigmas, strict=True)]


def _files(report: Report, folder: Path) -> None:
    about = {
        "deformation.csv": "one row per frame: parameters, rigid motion, their sigma, quality",
        "cameras.csv": "one row per frame and camera: markers expected and seen, lag of its picture, why few were seen",
        "span.csv": "one row per frame and station: bending and twist with sigma, with and without the rigid motion",
        "markers.csv": "one row per frame and marker seen: place, displacement since wind-off and its sigma, in the "
                       "tunnel's axes; without wind-off frames from the table",
        "deformation.nc": "all of it over frames, NetCDF-4",
        "units.json": "units of the columns, and what they are relative to",
        "grid": "the deformed grid of single frames",
        "grid.pvd": "these for ParaView, all at their times",
        "deformation.gif": "the film",
        "summary.json": "the figures of this page",
    }
    report.heading("Files beside this report")
    there = [[n, text] for n, text in about.items() if n == "summary.json" or (folder / n).exists()]
    report.table(["file", "content"], there)


def _surface(report: Report, loaded: Loaded, sequence: Sequence) -> None:
    if loaded.mesh is not None and sequence.film:
        report.heading("The grid in 3D")
        report.scene("3D view", lambda: deform_scene(loaded, sequence, magnification(loaded, sequence)),
                     "The grid deformed by the laws, rigid motion removed, drawn larger as it is said; colours: the "
                     f"true length of the displacement {since(sequence)}, or its sigma. The slider goes through the "
                     "frames.")  # fmt: skip
    report.drawing("picture of the deformed grid", lambda: surface_figure(loaded, sequence),
                   f"Length of the displacement by the laws {since(sequence)}, rigid motion removed")  # fmt: skip
    with report.part("values on the deformed grid"):
        mapped = values_figure(loaded, sequence)
        if mapped is not None and (of := sequence.compared) is not None:
            off = of.off_px[np.isfinite(of.rigid)]
            report.heading("Values on the deformed grid")
            caption = (
                f"Frame {of.key}, {of.camera}: the same picture mapped in two ways. The grid moved as a whole, to "
                f"where it fits all markers best, is {g2(np.sqrt(np.mean(off**2)))} px off (RMS), "
                f"{g2(off.max())} px at most"
            )
            report.picture(png(mapped), caption)


def values_figure(loaded: Loaded, sequence: Sequence) -> Figure | None:
    """The most deformed frame mapped with and without its deformation; None where no values were wanted."""
    if loaded.mesh is None or sequence.compared is None:
        return None
    station = loaded.test.station(sequence.compared.camera)
    ahead, up = station.cam_from_tunnel.rotation[2], -station.cam_from_tunnel.rotation[1]
    return compared_picture(loaded.mesh, sequence.compared, direction=ahead, up=up)


def surface_figure(loaded: Loaded, sequence: Sequence) -> Figure | None:
    """The most deformed frame that was kept, on the grid; None without a grid."""
    mesh = loaded.mesh
    if mesh is None or not sequence.film:
        return None
    row, state = max(sequence.film, key=lambda kept: float(np.nanmax(np.abs(kept[0].bending), initial=0.0)))
    size = deformation_size(mesh, state, sequence.zero)
    direction, up = view_of(loaded)
    moved = magnified(mesh, state, sequence.zero, 1.0)
    shown = surface_view(moved, size, direction=direction, up=up, focus=moved.vertices[used_nodes(mesh)])
    label = f"deformation {since(sequence)}, {loaded.project.length_unit}"
    return surface_picture(shown.value, shown.shade, f"Frame {row.key}: deformation of the grid", label)
