"""What the verdicts on series have in common: results that are missing, and none at all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from windmark.pipeline.verdict import rules
from windmark.pipeline.verdict.reasons import told_by
from windmark.pipeline.verdict.verdict import BAD, DOUBTFUL, Finding, Verdict
from windmark.scene.repeated import ONCE_MORE


def lost_findings(lost: Sequence[tuple[str, str]], count: int, what: str) -> list[Finding]:
    """Name and reason of each of ``count`` that gave no result, where they are more than some."""
    if len(lost) <= rules.LOST * count:
        return []
    name, why = lost[0]
    cause, step = told_by(why) or ("lost", f"look at the first of these {what}")
    return [Finding(DOUBTFUL, cause, f"{len(lost)} of {count} {what} gave no result; {name}: {why}", step)]


def copies_finding(first: str, count: int, what: str) -> Finding:
    """Pictures that are there twice, how the ``first`` of so many is; ``what`` of it is of another instant."""
    more = f", and {count - 1} more such" if count > 1 else ""
    step = "leave the copy out, and look whether the recording dropped pictures"
    return Finding(DOUBTFUL, "file", f"{first} ({ONCE_MORE}){more}: {what} is of another instant", step)


def bad_series(cause: str, reason: str, step: str) -> Verdict:
    """No result at all; what its words tell comes before ``cause``."""
    cause, step = told_by(reason) or (cause, step)
    return Verdict.of([Finding(BAD, cause, reason, step)], 1, "", "")


def middle(values: Sequence[float]) -> float:
    """The median of those that are known; NaN without."""
    known = [v for v in values if np.isfinite(v)]
    return float(np.median(known)) if known else float("nan")
