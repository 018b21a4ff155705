"""The verdict on a table's normals against the grid: pointing into the body, they hide every marker."""

from __future__ import annotations

import numpy as np

from windmark.pipeline.verdict.grid import GridLook
from windmark.pipeline.verdict.verdict import BAD, Finding
from windmark.resection.outward import outward
from windmark.resection.seat import ASKED, NEAR

LEAST = 6
"""So many normals of which the grid tells the side are asked, or none is."""
MOST = 0.9
"""Part of them that points inwards where the table is meant: chance has so many of six in 1 of 64 cases at the most,
and of a body's normals hardly any is wrong by itself."""


def inward_findings(look: GridLook) -> list[Finding]:
    """Normals of the model's markers that point into the grid, all or nearly all."""
    model = look.model
    known = np.flatnonzero(np.isfinite(model.normal).all(axis=1))
    known = known[:: max(1, -(-len(known) // ASKED))]
    if len(known) < LEAST or look.seat.most > NEAR * look.seat.size:
        return []
    side = outward(look.rest, model.xyz[known], model.normal[known])
    told, inward = int((side != 0).sum()), int((side < 0).sum())
    if told < LEAST or inward < MOST * told:
        return []
    said = f"the normals of the table point into the model: {inward} of {told} of which the grid tells the side do"
    return [Finding(BAD, "discs", said, "turn the normals round: they point from the surface into the air")]
