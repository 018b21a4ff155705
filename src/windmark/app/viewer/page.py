"""The viewer's page: a run's pictures, spots and model as its report has them, with what the viewer adds."""

from __future__ import annotations

import json
import os
from concurrent.futures import ThreadPoolExecutor
from html import escape
from typing import Any

import numpy as np

from windmark import detection, io
from windmark.app import web
from windmark.app.photo import FIRST, FURTHER, Overlay, Room, greys, preview
from windmark.app.report import Report
from windmark.app.run_images import photo
from windmark.app.run_report import OPEN_IMAGES, in_short, overview, worst_first
from windmark.app.run_scene import run_scene
from windmark.app.verdict_words import put_verdict
from windmark.app.viewer.pov import EDGES, LINES_PER_BLOCK, NUMBERS, first_pov
from windmark.app.viewer.session import Shown
from windmark.errors import UsageError
from windmark.pipeline.changes import Change, SeenImage
from windmark.pipeline.results import ImageResult, RunResult
from windmark.pipeline.verdict.run import run_verdict
from windmark.pipeline.wireframe import grid_lines

BAR = (
    '<div class="wm-bar-top"><div><button type="button" class="wm-run">run again</button>'
    '<span class="wm-status" role="status"></span></div><ul class="wm-edits"></ul></div>'
)
DATA = "wm-view-data"


def waiting_page(title: str) -> str:
    """Before the first run is done."""
    report = Report(title, "windmark view")
    report.raw(BAR)
    _data(report, {"run": 0, "images": {}, "markers": []})
    return _html(report)


def page(shown: Shown) -> str:
    """Everything of a run."""
    result = shown.result
    project = result.project
    report = Report(project.title, f"windmark view of {project.path.name}; length unit: {project.length_unit}",
                    folder=project.path.parent)  # fmt: skip
    report.raw(BAR)
    report.text(
        f"The result folder {project.output.folder.name} has this run." if shown.written else
        "This is what the project gives now; nothing was written. “run again” writes the result folder "
        f"{project.output.folder.name}, as windmark run does.", "soft",
    )  # fmt: skip
    if shown.changed:
        _changes(report, shown.changed, project.length_unit)
    overview(report, result)
    order = worst_first(result.images)
    _pictures(report, order, result)
    report.heading("In 3D")
    report.scene("3D view", lambda: run_scene(result, order), "The model with its values, cameras and markers; "
                 "grey: no value. Under the cursor: values with their sigma, names, residuals.")  # fmt: skip
    put_verdict(report, run_verdict(result))
    _data(report, {
        "run": shown.number,
        "markers": [] if result.markers is None else [str(n) for n in result.markers.name],
        "unit": project.length_unit,
        "images": {item.name: _image_data(item, result) for item in result.images},
    })  # fmt: skip
    return _html(report)


def _html(report: Report) -> str:
    style, script = web.viewer()
    # Without an icon a browser asks for one, without the token.
    return report.html(style, script).replace("<head>", '<head><link rel="icon" href="data:,">', 1)


def _data(report: Report, record: dict[str, Any]) -> None:
    report.data[DATA] = json.dumps(record).replace("<", "\\u003c")


def _image_data(item: ImageResult, result: RunResult) -> dict[str, Any]:
    """What the page's scripts must know of an image."""
    names: dict[int, str] = {}
    if item.registered is not None and result.markers is not None:
        match = item.registered.matching
        found = result.markers.name[match.marker]
        names = {int(k): str(n) for k, n in zip(match.detection, found, strict=True)}
    pov = first_pov(item, result)
    numbers = dict(zip(NUMBERS, (pov.rx_deg, pov.ry_deg, pov.rz_deg, pov.dx, pov.dy, pov.dz, pov.fov_deg), strict=True))
    return {
        "size": item.camera.size_px, "names": names, "pov": numbers, "posed": item.cam_from_model is not None,
        "grid": result.mesh is not None, "reach": max(float(np.hypot(pov.dx, np.hypot(pov.dy, pov.dz))), 1e-9),
        "look": can_explain(item, result),
    }  # fmt: skip


