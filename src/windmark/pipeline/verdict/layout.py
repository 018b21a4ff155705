"""The verdict on a layout of markers before a test."""

from __future__ import annotations

from windmark.pipeline.verdict import rules
from windmark.pipeline.verdict.verdict import BAD, DOUBTFUL, Finding, Verdict
from windmark.tasks.marker_check import MarkerCheck

_OF_TABLE = {
    "close": ("marker", "take one of them out of the table, or move it"),
    "inward": ("discs", "turn the normals round (change the sign of nx, ny, nz): they point out of the surface, to "
               "those who see the marker; of markers on walls round the cameras give the role wall"),
    "reversed": ("discs", "turn this normal round (change the sign of nx, ny, nz), or leave the marker out"),
    "unseen": ("missing", "check places and normals, or give the region that the camera is in (--view-from)"),
    "few": ("few", "paint more markers"),
    "few-in-sight": ("few", "paint more markers on that side"),
}
"""Findings of the table that are doubts, and not only to be known: cause and next step."""


def layout_verdict(check: MarkerCheck) -> Verdict:
    """Judge a layout: whether views of it are identified, and whether its poses are sure."""
    found = []
    proposed = bool(check.proposals)
    if not check.identifiable:
        step = "take the proposed layout (markers-proposed.csv)" if proposed else "move or add markers; see the report"
        found.append(Finding(BAD, "layout", check.reason(), step))
    weak, checked = int(check.weak_pose().sum()), int(check.campaign.counted.sum())
    if weak > rules.SOME * checked:
        said = f"from {weak} of {checked} directions the surface is placed worse than a spot is measured"
        found.append(Finding(DOUBTFUL, "weak", said, "paint markers farther apart, or in more depth; see the report"))
    found += [Finding(DOUBTFUL, _OF_TABLE[f.kind][0], f.text, _OF_TABLE[f.kind][1])
              for f in check.findings if f.kind in _OF_TABLE]  # fmt: skip
    return Verdict.of(found, 1, check.reason(), "keep the table: every job reads it")
