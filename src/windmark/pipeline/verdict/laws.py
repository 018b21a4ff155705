"""The verdict on laws: those of a user's file, and which one a test's pictures ask for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from windmark.errors import g2
from windmark.pipeline.deform.laws import LawsCompared
from windmark.pipeline.verdict import rules
from windmark.pipeline.verdict.verdict import BAD, DOUBTFUL, Finding, Verdict


def laws_verdict(remarks: Mapping[str, Sequence[str]], points: int) -> Verdict:
    """Judge laws of a user's file by the remarks of `check_law` on each, by name."""
    step = (
        "see the remark: a parameter that moves nothing cannot be measured, points must rest at the start values, a "
        "kink is best far from them"
    )
    found = [Finding(DOUBTFUL, "weak", text, step) for every in remarks.values() for text in every]
    what = "the law is" if len(remarks) == 1 else f"all {len(remarks)} laws are"
    return Verdict.of(
        found, 1, f"{what} finite and continuous on {points} points, every parameter has an effect",
        'name it in the project: law = "FILE.py:NAME" in its [[volume]]',
    )  # fmt: skip


def compared_verdict(result: LawsCompared) -> Verdict:
    """Judge a comparison: has it a winner, on all frames, that leaves the spots' noise alone?"""
    found = []
    if not result.winner:
        step = "take more frames with more load (--frames), or keep the simplest of them"
        found.append(Finding(BAD, "weak", result.verdict, step))
    else:
        misfit = result.scale**0.5
        if misfit > rules.SIGMA0:
            said = f"{result.winner} is the likeliest, yet residuals are {g2(misfit)} times the spots' noise"
            found.append(Finding(DOUBTFUL, "bent", said, "try richer laws (--law); windmark laws lists them"))
        every = len(result.frames) + len(result.lost)
        if len(result.lost) > rules.LOST * every:
            said = f"{len(result.lost)} of {every} frames gave no result; {result.lost[0]}"
            found.append(Finding(DOUBTFUL, "lost", said, "look at the first of these frames"))
    return Verdict.of(found, 1, result.verdict, "give the project this law, and run windmark deform")
