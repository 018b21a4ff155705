"""The report of the main job: what was done to each image, how sure it is, what it looks like."""

from __future__ import annotations

from datetime import datetime
from typing import Any

import numpy as np

import windmark
from windmark.app import figures, merge_report, pictures
from windmark.app.pictures import png
from windmark.app.report import Report
from windmark.pipeline.clock import Clock
from windmark.pipeline.outputs import pose_difference
from windmark.pipeline.results import ImageResult, RunResult
from windmark.pipeline.truth import Comparison
from windmark.registration import Registration
from windmark.scene import MarkerSet

NODE_STATES = {
    "visible": "seen, with a value",
    "blanked": "not part of the surface (blanked, or in no volume of the job)",
    "lens": "beyond the range of the lens model",
    "outside": "outside the image",
    "facing_away": "facing away",
    "oblique": "seen too obliquely",
    "hidden": "hidden by another part",
}

FILES = (
    ("detections.csv", "every spot: centre, sigma, merit, radius"),
    ("matches.csv", "which spot is which marker, residual"),
    ("camera.json", "camera and its pose (windmark resect takes it)"),
    ("nodes.vtp, .dat, .f, .csv, .nc", "values on the grid: ParaView, Tecplot, PLOT3D function, CSV, NetCDF"),
    ("pixels.nc", "on demand: the surface point behind every pixel, obliquity, volume (NetCDF)"),
    ("view-*.tif", "virtual images, float32, NaN where nothing was seen"),
    ("section-*.csv", "values along cuts"),
    ("aligned.tif", "the image as seen from the reference image's pose"),
)


def run_report(result: RunResult, clock: Clock, truth: Comparison | None = None) -> Report:
    """The whole report, what could not be drawn in its ``failed``. ``clock``: times of writing."""
    when = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    project = result.project
    report = Report(project.title, f"windmark {windmark.__version__}, {when}, length unit: {project.length_unit}")
    _overview(report, result)
    for path, text in result.notes:
        report.text(f"{path.name}: {text}.", "soft")
    if truth is not None:
        _truth(report, truth)
    _views(report, result)
    for item in result.images:
        _image(report, item, result)
    for group in result.merged:
        with report.part(group.folder):
            merge_report.merged_part(report, group, project.length_unit)
    _times(report, result, clock.seconds)
    report.heading("Files beside this report")
    report.text("One folder per image:")
    report.table(["file", "content"], (*FILES, *merge_report.FILES))
    report.heading("Options")
    report.table(["key", "value"], _flat(project.model_dump(mode="json", exclude={"path"}, by_alias=True)))
    return report


def _flat(value: Any, key: str = "") -> list[tuple[str, str]]:
    """Nested options as rows: camera[0].file and so on; what is not set is left out."""
    if isinstance(value, dict):
        return [row for k, v in value.items() for row in _flat(v, f"{key}.{k}" if key else k)]
    if isinstance(value, list) and any(isinstance(v, dict) for v in value):
        return [row for k, v in enumerate(value) for row in _flat(v, f"{key}[{k}]")]
    text = ", ".join(map(str, value)) if isinstance(value, list) else str(value)
    return [] if value is None or not text else [(key, text)]


def _overview(report: Report, result: RunResult) -> None:
    rows = []
    for item in result.images:
        answer = item.registered
        rows.append((
            item.name,
            None if item.detections is None else len(item.detections),
            None if answer is None else len(answer.matching),
            None if answer is None or not len(answer.matching) else answer.rms_px,
            None if answer is None else f"10^{answer.log10_nfa:.0f}",
            None if item.values is None else int(np.isfinite(item.values).sum()),
            sum(item.seconds.values()),
            item.problem or "done",
        ))  # fmt: skip
    report.table(
        ["image", "spots", "markers matched", "RMS px", "false-alarm number", "nodes with value", "time s", "status"],
        rows,
    )
    report.text(
        "RMS is the root mean square length of the residual vector (2-D). The false-alarm number is how many wrong"
        " poses this good one would expect from chance alone in this image: 10^-9 and below is accepted.",
        "soft",
    )
    for item in result.failed:
        report.text(f"{item.name}: {item.problem}", "bad")
    for said in result.left_out:
        report.text(f"left out: {said}", "bad")


