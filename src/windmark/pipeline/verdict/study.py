"""The verdict on a study of virtual markers: are they found, how well, and how near to what the pictures allow?"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from windmark.errors import g2
from windmark.pipeline.verdict import rules
from windmark.pipeline.verdict.verdict import BAD, DOUBTFUL, Finding, Verdict

Record = Mapping[str, Any]
BEST = "template"
"""The refinement that reaches the bound where noise is what limits."""
REST = (
    "noise so small is no longer what limits; the rest is the 11 x 11 sub-pixels of virtual markers and, without blur, "
    "the method"
)


def study_verdict(summary: Sequence[Record]) -> Verdict:
    """Judge a study by the best method of each reference radius; ``summary`` as `Study.summary` gives it."""
    found, best = [], []
    for r0 in dict.fromkeys(row["r0_px"] for row in summary):
        rows = [row for row in summary if row["r0_px"] == r0]
        some = [row for row in rows if row["missed"] < row["markers"]]
        row = min(some or rows, key=lambda row: (row["missed"] > rules.MISSING * row["markers"], row["two_rms_px"]))
        best.append(row)
        found += [f.at(f"radius {r0:g} px") for f in _row(row, {row["method"] for row in rows})]
    worst = max(best, key=lambda row: row["two_rms_px"])
    times = worst["rms_over_crlb"]
    bound = f", {times:.2f} times the least that pictures allow" if math.isfinite(times) else ""
    bound += f": {REST}" if times > rules.BOUND_TIMES else ""
    return Verdict.of(
        found, len(best), f"centres are known to {g2(worst['two_rms_px'] / 2)} px (1 sigma per axis, radius "
        f"{worst['r0_px']:g} px){bound}",
        "plan markers of the radius whose error the measurement can bear", what="radii",
    )  # fmt: skip


def _row(row: Record, methods: set[str]) -> Iterator[Finding]:
    """What is found at one reference radius, by the best of these methods."""
    missed, markers, rms = row["missed"], row["markers"], row["two_rms_px"] / 2
    step = "take larger markers, more light or less blur (--noise-percent, --depth, --blur-passes say what was tried)"
    if missed == markers:
        yield Finding(BAD, "few", f"none of {markers} markers was found", step)
        return
    if missed > rules.MISSING * markers:
        yield Finding(DOUBTFUL, "missing", f"{missed} of {markers} markers were not found", step)
    if rms > rules.PLACE_PX:
        yield Finding(DOUBTFUL, "noise", f"centres are off by {g2(rms)} px (1 sigma per axis)", step)
    if row["rms_over_crlb"] > rules.BOUND_TIMES:
        said = f"errors are {g2(row['rms_over_crlb'])} times the least that the pictures allow"
        if BEST not in methods:
            yield Finding(DOUBTFUL, "noise", said, f"compare the method {BEST} as well (--method {BEST})")
        elif rms > rules.STUDY_REST_PX:
            yield Finding(DOUBTFUL, "noise", f"{said} with the best method there is",
                          "take larger markers or less tilt (--max-tilt-deg)")  # fmt: skip
