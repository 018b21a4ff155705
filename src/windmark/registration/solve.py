"""Search, judge, and what comes of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import PARAMETERS, Camera
from windmark.registration.budget import Budget
from windmark.registration.result import NotRegistered, Registration
from windmark.registration.search.fixed import FixedSearch
from windmark.registration.search.layout import Layout
from windmark.registration.search.plane import Plane
from windmark.registration.search.quads import QuadSearch
from windmark.registration.search.ransac import Search
from windmark.registration.solution import Solution, accepted
from windmark.registration.task import Limits, Task, with_focal
from windmark.registration.verdict import Judge, Verdict
from windmark.scene import Matching

Array = NDArray[np.float64]

STOP_AT = 45.0
"""Search score (nats) from which a candidate is worth a verdict."""


def solve(
    task: Task, layout: Layout | None, limits: Limits, index: NDArray[np.int64], options: dict[str, Any]
) -> Registration | NotRegistered:
    """Register a task.

    ``layout`` is of its markers, ``index`` names its spots, ``options`` are those of `register`, all checked.
    """
    layout = layout or Layout(task.markers)
    if options["method"] == "hash":
        layout.ready()
    budget = Budget(options["max_time_s"])
    task = replace(task, visible=budget.without(task.visible))
    plane = Plane(task, layout)
    if task.fixed:
        search: Search | QuadSearch = FixedSearch(plane, np.random.default_rng(options["seed"]), STOP_AT)
    elif options["method"] == "hash":
        search = QuadSearch(plane, STOP_AT)
    else:
        search = Search(plane, np.random.default_rng(options["seed"]))
    verdict, late = _judge(search, limits, options["max_hypotheses"], budget)
    if verdict.cause is None and verdict.best is not None:
        return _registration(plane, accepted(plane, verdict.best), verdict, search.links, index, options)
    cause, reason, best = verdict.cause or "nothing", verdict.reason, verdict.best
    if cause == "time" or (late and cause not in ("ambiguous", "focal", "wrong_focal", "labels")):
        cause, reason = "time", f"stopped after max_time_s = {options['max_time_s']:g} s; so far: {reason}"
    if best is None:
        return NotRegistered(reason, cause, n_hypotheses=search.links, options=options)
    return NotRegistered(reason, cause, best.count, best.cam_from_model, verdict.runner_up, search.links, options)


def _judge(search: Search | QuadSearch, limits: Limits, max_links: int, budget: Budget) -> tuple[Verdict, bool]:
    """Search until the verdict is clear; the verdict, and whether the time limit struck."""
    judge = Judge(search, limits, budget)
    judged, late = None, False
    for links in search.batches():
        best = search.best
        if best is not None and best.score > STOP_AT and best is not judged:
            verdict = judge.verdict()
            if verdict.cause is None:
                return verdict, False
            judged = search.best
            if verdict.cause in ("focal", "wrong_focal", "labels"):
                return verdict, False
            if verdict.cause == "ambiguous":
                # Of two equally good solutions both may be wrong: search on, but not for long.
                max_links = min(max_links, 3 * links + 50_000)
        late = budget.over
        if links >= max_links or late:
            break
    return judge.verdict(), late


def _registration(
    plane: Plane, best: Solution, verdict: Verdict, tried: int, index: NDArray[np.int64], options: dict[str, Any]
) -> Registration:
    task = plane.task
    camera = _camera(task.camera, best)
    seen = camera.project(best.cam_from_model.apply(task.markers.xyz[best.marker]))[0]
    residuals = seen - task.xy[best.detection]
    distance = np.linalg.norm(residuals, axis=1)
    return Registration(
        cam_from_model=best.cam_from_model,
        camera=camera,
        matching=Matching(index[best.detection], best.marker, distance),
        rms_px=float(np.sqrt((distance**2).mean())),
        residuals=residuals,
        cov=best.cov,
        excess_px=best.excess_px,
        score=best.evidence.score,
        log10_nfa=best.evidence.log10_nfa,
        runner_up=verdict.runner_up,
        n_expected=best.expected,
        n_hypotheses=tried,
        report=best.report,
        options=options,
    )


def _camera(camera: Camera, best: Solution) -> Camera:
    """The camera, with the focal length found and its variance if that was free."""
    if len(best.cov) == 6:
        return camera
    cov = np.zeros((len(PARAMETERS),) * 2) if camera.cov is None else np.array(camera.cov)
    cov[0, :], cov[:, 0] = 0.0, 0.0
    cov[0, 0] = best.cov[6, 6]
    found = with_focal(camera, best.focal_px)
    return found.with_parameters(found.parameters(), cov)
