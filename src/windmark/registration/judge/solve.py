"""Search, judge, and what comes of it, for one camera or several."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from windmark.registration.budget import Budget
from windmark.registration.judge.judge import Judge
from windmark.registration.judge.source import Source
from windmark.registration.judge.verdict import Verdict
from windmark.registration.search.plane import Plane
from windmark.registration.search.search import Search
from windmark.registration.task import MIN_COUNT, Limits

STOP_AT = 45.0
"""Search score (nats) from which a candidate is worth a verdict."""
PATIENCE = 40_000
"""Links (some milliseconds) that a refused candidate has to wait before it is tried on a bent model, which takes
longer: most often it was wrong, and a better one is found meanwhile."""
WINDOW = 60.0
"""Candidates whose search score (nats) is this much below the best are no rivals."""
WORTH_CARRYING = 25.0
"""Search score (nats) of one camera's candidate from which the other cameras are asked at once."""
CLEAR = ("focal", "wrong_focal", "wrong_camera", "mirrored")
"""Causes that no better candidate would change; one that has the given labels may come late."""


def search_for(plane: Plane, options: dict[str, Any], budget: Budget) -> Search:
    """The search of a single camera."""
    return Search(plane, STOP_AT, method=options["method"], seed=options["seed"], budget=budget)


def searches_of_rig(planes: Sequence[Plane], options: dict[str, Any], budget: Budget) -> list[Search | None]:
    """The searches of several cameras; none where there are too few spots."""
    return [
        Search(plane, WORTH_CARRYING, method=options["method"], wide=True, seed=options["seed"], budget=budget)
        if len(plane.task.xy) >= MIN_COUNT else None
        for plane in planes
    ]  # fmt: skip


def judge(source: Source, limits: Limits, max_links: int, budget: Budget) -> tuple[Verdict, bool]:
    """Search until the verdict is clear; the verdict, and whether the limit of work struck."""
    judge_ = Judge(source, limits, budget)
    judged, patience, late = None, np.inf, False
    for links in source.batches():
        best = source.worth_judging(STOP_AT)
        fresh = best is not judged
        if best is not None and (fresh or links > patience):
            verdict = judge_.verdict(deformed=not fresh)
            patience = links + PATIENCE if fresh else np.inf
            bent = verdict.cause is None and verdict.best is not None and verdict.best.is_bent
            if (verdict.cause is None and not bent) or verdict.cause in CLEAR:
                return verdict, False
            judged = source.worth_judging(STOP_AT)
            if bent or verdict.cause == "ambiguous":
                # Of two equally good solutions both may be wrong, and a deformation can stand in for the rigid
                # solution that is not yet found: search on, but not for long.
                max_links = min(max_links, 3 * links + 50_000)
        late = budget.over
        if links >= max_links or late:
            break
    return judge_.verdict(final=True), late
