"""The verdict on an infrared run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from windmark.errors import g2, g3
from windmark.pipeline.alike import listed
from windmark.pipeline.infrared import FrameRecord
from windmark.pipeline.infrared.likely import OddUnit
from windmark.pipeline.verdict import rules
from windmark.pipeline.verdict.apart import apart_findings
from windmark.pipeline.verdict.followed import followed_findings
from windmark.pipeline.verdict.series import bad_series, lost_findings, middle
from windmark.pipeline.verdict.verdict import BAD, DOUBTFUL, Finding, Verdict


def infrared_verdict(
    records: Sequence[FrameRecord], remarks: Sequence[str] = (), unit: str = "", grid: Sequence[Finding] = ()
) -> Verdict:
    """Judge an infrared run.

    Parameters
    ----------
    remarks : on the whole of it
    unit : of lengths
    grid : what is to be said of grid and markers, see `grid_findings`
    """
    good = [r for r in records if r.status == "reduced"]
    if not good:
        return bad_series(
            "no match",
            f"no frame could be reduced; the first: {records[0].reason if records else 'none'}",
            "see the reason; run windmark register on one of its pictures",
        )
    lost = [(r.key, r.reason) for r in records if r.status != "reduced"]
    found = [*grid, *_beyond(good), *_repeated(records), *lost_findings(lost, len(records), "frames")]
    found += followed_findings([r.followed for r in good], unit)
    if (seen := middle([r.seen for r in good])) < rules.COVERED * max(r.seen for r in good):
        found.append(
            Finding(
                DOUBTFUL,
                "covered",
                f"{100 * seen:.0f} % of the nodes have a temperature (median), half of what the best frame shows",
                "add a camera, or leave parts out of the grid",
            )
        )
    sigma, kelvin = middle([r.median_sigma_T for r in good]), middle([r.median_T for r in good])
    if sigma > rules.TEMPERATURE * kelvin:
        found.append(
            Finding(
                BAD,
                "units",
                f"temperatures are known to {g2(sigma)} K only (median, 1 sigma): the pictures' numbers are not in the "
                "unit that is said, or emissivity and surroundings are hardly known",
                "say the unit of the camera's numbers; give emissivity and surroundings with their sigma",
            )
        )
    found += _flux(good)
    step = "check each camera's black bodies, emissivity and shutter (NUC)"
    found += apart_findings([r.apart for r in good], "temperatures of", step, "dirt", "frames")
    if remarks:
        found.append(Finding(DOUBTFUL, "noise", remarks[0], "see the remark"))
    # Times in another unit make every heat flux wrong, and nothing in the pictures contradicts them: they are named.
    times = [r.time_s for r in good if np.isfinite(r.median_q)]
    apart = f", {g3(float(np.median(np.diff(times))))} s from one to the next" if len(times) > 1 else ""
    return Verdict.of(
        found,
        1,
        f"{len(good)} frames reduced{apart}, temperatures to {g2(sigma)} K (median, 1 sigma; emissivity, surroundings "
        "and their sigmas as given)",
        "use the fields with their sigmas",
    )


def unit_findings(odd: Sequence[OddUnit], surroundings_K: float) -> list[Finding]:
    """Cameras whose numbers are rather in another unit than is said."""
    return [
        Finding(
            DOUBTFUL,
            "units",
            f"the middle of the first picture of {o.camera} is {o.kelvin:.0f} K in {o.unit}, the surroundings are "
            f"{surroundings_K:.0f} K: its numbers are rather in {o.other} ({o.other_K:.0f} K)",
            f"say unit = \"{o.other}\" of camera {o.camera}, or correct scale and offset",
        )
        for o in odd
    ]


def _beyond(good: Sequence[FrameRecord]) -> list[Finding]:
    """Cameras that lost most of their nodes to the ends of their calibration: the others are all that there is then."""
    out = []
    for name in dict.fromkeys(c for r in good for c in r.beyond):
        of = [r for r in good if name in r.beyond]
        if len(of) <= rules.LOST * len(good):
            continue
        kelvin = [r.median_T for r in of]
        others = sorted({c for r in of for c in r.cameras} - {name})
        see = "see" if len(others) > 1 else "sees"
        shown = f"{listed('camera', others)} {see}" if others else "the rest of them have"
        words = (f"{name}: most of the nodes that it shows have no temperature in {len(of)} of {len(good)} frames: "
                 f"beyond its calibration ({of[0].beyond[name]}); {shown} {g3(min(kelvin))} to {g3(max(kelvin))} K "
                 "(medians)")  # fmt: skip
        step = f"calibrate {name} over the model's temperatures (black bodies above and below them), or correct the "
        out.append(Finding(DOUBTFUL, "lost", words, f"{step}unit or offset of its numbers; else leave it out"))
    return out


def _repeated(records: Sequence[FrameRecord]) -> list[Finding]:
    """Cameras of which many pictures are no new ones: when those between them were taken is not sure either."""
    out = []
    for name in dict.fromkeys(c for r in records for c in r.repeated):
        of = [r.key for r in records if name in r.repeated]
        if len(of) > rules.LOST * len(records):
            words = (f"{len(of)} of {len(records)} pictures of {name} repeat the one before and do not count "
                     f"({listed('frame', of)})")  # fmt: skip
            step = "see why frames were dropped (disk, link, too high a rate), and whether the times are true"
            out.append(Finding(DOUBTFUL, "lost", words, step))
    return out


def _flux(good: Sequence[FrameRecord]) -> list[Finding]:
    """Heat fluxes that are not known, or flagged."""
    out = []
    known = [r for r in good if np.isfinite(r.median_q)]
    sigma = middle([r.median_sigma_q for r in known])
    if known and sigma > max(abs(r.median_q) for r in known):
        words = f"heat fluxes are known to {g2(sigma)} W/m² (median, 1 sigma), which is more than they are"
        step = "take more frames a second, or a longer run; the report says what leaves them open"
        out.append(Finding(DOUBTFUL, "weak", words, step))
    without = [r for r in good if r.no_flux]
    if len(without) > rules.LOST * len(good):
        why = "; ".join(dict.fromkeys(r.no_flux for r in without))
        words = (f"{len(without)} of {len(good)} frames with temperatures have no heat flux on most nodes "
                 f"({listed('frame', [r.key for r in without])}): {why}")  # fmt: skip
        step = "see which pictures are missing before the first of them, and heat.longest_gap; or end the run there"
        out.append(Finding(DOUBTFUL, "lost", words, step))
    if (flagged := middle([r.flagged for r in good])) > rules.SOME:
        words = f"{100 * flagged:.0f} % of the heat fluxes are flagged (late, lateral, curved)"
        step = "a shorter test, the wall's true layers; or the frames' times in seconds, where they are not"
        out.append(Finding(DOUBTFUL, "weak", words, step))
    return out
