"""The verdict on images aligned in 2D: what was not aligned, places that the markers do not agree about, pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from windmark.errors import g2
from windmark.pipeline.verdict import rules
from windmark.pipeline.verdict.copied import copied_findings
from windmark.pipeline.verdict.picture import PictureState, picture_findings
from windmark.pipeline.verdict.verdict import BAD, DOUBTFUL, Finding, Verdict
from windmark.scene.repeated import ONCE_MORE

Record = Mapping[str, Any]

_REFUSED = {
    "no_spots": ("few", "see what windmark detect finds in it, with --explain"),
    "too_few": ("few", "see what windmark detect finds in it; or name markers by hand (--matches)"),
    "undetermined": ("few", "take a simpler --kind, or name more markers by hand (--matches)"),
    "nothing": ("no match", "see that it is the same model from about the same side; or name markers (--matches)"),
    "weak": ("no match", "see that it is the same model; or name some markers by hand (--matches)"),
    "ambiguous": ("layout", "say how far the model moves at most (--max-shift-px), or name markers (--matches)"),
    "mirrored": ("mirrored", "mirror the picture as it was before"),
}
"""Cause of the verdict and next step for each cause of `NotAligned`."""
_UNREAD = ("file", "read the reason; export the picture again")


def align_verdict(
    rows: Sequence[Record], states: Mapping[str, PictureState], contents: Mapping[str, bytes] | None = None
) -> Verdict:
    """Judge an alignment.

    Parameters
    ----------
    rows : one record an image, as ``summary.json`` has them
    states : by name, the reference's included
    contents : `same_picture.shown_by` by name, the reference's first
    """
    found = [f.at(name) for name, state in states.items() for f in picture_findings(state)]
    found += copied_findings((contents or {}).items())
    for row in rows:
        found += [f.at(row["image"]) for f in (_aligned(row) if row["aligned"] else [_refused(row)])]
    good = [row for row in rows if row["aligned"]]
    worst = max((row["held_out_rms_px"] for row in good), default=0.0)
    what = "the image is" if len(rows) == 1 else f"all {len(rows)} images are"
    return Verdict.of(
        found, len(rows), f"{what} aligned; markers are at most {g2(worst)} px RMS from where the others say",
        "look at the ratios in the report; outside the markers sigma.tif says how sure a place is",
    )  # fmt: skip


def _refused(row: Record) -> Finding:
    cause, step = _REFUSED.get(row["cause"], _UNREAD)
    return Finding(BAD, cause, row["problem"], step)


def _aligned(row: Record) -> list[Finding]:
    out = []
    held, most = row["held_out_rms_px"], rules.PLACE_PX * 2**0.5
    if held > most:
        out.append(
            Finding(
                DOUBTFUL,
                "noise",
                f"markers are {g2(held)} px RMS from where a fit without them says, and so is what lies between them",
                "paint more markers, try another --kind, or align in 3D (a camera and a grid) where relief moves",
            )
        )
    pairs, gone = row["pairs"], row["rejected_pairs"]
    out += [_apart(part) for part in row["apart"]]
    if gone > rules.LEFT_OUT * (pairs + gone) and gone > max(1, sum(part["markers"] for part in row["apart"])):
        said = f"{gone} of {pairs + gone} pairs of markers contradict the others and were left out"
        out.append(Finding(DOUBTFUL, "marker", said, "see which in residuals.csv: markers that moved, or wrong names"))
    if pairs < rules.FEW:
        said = f"{pairs} pairs of markers carry the transformation: a wrong one would hardly show"
        out.append(Finding(DOUBTFUL, "few", said, "paint more markers, or take a simpler --kind"))
    return [*out, *_still(row)]


def _apart(part: Record) -> Finding:
    """Markers that contradict the others, and agree with each other."""
    said = (
        f"{part['markers']} markers that are next to each other ({_where(part)}) moved by {g2(part['off_px'])} px "
        "against the others: a part that moves by itself, aligned as if it did not; sigma.tif has it there"
    )
    step = "align that part for itself (--mask, --image-mask), or in 3D with a law of its own (windmark deform)"
    return Finding(DOUBTFUL, "marker", said, step)


def _where(part: Record) -> str:
    return f"at x {part['x'][0]:.0f} to {part['x'][1]:.0f}, y {part['y'][0]:.0f} to {part['y'][1]:.0f}"


def _still(row: Record) -> list[Finding]:
    """Markers that were taken for walls as they stand still, and are a copy of the reference's, or most of all."""
    part, still = row["still"], row["standing_still"]
    every = row["pairs"] + row["rejected_pairs"] + still
    if part is None:
        return []
    where = _where(part)
    if part["copied"]:
        said = (
            f"{part['copied']} of {every} markers ({where}) show what the reference shows while the others moved "
            f"({ONCE_MORE}): this part of the picture is a copy of it"
        )
        step = "look whether the recording tore the picture; take another one of this state"
        return [Finding(DOUBTFUL, "file", said, step)]
    if 2 * still <= every:
        return []
    said = (
        f"{still} of {every} markers stand still ({where}) and were taken for walls: the motion of the other "
        f"{every - still} is extrapolated over them"
    )
    step = "where they are on the model, align with --keep-still; else leave the walls out (--mask)"
    return [Finding(DOUBTFUL, "one-sided", said, step)]
