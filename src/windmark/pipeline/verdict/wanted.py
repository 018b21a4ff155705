"""The verdict on lists of points at which values are wanted: whether they are on the model at all."""

from __future__ import annotations

from collections.abc import Sequence

from windmark.errors import g3
from windmark.pipeline.points import NO_VALUE, PointSet
from windmark.pipeline.verdict import rules
from windmark.pipeline.verdict.verdict import DOUBTFUL, Finding


def far_findings(sets: Sequence[PointSet], unit: str) -> list[Finding]:
    """Lists of which most points are not on the surface, in the project's unit."""
    out = []
    for of in sets:
        if of.far.mean() > rules.FAR_POINTS:
            far, limit = of.far, f"{g3(of.limit)} {unit}"
            said = f"{int(far.sum())} of {len(far)} points of {of.name} are farther than {limit} from the grid"
            step = "check unit and frame of the list of points, and the side of its normals"
            out.append(Finding(DOUBTFUL, "units", said, step))
    return out


def valueless_findings(said: Sequence[str]) -> list[Finding]:
    """Lists of which no point has a value, see `without_value`, among other things that are said."""
    step = "see the remarks in the list's own file of the results, and that the points are on a side that cameras show"
    return [Finding(DOUBTFUL, "lost", words, step) for words in said if words.startswith(NO_VALUE)]
