"""The report's part on merged images, and on values at points and along lines."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from windmark.app import merge_pictures, pictures
from windmark.app.pictures import png
from windmark.app.report import Report, fixed
from windmark.errors import g2, g3
from windmark.pipeline.merge import MergeResult
from windmark.pipeline.merge_outputs import merge_summary, table_summary
from windmark.pipeline.points import MergedTable, PointTable

MOST_ROWS = 400
"""Points that the report lists; files have all."""

FILES = (
    ("merged*/nodes.*", "merged values on the grid: value, sigma, source (0 the first image of merged.json's legend, -1"
     " none), number of images"),
    ("merged*/view-*.tif, -sigma.tif, -source.tif", "merged virtual images, their sigma, and the image that counts most"
     " (1 the first, 0 none)"),
    ("merged*/merged.json, seams.csv", "gains, legend, seam steps; every node on a seam"),
    ("points-*, line-* .csv, .dat, .nc", "values at points and along lines, with sigma and the reason where there is"
     " none: CSV, Tecplot, NetCDF"),
)  # fmt: skip

REASONS = {
    "oblique": "seen too obliquely", "hidden": "hidden by another part", "outside": "outside the image",
    "facing_away": "facing away", "lens": "beyond the range of the lens model", "far": "too far from the surface",
    "either_side": "as near to both sides of a thin part (give the point's normal)",
    "no_pixel": "no value in the image",
    "no_place": "no coordinates", "blanked": "not part of the surface",
}  # fmt: skip
"""Words for the reasons of a point without value."""


def merged_part(report: Report, item: MergeResult, unit: str) -> None:
    """One point of the test: all its images on one surface."""
    report.heading("Merged images" if item.point is None else f"Merged images of point {item.point}")
    for name, why in item.missing.items():
        report.text(f"{name} is left out: {why}", "bad")
    merged = item.merged
    if merged is None:
        report.text(f"Not merged: {getattr(item.outcome, 'reason', '')}", "bad")
        return
    record = merge_summary(item)
    _gains(report, item, record)
    report.text(
        f"{record['nodes_with_value']} nodes have a value, {record['nodes_of_several']} of them from several images;"
        f" their sigma is {g2(record['sigma_percent'])} % (median)."
    )
    title = f"Merged: {', '.join(merged.names)}"
    report.drawing(f"{item.folder}: picture of the values",
                   lambda: merge_pictures.value_figure(merged, title, item.quantity.label),
                   "Merged values, seen from between the cameras. Grey: no image sees it.")  # fmt: skip
    report.drawing(f"{item.folder}: picture of the sources", lambda: merge_pictures.source_figure(merged),
                   "The image with the largest weight at each place.")  # fmt: skip
    report.drawing(f"{item.folder}: picture of the sigma", lambda: merge_pictures.sigma_figure(merged),
                   "Standard deviation: noise, poses, gains and the images' systematic difference.")  # fmt: skip
    with report.part(f"{item.folder}: seams"):
        _seams(report, item, record, unit)
    for view in item.views:
        report.drawing(f"{item.folder}: picture of view {view.view.name}",
                       partial(pictures.view_picture, view.view, unit),
                       f"All images recomputed for one point of view: “{view.view.name}”.")  # fmt: skip
    tables(report, item.points, unit, item.quantity.label)


def _gains(report: Report, item: MergeResult, record: dict) -> None:
    merged = item.merged
    assert merged is not None
    rows = []
    for k, name in enumerate(merged.names):
        g = record["gain"][name]
        shared = int(np.sort(merged.gains.overlap[k])[-2])  # the largest is with itself
        rows.append((name, f"{g['gain']:.5f}", f"{g['sigma']:.5f}", f"{g['offset']:z.2f}", f"{g['offset_sigma']:.2f}",
                     record["nodes_by_source"][name], shared))  # fmt: skip
    report.table(["image", "gain", "sigma", "offset", "sigma", "nodes where it counts most", "well seen with another"],
                 rows)  # fmt: skip
    report.text(
        f"Values are those of {record['reference']}: grey level less offset, over gain."
        if record["gain_estimated"] else "Values are taken as they are: no gain was estimated.", "soft",
    )  # fmt: skip
    off = record["systematic_percent"]
    if off == off:
        report.text(f"Beyond noise and poses the images differ by {g2(off)} % (median): light that depends on the"
                    " direction, shading of lenses, registration.", "soft")  # fmt: skip


def _seams(report: Report, item: MergeResult, record: dict, unit: str) -> None:
    merged, seams = item.merged, record["seams"]
    assert merged is not None
    report.heading("Seams", 3)
    if not seams["edges"]:
        report.text("There are no seams: one image counts most everywhere.")
        return
    if seams["nodes"]:
        report.table(
            ["steps at seams, in sigmas", "mean", "mean size", "typical (1: noise alone)", "RMS", "largest"],
            [("all nodes that both see", *(float(seams[k]) for k in ("mean", "mean_size", "typical", "rms", "max")))],
        )
        report.picture(png(merge_pictures.seams_figure(merged, unit)),
                       "Where one image takes over from another: what both differ by there.")  # fmt: skip
    if seams["unchecked_edges"]:
        report.text(
            f"At {seams['unchecked_edges']} of {seams['edges']} edges of the grid on seams no node is seen soundly by"
            " both images (outlines, borders): how well they fit there nothing tells.", "soft",
        )  # fmt: skip


def tables(report: Report, found: Sequence[PointTable | MergedTable], unit: str, label: str) -> None:
    """Values at points as tables, along lines as curves."""
    for table in found:
        record = table_summary(table)
        if table.of.kind == "line":
            report.drawing(f"picture of line {table.of.name}", partial(merge_pictures.line_figure, table, unit, label),
                           f"Values along the line “{table.of.name}”.")  # fmt: skip
            continue
        report.heading(f"Points “{table.of.name}”", 3)
        moved = record["largest_move"]
        report.text(
            f"{record['with_value']} of {record['points']} points have a value."
            + ("" if moved is None else f" They were moved by up to {fixed(moved, 4)} {unit} onto the surface (at most"
               f" {g3(record['max_distance'])} {unit} is allowed).")
        )  # fmt: skip
        reasons = table.values.words if isinstance(table, PointTable) else table.reason
        asked, distance, v = table.of.asked, table.of.surface.distance, table.values
        rows = [
            (f"“{table.of.names[k]}”" if str(table.of.names[k]).replace(".", "").isdigit() else str(table.of.names[k]),
             *(fixed(c, 3) for c in asked[k]), fixed(distance[k], 4), float(v.value[k]), float(v.sigma[k]),
             REASONS.get(str(reasons[k]), str(reasons[k]).replace("_", " ")))
            for k in range(min(len(reasons), MOST_ROWS))
        ]  # fmt: skip
        report.table(["name", *(f"{a}, {unit}" for a in "xyz"), f"moved, {unit}", label, "sigma", "no value because"],
                     rows, scroll=True)  # fmt: skip
        if len(reasons) > MOST_ROWS:
            report.text(f"The first {MOST_ROWS}; the files have all.", "soft")
