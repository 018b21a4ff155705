"""Pictures of the marker study: the paper's Figures 3 and 4 drawn again, and the page that shows them."""

from __future__ import annotations

from datetime import datetime
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

import windmark
from windmark.app.report import Report
from windmark.app.wording import named, setting
from windmark.pipeline.study import Example, Study, StudySettings, examples

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

CLAIM_PX = 0.1  # the paper's uncertainty for radii of 3 px and more
CLAIM_FROM_PX = 3.0
TRUE, BOUND, CLAIM = "#ff1744", "0.15", "#d50000"
METHOD_COLOURS = ("#00b0ff", "#ffea00", "#00e676", "#e040fb")
METHOD_STYLES = (("-", "o"), (":", "s"), ("-.", "^"), ((0, (5, 1, 1, 1, 1, 1)), "D"))
FEW: dict[str, Any] = {"ls": "", "mfc": "white"}  # points of less than half of the markers
METHOD_NAMES = {"bowl": "bowl (SPOT)"}
ENLARGED = 2  # markers along each side of the enlarged part


def sheets_picture(sharp: Example, noisy: Example, settings: StudySettings) -> Figure:
    """Figure 3: the sheets without and with blur and noise, below each a part enlarged with its centres."""
    figure = Figure(figsize=(10.6, 11.6), layout="constrained")
    cells = figure.subplots(2, 2)
    top = sharp.image.max()
    passes = f"{settings.blur_passes} blur pass{'' if settings.blur_passes == 1 else 'es'}"
    titles = ("a) no blur, no noise", f"b) {passes}, {settings.noise_percent:g} % noise")
    for (above, below), example, title in zip(cells.T, (sharp, noisy), titles, strict=True):
        for axes in (above, below):
            axes.imshow(example.image, cmap="gray", vmin=0, vmax=1.15 * top, interpolation="nearest")
            axes.set_xlabel("x, px")
        above.set_title(title)
        _mark_centres(below, example, settings)
        _frame(above, below)
    cells[0, 0].set_ylabel("y, px")
    cells[1, 0].set_ylabel("y, px (enlarged)")
    _centres_legend(figure, noisy)
    figure.suptitle(
        f"Virtual markers of radius {sharp.radius_px:g} px: {len(sharp.truth)} with random centres"
        f" and viewing angles up to {settings.max_tilt_deg:g}°"
    )
    return figure


def _mark_centres(axes: Axes, example: Example, settings: StudySettings) -> None:
    """The upper left part of the sheet with true and found centres."""
    pitch = example.image.shape[1] / settings.grid[0]
    axes.set_xlim(-0.5, min(ENLARGED, settings.grid[0]) * pitch - 0.5)
    axes.set_ylim(min(ENLARGED, settings.grid[1]) * pitch - 0.5, -0.5)
    axes.plot(*example.truth.xy.T, "+", color=TRUE, ms=13, mew=1.3)
    for k, (spots, colour) in enumerate(zip(example.spots.values(), cycle(METHOD_COLOURS), strict=False)):
        axes.plot(*spots.xy.T, "o", mfc="none", mec=colour, ms=6 + 4 * k, mew=1.2)


def _frame(above: Axes, below: Axes) -> None:
    """Where the enlarged part is in the sheet."""
    right, lower = below.get_xlim()[1], below.get_ylim()[0]
    above.plot([-0.5, right, right, -0.5, -0.5], [-0.5, -0.5, lower, lower, -0.5], color=TRUE, lw=1.0)


def _centres_legend(figure: Figure, example: Example) -> None:
    handles = [Line2D([], [], ls="", marker="+", color=TRUE, ms=11, label="true centre")]
    for method, colour in zip(example.spots, cycle(METHOD_COLOURS), strict=False):
        handles.append(
            Line2D([], [], ls="", marker="o", mfc="none", mec=colour, ms=7, label=f"found: {_name(method)}")
        )  # fmt: skip
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=True, facecolor="0.6")


def curves_picture(study: Study) -> Figure:
    """Figure 4: 2 RMS against the real radius, one curve per reference radius and method, and what was missed."""
    figure = Figure(figsize=(11.5, 7.4), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3.2, 1))
    settings = study.settings
    for r0, colour in zip(settings.radii_px, _colours(len(settings.radii_px)), strict=True):
        for method, (line, mark) in zip(settings.methods, cycle(METHOD_STYLES), strict=False):
            rows = study.curve(r0, method)
            look: dict[str, Any] = {"color": colour, "ls": line, "marker": mark, "ms": 4.5, "lw": 1.6}
            few = 2 * study.missed[rows] > study.markers[rows]
            upper.plot(study.radius_px[rows], study.two_rms_px[rows], **look)
            upper.plot(study.radius_px[rows[few]], study.two_rms_px[rows[few]], **look | FEW)
            lower.plot(study.radius_px[rows], 100 * study.missed[rows] / study.markers[rows], **look)
    radius, crlb = bound_curve(study)
    upper.plot(radius, 2 * crlb, color=BOUND, ls="--", lw=1.3)
    upper.axhline(CLAIM_PX, color=CLAIM, lw=1.0)
    upper.set(ylabel="2 RMS error per axis, px", ylim=(0, 1.12 * max(CLAIM_PX, float(np.nanmax(_shown(study))))))
    lower.set(ylabel="not found, %", xlabel="real radius of the markers, px")
    lower.set_ylim(0, max(10.0, 1.1 * float((100 * study.missed / study.markers).max())))
    for axes in (upper, lower):
        axes.grid(alpha=0.3)
        axes.margins(x=0.02)
    upper.set_title(_conditions(settings))
    handles = _curve_handles(settings)
    if (2 * study.missed > study.markers).any():
        handles.append(Line2D([], [], color="0.35", marker="o", ms=4.5, **FEW, label="more than half not found"))
    figure.legend(handles=handles, loc="outside right upper", fontsize=9)
    return figure