def _views(report: Report, result: RunResult) -> None:
    """How each view is framed: said once, because it is the same for all images."""
    if not result.framed:
        return
    unit = result.project.length_unit
    report.heading("Views")
    report.text("One point of view for all images and cameras: a pixel of a view is the same place in each of them.")
    rows = []
    for view in result.framed:
        pov = view.cam_from_model.to_pov(view.camera.focal_px, view.camera.size_px[0])
        rows.append((
            view.name, "{} × {}".format(*view.camera.size_px), f"{view.units_per_px:.5g}",
            ", ".join(f"{round(v, 4) + 0.0:.4f}" for v in (pov.rx_deg, pov.ry_deg, pov.rz_deg)),
            ", ".join(f"{round(v, 4) + 0.0:.4f}" for v in (pov.dx, pov.dy, pov.dz)), f"{pov.fov_deg:.4g}", view.how,
        ))  # fmt: skip
    report.table(
        ["view", "size px", f"{unit} per px", "rx, ry, rz deg", f"dx, dy, dz {unit}", "fov deg", "point of view"], rows
    )


def _truth(report: Report, truth: Comparison) -> None:
    report.heading("Compared with the truth")
    report.text(truth.verdict, "good" if truth.good else "bad")
    report.table(truth.columns, truth.rows)
    report.text(truth.explanation, "soft")


def _image(report: Report, item: ImageResult, result: RunResult) -> None:
    report.heading(f"Image {item.name}")
    if item.problem:
        report.text(item.problem, "bad")
    if item.said:
        report.text(f"{item.said[0].upper()}{item.said[1:]}.")
    if item.radius:
        report.text(item.radius.reason, "soft")
    if item.registered is not None and result.markers is not None:
        _registration(report, item, item.registered, result.markers, result.project.length_unit)
    elif item.image is not None and item.detections is not None:
        with report.part(f"{item.name}: picture of the spots"):
            report.picture(png(pictures.spots_picture(item.image, item.detections, item.name)), "Detected spots.")
    if item.nodes is not None and item.values is not None:
        _mapping(report, item, result)
    for view in item.views:
        with report.part(f"{item.name}: picture of view {view.name}"):
            report.picture(
                png(pictures.view_picture(view, result.project.length_unit)),
                f"The image recomputed for another point of view: “{view.name}”. Pale: not seen by the camera.",
            )
    for section in item.sections:
        with report.part(f"{item.name}: picture of section {section.name}"):
            report.picture(
                png(pictures.section_picture(section, result.project.length_unit, item.quantity.label)),
                f"Values along the cut “{section.name}”.",
            )
    with report.part(f"{item.name}: points and lines"):
        merge_report.tables(report, item.points, result.project.length_unit, item.quantity.label)
    with report.part(f"{item.name}: picture of the alignment"):
        alignment = figures.alignment_figure(item, result)
        if alignment is not None:
            report.picture(png(alignment), "3D alignment: what differs before and after the motion is compensated.")


def _registration(report: Report, item: ImageResult, answer: Registration, markers: MarkerSet, unit: str) -> None:
    assert item.detections is not None
    _pose_table(report, item, answer, unit)
    _together(report, item)
    if answer.excess_px > 0.0:
        report.text(
            f"The residuals ask for {answer.excess_px:.2g} px (1 sigma per coordinate) beyond the spots' noise, as if"
            f" the markers were {answer.off_table:.2g} {unit} off their table; the sigmas above have it.",
            "soft",
        )
    if answer.unchecked:
        report.text(f"This picture cannot tell: {'; '.join(u.words for u in answer.unchecked)}.", "soft")
    with report.part(f"{item.name}: picture of the matching"):
        report.picture(
            png(figures.matching_figure(item, markers)),
            "Which spot is which marker; yellow: residual vectors, magnified.",
        )
    if not len(answer.matching):
        return
    names, _, residual = figures.matched(item, markers)
    with report.part(f"{item.name}: picture of the residuals"):
        report.picture(png(pictures.residual_picture(names, residual), dpi=88), "Residuals of the matched markers.")
    xy, merit = (column[answer.matching.detection] for column in (item.detections.xy, item.detections.merit))
    report.table(
        ["marker", "x px", "y px", "dx px", "dy px", "distance px", "merit"],
        [
            (names[k], *(f"{v:.3f}" for v in (*xy[k], *residual[k], np.hypot(*residual[k]))), float(merit[k]))
            for k in np.argsort(names)
        ],
        scroll=True,
    )
    report.side_by_side(2)


