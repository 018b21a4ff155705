"""Search, judge, and what comes of it, for one camera or several."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from windmark.registration.budget import Budget
from windmark.registration.judge.judge import Judge
from windmark.registration.judge.source import Source
from windmark.registration.judge.verdict import Verdict
from windmark.registration.search.fixed import FixedSearch
from windmark.registration.search.plane import Plane
from windmark.registration.search.quads import CHECKS, FAR_STAGES, QuadSearch
from windmark.registration.search.ransac import Search, make_rules
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
P_SEEN, REJECT_AT, GROW_AT = 0.35, -8.0, 3.0
"""Of a rig, most markers may be hidden in one camera."""
CLEAR = ("focal", "wrong_focal", "wrong_camera", "mirrored", "labels")
"""Causes that no better candidate would change."""


def search_for(plane: Plane, options: dict[str, Any], budget: Budget) -> Search | QuadSearch:
    """The search of a single camera."""
    if options["method"] == "hash" and not plane.task.fixed:
        return QuadSearch(plane, STOP_AT, budget=budget)
    rng = np.random.default_rng(options["seed"])
    return FixedSearch(plane, rng, STOP_AT, budget) if plane.task.fixed else Search(plane, rng, budget)


def searches_of_rig(
    planes: Sequence[Plane], options: dict[str, Any], budget: Budget
) -> list[Search | QuadSearch | None]:
    """The searches of several cameras: neighbourhoods may look weak, since the other cameras will judge."""
    found: list[Search | QuadSearch | None] = []
    for plane in planes:
        rules = make_rules(plane)._replace(p_seen=P_SEEN, reject_at=REJECT_AT, grow_at=GROW_AT)
        # Cameras are searched to their end, so there would be no gain from a first round with strict checks.
        if len(plane.task.xy) < MIN_COUNT:
            found.append(None)
        elif plane.task.fixed or options["method"] != "hash":
            found.append(search_for(plane, options, budget))
        else:
            found.append(QuadSearch(plane, WORTH_CARRYING, rules, len(FAR_STAGES), CHECKS[-1:], budget))
    return found


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
