"""One image's part of the main job's report: spots and markers over the picture, pose, residuals, values."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from windmark.app import figures, merge_report
from windmark.app.photo import Overlay, Room, preview, scale_bar, tiles
from windmark.app.pictures import png
from windmark.app.report import Report
from windmark.app.spot_words import spot_notes
from windmark.app.svg import LINE_COLOURS, Chart
from windmark.errors import earned_decimals, g2
from windmark.pipeline.outputs import pose_difference
from windmark.pipeline.results import ImageResult, RunResult, SectionValues, ViewImage
from windmark.pipeline.wireframe import grid_lines
from windmark.registration import Registration
from windmark.scene import MarkerSet

LINES_PER_BLOCK = 16
"""Grid lines each way of a block that are drawn over a picture."""

LEAST_SHOWN = 3
"""Places with a value that a line of a cut needs to be drawn: fewer are not to be seen."""

NODE_STATES = {
    "visible": "seen, with a value",
    "blanked": "not part of the surface (blanked, or in no volume of the job)",
    "lens": "beyond the range of the lens model",
    "outside": "outside the image",
    "facing_away": "facing away",
    "oblique": "seen too obliquely",
    "hidden": "hidden by another part",
}



def image_part(
    report: Report, item: ImageResult, result: RunResult, room: Room, shown: NDArray[np.uint8] | None
) -> None:
    """Everything on one image, within ``room``; ``shown``: its pixels, see `photo.greys`."""
    if item.problem:
        report.text(item.problem, "bad")
    for said in filter(None, (item.filled, item.said, item.saturated, item.dark, item.dead, item.smoothed)):
        report.text(f"{said[0].upper()}{said[1:]}.")
    if item.radius:
        report.text(item.radius.reason, "soft")
    if item.nodes is not None and item.values is not None:
        report.raw(f'<p><button type="button" data-field="{escape(item.name)}">show its values in 3D</button></p>')
    if shown is not None and item.detections is not None:
        with report.part(f"{item.name}: picture of the spots"):
            photo(report, item, result, room, shown)
    if item.registered is not None and result.markers is not None and shown is not None:
        _registration(report, item, item.registered, result.markers, result.project.length_unit, room, shown)
    if item.nodes is not None and item.values is not None:
        _mapping(report, item)
    for view in item.views:
        with report.part(f"{item.name}: picture of view {view.name}"):
            view_part(report, view, result.project.length_unit, room)
    for section in item.sections:
        with report.part(f"{item.name}: picture of section {section.name}"):
            report.chart(section_chart(section, result.project.length_unit, item.quantity.label),
                         f"Values along the cut “{section.name}”.")  # fmt: skip
    with report.part(f"{item.name}: points and lines"):
        merge_report.tables(report, item.points, result.project.length_unit, item.quantity.label)
    with report.part(f"{item.name}: picture of the alignment"):
        alignment = figures.alignment_figure(item, result)
        if alignment is not None:
            report.picture(png(alignment), "3D alignment: what differs before and after the motion is compensated.")


def photo(
    report: Report, item: ImageResult, result: RunResult, room: Room, shown: NDArray[np.uint8]
) -> None:
    """The picture with all that was found in it; the circles of the spots are in the order of its detections."""
    spots, answer, markers = item.detections, item.registered, result.markers
    assert spots is not None
    over = Overlay(item.camera.size_px)
    if result.mesh is not None and item.nodes is not None:
        with report.part(f"{item.name}: picture of the grid lines"):
            lines = grid_lines(result.mesh, item.nodes, per_block=LINES_PER_BLOCK, edges=4000)
            over.wires(lines, "visible grid lines, projected", room.wires)
    matched = np.zeros(len(spots), dtype=bool)
    notes = spot_notes(spots)
    if answer is None or markers is None:
        over.spots(spots, matched, notes, ("", f"spot ({len(spots)})"))
        report.raw(over.html(preview(shown, room.photo)[0], f"{item.name}: detected spots."))
        return
    names, _, residual = figures.matched(item, markers)
    at = answer.matching.detection
    matched[at] = True
    for name, k, (dx, dy) in zip(names, at.tolist(), residual.tolist(), strict=True):
        notes[k] = f"{name}: {notes[k]}; residual {dx:+z.3f}, {dy:+z.3f} px".replace("-", "−")
    over.spots(spots, matched, notes, (f"matched spot ({len(at)})", f"spot of no marker ({int((~matched).sum())})"))
    missing = np.setdiff1d(item.expected if item.expected is not None else [], answer.matching.marker).astype(int)
    missing_xy = answer.camera.project(answer.cam_from_model.apply(markers.xyz[missing]))[0]
    over.missing(missing_xy, [str(n) for n in markers.name[missing]], f"marker expected, no spot ({len(missing)})")
    over.residuals(spots.xy[at], residual, names, "residual")
    report.raw(over.html(preview(shown, room.photo)[0], f"{item.name}: which spot is which marker."))


def _registration(
    report: Report, item: ImageResult, answer: Registration, markers: MarkerSet, unit: str, room: Room,
    shown: NDArray[np.uint8],
) -> None:  # fmt: skip
    assert item.detections is not None
    _pose_table(report, item, answer, unit)
    _together(report, item)
    if answer.excess_px > 0.0:
        report.text(
            f"The residuals ask for {g2(answer.excess_px)} px (1 sigma per coordinate) beyond the spots' noise, as if"
            f" the markers were {g2(answer.off_table)} {unit} off their table; the sigmas above have it.",
            "soft",
        )
    if answer.unchecked:
        report.listed("This picture cannot tell:", (u.words for u in answer.unchecked), "soft")
    if not len(answer.matching):
        return
    names, projected, residual = figures.matched(item, markers)
    size = np.hypot(*residual.T)
    report.heading("Residuals of the markers", 3)
    with report.part(f"{item.name}: picture of the residuals"):
        report.chart(residual_chart(names, residual), "Residuals, projected − detected.")
    xy, merit = (column[answer.matching.detection] for column in (item.detections.xy, item.detections.merit))
    report.table(
        ["marker", "x px", "y px", "dx px", "dy px", "distance px", "merit"],
        [
            (names[k], *(f"{v:z.3f}" for v in (*xy[k], *residual[k], size[k])), float(merit[k]))
            for k in np.argsort(names)
        ],
        scroll=True,
    )
    report.side_by_side(2)
    with report.part(f"{item.name}: pixels of the spots"):
        worst = np.argsort(-size, kind="stable")[: room.tiles]
        report.raw(tiles(shown, xy[worst], projected[worst], [names[k] for k in worst],
                         [f"{size[k]:.3f} px" for k in worst]))  # fmt: skip
        report.text("The spots with the largest residuals, pixel by pixel: green cross the spot's centre, yellow cross "
                    "where the marker is expected.", "soft")  # fmt: skip


def residual_chart(names: Sequence[str], residual: np.ndarray) -> str:
    """Residuals (K, 2) projected − detected, with the RMS circle, one name each."""
    rms = float(np.sqrt(np.mean(np.sum(residual**2, axis=1))))
    half = 1.15 * max(float(np.abs(residual).max(initial=0.0)), rms, 1e-3)
    chart = Chart((-half, half), (half, -half), ("dx, px", "dy, px"), f"RMS {g2(rms)} px (dashed circle)", (430, 420),
                  equal=True)  # fmt: skip
    chart.circle(rms)
    chart.dots(residual[:, 0], residual[:, 1],
               [f"{n}: {dx:+z.3f}, {dy:+z.3f} px" for n, (dx, dy) in zip(names, residual.tolist(), strict=True)],
               list(names))  # fmt: skip
    return chart.svg()


def section_chart(section: SectionValues, unit: str, label: str) -> str:
    """Values along a cut of the surface over the coordinate that changes most."""
    along = int(np.argmax(np.ptp(section.xyz, axis=0)))
    x, value = section.xyz[:, along], section.value.astype(float)
    good = np.isfinite(value)
    lines = [k for k in np.unique(section.line) if good[section.line == k].sum() >= LEAST_SHOWN]
    shown = value[good] if good.any() else np.array([0.0, 1.0])
    margin = 0.04 * float(np.ptp(shown))
    chart = Chart((float(x.min()), float(x.max())), (float(shown.min()) - margin, float(shown.max()) + margin),
                  (f"{'xyz'[along]}, {unit}", label),
                  f"Section “{section.name}”: gaps are where the camera does not see the surface")  # fmt: skip
    for n, k in enumerate(lines):
        mine = section.line == k
        chart.curve(x[mine], value[mine], LINE_COLOURS[n % len(LINE_COLOURS)], f"line {k + 1}")
    if 1 < len(lines) <= 8:
        chart.legend([(LINE_COLOURS[n % len(LINE_COLOURS)], f"line {k + 1}") for n, k in enumerate(lines)])
    return chart.svg()


def view_part(report: Report, view: ViewImage, unit: str, room: Room) -> None:
    """A virtual image with a scale bar."""
    over = Overlay(view.camera.size_px)
    words = f"scale: {view.units_per_px:.4g} {unit} per pixel"
    bar = scale_bar(over.size_px, view.units_per_px, unit, view.valid)
    over.layers["bar"] = (escape(words), f'<g class="bar">{bar}</g>')
    shown = np.where(view.valid, view.image, np.nan)
    report.raw(over.html(preview(shown, room.photo // 3)[0],
                         f"The image recomputed for another point of view: “{view.name}”. Black: not seen by the "
                         "camera."))  # fmt: skip


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
        f" follows from all of them, and the false-alarm number is that of all; RMS of all {g2(found.rms_px)} px."
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
            *_rows("angles, deg", (pov.rx_deg, pov.ry_deg, pov.rz_deg), (sigma.rx_deg, sigma.ry_deg, sigma.rz_deg)),
            *_rows(f"distances, {unit}", (pov.dx, pov.dy, pov.dz), (sigma.dx, sigma.dy, sigma.dz)),
            *_rows(f"camera station in the model's frame, {unit}", pose.center.tolist(), station.tolist()),
        ],
    )
    report.text(
        f"Field of view {pov.fov_deg:.3f} deg, focal length {answer.camera.focal_px:.2f} px;"
        f" {answer.report.words}.",
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


def _rows(what: str, values: Sequence[float], sigmas: Sequence[float]) -> list[tuple[str, ...]]:
    """Three numbers and their sigmas: of the least sigma two digits, of the numbers as many."""
    decimals = earned_decimals(sigmas)
    return [(head, *(f"{v:z.{decimals}f}" for v in row)) for head, row in ((what, values), ("1 sigma", sigmas))]


def _mapping(report: Report, item: ImageResult) -> None:
    nodes, values = item.nodes, item.values
    assert nodes is not None
    assert values is not None
    report.heading("Values on the grid", 3)
    report.table(
        ["nodes", "count", "share %"],
        [(NODE_STATES[k], n, f"{100 * n / max(len(values), 1):.1f}") for k, n in nodes.counts.items() if n],
    )
    if item.quantity.words:
        report.text(f"{item.quantity.words[0].upper()}{item.quantity.words[1:]}.")
