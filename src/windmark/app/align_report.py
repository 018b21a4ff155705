"""The page of a 2D alignment."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from typing import Any

from matplotlib.figure import Figure

import windmark
from windmark.app.pictures import png
from windmark.app.report import Report
from windmark.app.wording import duration, power_of_ten

LEAST = -300.0
"""Powers of ten below it are said as that."""

Record = dict[str, Any]
Drawing = tuple[str, Callable[[], Figure | str | None], str]
"""What it is, what draws it (a figure, or HTML as it is), its caption."""

MEANING = (
    "2D alignment: the transformation takes each pixel of the reference to the place in the image where the markers "
    "say that the same piece of the model is (AIAA 2005-5007, section III.A). Motion and deformation are compensated "
    "alike, for no grid is needed; about the deformation itself nothing is learnt. Relief that moves against its "
    "surroundings (parallax, edges, walls behind the model) does not follow it: that is what 3D alignment is for."
)
HELD_OUT = (
    "Held-out residual: how far each marker is from where a fit without it says it is, root mean square length. It is "
    "what to expect between the markers. The simplest transformation is taken that does not predict held-out markers "
    "worse than the best one does. Outside the markers' hull the picture is extrapolated: sigma.tif says how well each "
    "place is known if the model goes on there as among the markers."
)


def align_report(record: Record, pictures: Mapping[str, Sequence[Drawing]]) -> Report:
    """The page, from the summary and what is drawn of the images that are shown; what could not be is in ``failed``."""
    when = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    report = Report(f"Images aligned to {record['reference']}", f"windmark {windmark.__version__}, {when}")
    report.text(MEANING)
    rows = record["images"]
    report.heading("Every image")
    columns = ["image", "pairs", "rejected", "still", "transformation", "held-out RMS px", "fit RMS px",
               "largest motion px", "false-alarm number", "outside the markers %", "ratio scatter before %", "after %",
               "time s", "status"]  # fmt: skip
    report.table(columns, [_row(row) for row in rows], scroll=len(rows) > 15)
    report.text(HELD_OUT, "soft")
    report.text(
        "Still: markers that did not move though the others say they should (walls); they take no part. Ratio scatter: "
        "half the width of the middle 68 % of reference by image among the markers; it holds what the "
        "flow did, too. False-alarm number: how many such matchings chance would give.", "soft",
    )  # fmt: skip
    for row in rows:
        if row["problem"]:
            report.text(f"{row['image']}: {row['problem']}", "bad")
    good = [row for row in rows if row["aligned"]]
    if good:
        report.heading("Held-out residual of each transformation, px")
        kinds = list(good[0]["kinds"])
        report.table(["image", *kinds], [
            [row["image"], *(row["kinds"][k]["held_out_rms_px"] for k in kinds)] for row in good
        ], scroll=len(good) > 15)  # fmt: skip
        for kind in kinds:
            reasons = {row["kinds"][kind]["reason"] for row in good} - {""}
            for reason in sorted(reasons)[:1]:
                report.text(reason, "soft")
    for name, drawings in pictures.items():
        report.heading(name)
        report.text(next(row["choice"] for row in good if row["image"] == name))
        for what, draw, caption in drawings:
            with report.part(f"{name}: {what}"):
                drawn = draw()
                if isinstance(drawn, str):
                    report.raw(drawn)
                elif drawn is not None:
                    report.picture(png(drawn), caption)
    report.closing(
        [
            ("NAME/aligned.tif", "the image recomputed on the reference, float32, NaN where it shows nothing"),
            ("NAME/sigma.tif", "1 sigma of each pixel's place in the image, pixels"),
            ("NAME/transformation.json", "the transformation: kind, parameters, covariance, the markers' hull"),
            ("NAME/residuals.csv", "the pairs: places, residuals, held-out residuals, which were used"),
            ("summary.json", "the figures above"),
        ],
        record["options"], {"whole job": record["seconds"]},
    )  # fmt: skip
    return report


def _chance(log10_nfa: float) -> str:
    """A false-alarm number as text."""
    return power_of_ten(log10_nfa) if log10_nfa >= LEAST else f"below {power_of_ten(LEAST)}"


def _row(row: Record) -> list[Any]:
    if not row["aligned"]:
        return [row["image"], *([None] * 11), duration(row["seconds"]), "not aligned"]
    nfa = row["log10_nfa"]
    scatter = [None if row[k] is None else 100 * row[k] for k in ("ratio_scatter_before", "ratio_scatter_after")]
    return [
        row["image"], row["pairs"], row["rejected_pairs"], row["standing_still"], row["kind"],
        row["held_out_rms_px"], row["rms_px"],
        row["largest_shift_px"], "given" if nfa != nfa else _chance(nfa),
        100 * row["outside_the_markers"],
        *scatter, duration(row["seconds"]), "aligned",
    ]  # fmt: skip
