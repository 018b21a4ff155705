"""The report of the main job: what was done to each image, how sure it is, what it looks like."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

import windmark
from windmark.app import merge_report
from windmark.app.photo import FIRST, FURTHER, greys, thumbnail
from windmark.app.provenance import Provenance
from windmark.app.report import Report
from windmark.app.run_images import image_part
from windmark.app.run_scene import run_scene
from windmark.app.wording import duration, power_of_ten
from windmark.errors import g2
from windmark.pipeline.clock import Clock
from windmark.pipeline.results import ImageResult, RunResult
from windmark.pipeline.truth import Comparison

OPEN_IMAGES = 12
"""Images that a report shows at once; of more each part is packed until it is opened."""

NO_TIME_S = 0.005
"""A stage that took less in every image is not in the table of times."""

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


def run_report(
    result: RunResult, clock: Clock, truth: Comparison | None = None, sources: Mapping[str, Any] | None = None
) -> Report:
    """The whole report, what could not be drawn in its ``failed``. ``clock``: times of writing.

    ``sources``: versions and inputs with their hashes, see `io.ResultFolder.sources`.
    """
    when = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    project = result.project
    folder = Path(project.path).resolve().parent
    report = Report(project.title, f"windmark {windmark.__version__}, {when}, length unit: {project.length_unit}",
                    folder=folder)  # fmt: skip
    order = worst_first(result.images)
    many = len(order) > OPEN_IMAGES
    overview(report, result)
    for path, text in result.notes:
        report.text(f"{path.name}: {text}.", "soft")
    if truth is not None:
        _truth(report, truth)
    report.heading("In 3D")
    report.scene("3D view", lambda: run_scene(result, order), _scene_words(result))
    _views(report, result)
    _images(report, order, result, many)
    for group in result.merged:
        with report.part(group.folder):
            merge_report.merged_part(report, group, project.length_unit)
    _times(report, result, clock.seconds)
    report.heading("Files beside this report")
    report.text("One folder per image:")
    report.table(["file", "content"], _files(result))
    report.provenance(Provenance.of_project(project, sources or {}))
    return report


def _scene_words(result: RunResult) -> str:
    """What there is to be seen in 3D."""
    if result.mesh is None or not any(item.values is not None for item in result.images):
        return "Cameras and markers. Under the cursor: names and places."
    return ("The model with its values, cameras and markers; grey: no value. Under the cursor: values with their "
            "sigma, names, residuals.")  # fmt: skip


def _files(result: RunResult) -> list[tuple[str, str]]:
    """Those of `FILES` that are written of any image, and of merged ones."""
    images = result.images
    written = (
        any(i.detections is not None for i in images), any(i.registered is not None for i in images),
        any(i.cam_from_model is not None for i in images), any(i.values is not None for i in images),
        any(i.pixels is not None for i in images), any(i.views for i in images), any(i.sections for i in images),
        any(i.aligned is not None for i in images),
    )  # fmt: skip
    points = any(i.points for i in images) or any(m.points for m in result.merged)
    merged = (*[bool(result.merged)] * (len(merge_report.FILES) - 1), points)
    rows = zip((*FILES, *merge_report.FILES), (*written, *merged), strict=True)
    return [row for row, there in rows if there]


def worst_first(images: Sequence[ImageResult]) -> list[ImageResult]:
    """What went wrong, then by the RMS of the residuals, then what has none."""

    def rank(item: ImageResult) -> tuple[int, float]:
        answer = item.registered
        rms = answer.rms_px if answer is not None and len(answer.matching) else np.nan
        return 0 if item.problem else 1, -float(rms) if np.isfinite(rms) else 0.0

    return sorted(images, key=rank)


def _images(report: Report, order: Sequence[ImageResult], result: RunResult, many: bool) -> None:
    """A part for each image; of many an index with small pictures, and the parts packed until they are opened."""
    rooms = {item.name: FURTHER if k else FIRST for k, item in enumerate(order)}
    ident = {item.name: f"image-{k + 1}" for k, item in enumerate(result.images)}

    def one(item: ImageResult) -> tuple[Report, str]:
        own, small = Report("", folder=report.folder), ""
        shown = None
        if item.image is not None:
            with own.part(f"{item.name}: the picture"):
                shown = greys(item.image)
        with own.folded(ident[item.name], f"<b>{escape(item.name)}</b>: {escape(in_short(item))}",
                        packed=item is not order[0] or many, closed=many):  # fmt: skip
            image_part(own, item, result, rooms[item.name], shown)
        if many and shown is not None:
            with own.part(f"{item.name}: small picture"):
                small = thumbnail(shown, FURTHER.thumbnail)
        return own, small

    with ThreadPoolExecutor(max_workers=os.cpu_count() or 1) as pool:
        made = list(pool.map(one, order))
    report.heading("Images" + (", worst first" if len(order) > 1 else ""))
    if len(order) > 1:
        report.text("The first, the worst, is shown at its best; the pictures of the others are packed "
                    "tighter, and may be coarser, beside the pixels round their worst spots.", "soft")  # fmt: skip
    if many:
        cards = "".join(
            f'<a href="#{ident[item.name]}">' + (f'<img alt="" loading="lazy" src="{small}">' if small else "")
            + f'<b>{escape(item.name)}</b><span class="{"bad" if item.problem else "soft"}">{escape(in_short(item))}'
            "</span></a>" for item, (_, small) in zip(order, made, strict=True)
        )  # fmt: skip
        report.raw(f'<div class="wm-index">{cards}</div>')
    for own, _ in made:
        report.absorb(own)


def in_short(item: ImageResult) -> str:
    """An image in a few words."""
    if item.problem:
        return item.problem
    answer = item.registered
    if answer is None or not len(answer.matching):
        return "done"
    return f"{len(answer.matching)} markers, RMS {g2(answer.rms_px)} px"


def overview(report: Report, result: RunResult) -> None:
    """The table of all images, and what went wrong."""
    rows = []
    for item in result.images:
        answer = item.registered
        rows.append((
            item.name,
            None if item.detections is None else len(item.detections),
            None if answer is None else len(answer.matching),
            None if answer is None or not len(answer.matching) else float(g2(answer.rms_px)),
            None if answer is None else power_of_ten(answer.log10_nfa),
            None if item.values is None else int(np.isfinite(item.values).sum()),
            duration(sum(item.seconds.values())),
            item.problem or "done",
        ))  # fmt: skip
    head = ["image", "spots", "markers matched", "RMS px", "false-alarm number", "nodes with value", "time s", "status"]
    told = [k for k in range(len(head)) if not rows or any(row[k] is not None for row in rows)]
    report.table([head[k] for k in told], [[row[k] for k in told] for row in rows], scroll=len(rows) > OPEN_IMAGES)
    if any(item.registered is not None for item in result.images):
        report.text(
            "RMS is the root mean square length of the residual vector (2-D). The false-alarm number is how many wrong"
            " poses this good one would expect from chance alone in this image: 10⁻⁹ and below is accepted.",
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
            ", ".join(f"{round(v, 4) + 0.0:.10g}" for v in (pov.rx_deg, pov.ry_deg, pov.rz_deg)),
            ", ".join(f"{round(v, 4) + 0.0:.10g}" for v in (pov.dx, pov.dy, pov.dz)), f"{pov.fov_deg:.4g}", view.how,
        ))  # fmt: skip
    report.table(
        ["view", "size px", f"{unit} per px", "rx, ry, rz deg", f"dx, dy, dz {unit}", "fov deg", "point of view"], rows
    )


def _truth(report: Report, truth: Comparison) -> None:
    report.heading("Compared with the truth")
    report.text(truth.verdict, "good" if truth.good else "bad")
    report.table(truth.columns, truth.rows)
    report.text(truth.explanation, "soft")


def _times(report: Report, result: RunResult, seconds: dict[str, float]) -> None:
    report.heading("Times")
    stages = [
        stage for stage in dict.fromkeys(stage for item in result.images for stage in item.seconds)
        if any(item.seconds.get(stage, 0.0) >= NO_TIME_S for item in result.images)
    ]  # fmt: skip
    if result.images:
        report.table(["image", *(f"{stage}, s" for stage in stages)],
                     [(item.name, *(duration(item.seconds.get(stage)) for stage in stages)) for item in result.images],
                     scroll=len(result.images) > OPEN_IMAGES)  # fmt: skip
    whole = (*result.seconds.items(), *seconds.items())
    report.table(["stage of the whole job", "s"], [(stage, duration(s)) for stage, s in whole])