def _pictures(report: Report, order: list[ImageResult], result: RunResult) -> None:
    """Of many images each is packed until it is opened, as in the report."""
    many = len(order) > OPEN_IMAGES
    ident = {item.name: f"image-{k + 1}" for k, item in enumerate(result.images)}

    def one(item: ImageResult) -> Report:
        own = Report("", folder=report.folder)
        with own.folded(ident[item.name], f"<b>{escape(item.name)}</b>: {escape(in_short(item))}", packed=many,
                        closed=many):  # fmt: skip
            own.raw(f'<div class="wm-view" data-image="{escape(item.name)}">')
            if item.problem:
                own.text(item.problem, "bad")
            if item.image is not None and item.detections is not None:
                with own.part(f"{item.name}: picture of the spots"):
                    photo(own, item, result, FURTHER if many else FIRST, greys(item.image))
            elif item.image is not None:
                with own.part(f"{item.name}: the picture"):
                    _bare(own, item, result, FURTHER if many else FIRST)
            own.raw("</div>")
        return own

    with ThreadPoolExecutor(max_workers=os.cpu_count() or 1) as pool:
        made = list(pool.map(one, order))
    report.heading("Pictures" + (", worst first" if len(order) > 1 else ""))
    report.text("A click on a spot names it, excludes it, or frees it again; that is written into the project file. "
                "Under the cursor: place, sigma and merit. By keyboard: arrows and Enter.", "soft")  # fmt: skip
    for own in made:
        report.absorb(own)


def _bare(report: Report, item: ImageResult, result: RunResult, room: Room) -> None:
    """A picture in which no spots were looked for, as its camera's pose is known, or in which no radius prevailed."""
    assert item.image is not None
    height, width = item.image.shape[:2]
    over = Overlay((width, height))
    if result.mesh is not None and item.nodes is not None:
        lines = grid_lines(result.mesh, item.nodes, per_block=LINES_PER_BLOCK, edges=EDGES)
        over.wires(lines, "visible grid lines, projected")
    report.raw(over.html(preview(greys(item.image), room.photo)[0], f"{item.name}: without spots."))


def _changes(report: Report, changed: tuple[Change, ...], unit: str) -> None:
    """Before and after, an image a row."""
    report.heading("What changed")
    rows = []
    for one in changed:
        rows.append((
            one.image, _status(one.before), _status(one.after), _names(one),
            *(None if s is None or not s.names else len(s.names) for s in (one.before, one.after)),
            *(None if s is None else s.rms_px for s in (one.before, one.after)), one.angle_deg, one.distance,
        ))  # fmt: skip
    report.raw('<div class="wm-changed">')
    report.table(["image", "before", "after", "names", "markers before", "after", "RMS px before", "after",
                  "turned deg", f"camera moved {unit}"], rows, scroll=len(rows) > OPEN_IMAGES)  # fmt: skip
    report.raw("</div>")


def _status(one: SeenImage | None) -> str:
    return "not there" if one is None else one.status


def _names(change: Change) -> str:
    kinds = {"new": change.gained, "gone": change.lost, "at another spot": change.moved}
    return "; ".join(f"{word}: {', '.join(names)}" for word, names in kinds.items() if names) or "the same"


def can_explain(item: ImageResult, result: RunResult) -> bool:
    """Whether rejected candidates can be asked for."""
    return item.image is not None and item.detections is not None and result.project.detect is not None


def rejected(item: ImageResult, result: RunResult) -> list[list[Any]]:
    """Candidates that detection looked at and rejected: [x, y, radius, merit, reason], NaN as None.

    Raises
    ------
    UsageError
        Where nothing was detected in this picture.
    """
    options = result.project.detect
    if not can_explain(item, result) or options is None or item.image is None:
        raise UsageError(f"{item.name}: no spots were looked for in this picture")
    mask = None if options.mask is None else io.read_mask(options.mask, item.image.shape[:2])
    look = detection.find_markers(
        item.image, polarity=item.polarity, rejected=True, radius_px=options.radius_px, merit_max=options.merit_max,
        refine=options.refine, photometry=options.photometry, mask=mask,
    )  # fmt: skip
    if look.rejected is None:
        return []
    some = look.rejected
    columns = [np.column_stack([some.xy, some.radius_px, some.merit]).round(4).tolist(), some.words]
    return [[*(v if v == v else None for v in numbers), words] for numbers, words in zip(*columns, strict=True)]