def _together(report: Report, item: ImageResult) -> None:
    """With which cameras of the rig an image was registered."""
    found = None if item.instant is None else item.instant.registered
    if item.instant is None or found is None or len(found.cameras) < 2:
        return
    each = ", ".join(
        f"{name} {count} of {expected}"
        for name, count, expected in zip(item.instant.together.names, found.counts, found.n_expected, strict=True)
    )
    report.text(
        f"Registered together with the other cameras of the rig, from one instant (markers matched: {each}). The pose"
        f" follows from all of them, and the false-alarm number is that of all; RMS of all {found.rms_px:.3g} px."
    )


def _pose_table(report: Report, item: ImageResult, answer: Registration, unit: str) -> None:
    pov = answer.cam_from_model.to_pov(answer.camera.focal_px, answer.camera.size_px[0])
    pose, cov = answer.cam_from_model, answer.cov[:6, :6]
    sigma = pose.pov_sigma(cov)
    station = np.sqrt(np.diag(pose.rotation.T @ cov[3:, 3:] @ pose.rotation))
    report.heading("Where the camera was", 3)
    report.table(
        ["point of view", "x", "y", "z"],
        [
            ("angles, deg", *(f"{v:.4f}" for v in (pov.rx_deg, pov.ry_deg, pov.rz_deg))),
            ("their sigma, deg", *(float(v) for v in (sigma.rx_deg, sigma.ry_deg, sigma.rz_deg))),
            (f"distances, {unit}", *(f"{v:.4f}" for v in (pov.dx, pov.dy, pov.dz))),
            (f"their sigma, {unit}", *(float(v) for v in (sigma.dx, sigma.dy, sigma.dz))),
            (f"camera station in the model's frame, {unit}", *(f"{v:.4f}" for v in pose.center)),
            (f"its sigma, {unit}", *(float(v) for v in station)),
        ],
    )
    report.text(
        f"Field of view {pov.fov_deg:.3f} deg, focal length {answer.camera.focal_px:.2f} px;"
        f" {answer.report.iterations} iterations, stopped: {answer.report.reason}.",
        "soft",
    )
    for weak in answer.weak:
        report.text(
            f"Weakly determined: {weak.words(unit)}. The markers may move {weak.ratio:.0f} times as far this way as"
            " across the image before their spots tell."
        )
    if item.published is not None:
        off = pose_difference(answer.cam_from_model, item.published)
        used = "not used" if item.instant is None else "at most its place in the rig is used"
        report.text(
            f"The camera's file holds a pose too ({used}): it differs by {off['angle_deg']:.3f} deg, its station by"
            f" {off['station_distance']:.4g} {unit}."
        )


def _mapping(report: Report, item: ImageResult, result: RunResult) -> None:
    mesh, nodes, values = result.mesh, item.nodes, item.values
    assert mesh is not None
    assert nodes is not None
    assert values is not None
    report.heading("Values on the grid", 3)
    report.table(
        ["nodes", "count", "share %"],
        [(NODE_STATES[k], n, f"{100 * n / max(len(values), 1):.1f}") for k, n in nodes.count().items() if n],
    )
    with report.part(f"{item.name}: picture of the grid lines"):
        report.picture(
            png(figures.wireframe_figure(item, mesh)), "Visible grid lines projected with the pose found and the lens."
        )
    if item.quantity.words:
        report.text(f"{item.quantity.words[0].upper()}{item.quantity.words[1:]}.")
    if nodes.visible.any():
        with report.part(f"{item.name}: picture of the surface"):
            report.picture(
                png(figures.surface_figure(item, mesh)),
                "Values on the grid, seen from another side than the camera's. Grey: no value.",
            )


def _times(report: Report, result: RunResult, seconds: dict[str, float]) -> None:
    report.heading("Times")
    stages = list(dict.fromkeys(stage for item in result.images for stage in item.seconds))
    rows = [(name, *([None] * len(result.images)), value) for name, value in result.seconds.items()]
    rows += [(stage, *(item.seconds.get(stage) for item in result.images), None) for stage in stages]
    rows += [(name, *([None] * len(result.images)), value) for name, value in seconds.items()]
    report.table(["stage, s", *(item.name for item in result.images), "whole job"], rows)