def bound_curve(study: Study) -> tuple[Array, Array]:
    """Cramer-Rao bound per axis of whole sheets against the real radius; sheets of one radius are taken together."""
    first = study.method == study.settings.methods[0]
    radius, index = np.unique(np.round(study.radius_px[first], 9), return_inverse=True)
    variance = np.bincount(index, weights=study.crlb_px[first] ** 2) / np.bincount(index)
    return radius, np.sqrt(variance)


def _shown(study: Study) -> Array:
    return np.concatenate([study.two_rms_px, 2 * study.crlb_px, [CLAIM_PX]])


def _curve_handles(settings: StudySettings) -> list[Line2D]:
    """Colours say the reference radius, lines the method."""
    handles = [
        Line2D([], [], color=colour, lw=3, label=f"reference radius {r0:g} px")
        for r0, colour in zip(settings.radii_px, _colours(len(settings.radii_px)), strict=True)
    ]
    for method, (line, mark) in zip(settings.methods, cycle(METHOD_STYLES), strict=False):
        handles.append(Line2D([], [], color="0.35", ls=line, marker=mark, ms=4.5, lw=1.6, label=_name(method)))
    handles.append(Line2D([], [], color=BOUND, ls="--", lw=1.3, label="Cramér–Rao bound"))
    return [
        *handles,
        Line2D(
            [], [], color=CLAIM, lw=1.0, label=f"{CLAIM_PX} px, the paper’s\nuncertainty from {CLAIM_FROM_PX:g} px on"
        ),
    ]


def _colours(count: int) -> Array:
    """Distinct on white, dark to light."""
    return colormaps["viridis"](np.linspace(0.0, 0.82, count))


def _name(method: str) -> str:
    return METHOD_NAMES.get(method, method)


def _conditions(settings: StudySettings) -> str:
    columns, rows = settings.grid
    passes = f"{settings.blur_passes} blur pass{'' if settings.blur_passes == 1 else 'es'}"
    return (
        f"{columns * rows} markers per point, {settings.noise_percent:g} % noise, {passes},"
        f" viewing angles up to {settings.max_tilt_deg:g}°"
    )


SUMMARY = {
    "r0_px": "reference radius, px", "method": "method", "markers": "markers", "missed": "not found",
    "false_spots": "false spots", "two_rms_px": "2 RMS, px", "worst_two_rms_px": "worst 2 RMS of a real radius, px",
    "two_crlb_px": "2 Cramér–Rao bound, px", "rms_over_crlb": "RMS / bound",
}  # fmt: skip


def study_page(study: Study, place: Path) -> Report:
    """The study on one HTML page that opens without a network; its pictures go into ``place``, too."""
    when = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    report = Report("Marker uncertainty study", f"windmark {windmark.__version__}, {when}")
    report.text(
        "Virtual markers of known place are made and detected, as in AIAA 2005-5007, section II.C. The detector gets"
        " the reference radius; the real radius is up to"
        f" {study.settings.span_px:g} px smaller or larger. Errors are per axis; uncertainty is 2 RMS, as in the paper."
    )
    report.heading("Error against the real radius (the paper’s Figure 4)")
    drawn = report.drawing("picture of the error", lambda: curves_picture(study),
                           "2 RMS error per axis, and share of the markers that were not found", dpi=120)  # fmt: skip
    if drawn is not None:
        (place / "error.png").write_bytes(drawn)
    _precision(report, study)
    report.heading("All real radii of a reference radius together", 3)
    report.table(list(SUMMARY.values()), ([row[key] for key in SUMMARY] for row in study.summary()))
    report.heading("Virtual markers (the paper’s Figure 3)")
    drawn = report.drawing("picture of the markers",
                           lambda: sheets_picture(*examples(study.settings), study.settings),
                           "One sheet without and with blur and noise; below, its upper left part enlarged",
                           dpi=120)  # fmt: skip
    if drawn is not None:
        (place / "markers.png").write_bytes(drawn)
    report.heading("Every point")
    columns = study.columns()
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    report.table([named(key) for key in columns], rows, scroll=True)
    report.heading("Settings")
    settings = study.record()["settings"]
    report.table(["setting", "value"], [[named(key), setting(value)] for key, value in settings.items()])
    return report


def _precision(report: Report, study: Study) -> None:
    """How far the figures themselves may be trusted, and what the bound is."""
    found = int(np.median(study.markers - study.missed))
    if found:
        report.text(
            f"Each point is the RMS of about {2 * found} errors and itself uncertain by"
            f" {100 / np.sqrt(4 * found):.0f} % (1 sigma).", "soft",
        )  # fmt: skip
    report.text(
        "The Cramér–Rao bound is the error that no unbiased method can beat in these images when centre, depth,"
        " background and slope of the light are unknown (shape and blur hardly matter for the centre). In the picture"
        " it is that of all markers; in the tables that of the markers found, because the strongly tilted ones are"
        " found less often and known less well.", "soft",
    )  # fmt: skip
    if not np.isfinite(study.crlb_px).all():
        report.text(
            "Where there is a dash there is no bound: a marker that lies within one pixel, without blur, may be"
            " anywhere in it, and no method can tell where.",
        )  # fmt: skip
