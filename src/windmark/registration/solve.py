"""Search, judge, and what comes of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.registration._kernels.raster import project_kernel
from windmark.registration.bent.solution import BentSolution
from windmark.registration.budget import Budget, work_for
from windmark.registration.directions import WeakDirection, weak_directions
from windmark.registration.final import Final, finish, is_bent
from windmark.registration.result import NotRegistered, Registration
from windmark.registration.search.fixed import FixedSearch
from windmark.registration.search.layout import Layout
from windmark.registration.search.plane import Plane
from windmark.registration.search.quads import QuadSearch
from windmark.registration.search.ransac import Search
from windmark.registration.task import Limits, Task
from windmark.registration.verdict import Judge, Verdict
from windmark.scene import Matching

Array = NDArray[np.float64]

STOP_AT = 45.0
"""Search score (nats) from which a candidate is worth a verdict."""
PATIENCE = 40_000
"""Links (some milliseconds) that a refused candidate has to wait before it is tried on a deformed model, which takes
longer: most often it was wrong, and a better one is found meanwhile."""
LENS_STARTS, OTHER_FOCAL = 4, 0.005
"""How often a search is begun with the lens at another focal length, and how much (relative) that must differ."""


def solve(
    task: Task, layout: Layout | None, limits: Limits, index: NDArray[np.int64], options: dict[str, Any]
) -> Registration | NotRegistered:
    """Register a task.

    ``layout`` is of its markers, ``index`` names its spots, ``options`` are those of `register`, all checked.
    """
    layout = layout or Layout(task.markers)
    if options["method"] == "hash":
        layout.ready()
    budget = Budget.of(work_for(task, options["method"]), options["max_time_s"])
    task = replace(task, visible=budget.without(task.visible))
    tried = 0
    for _ in range(LENS_STARTS):
        plane = Plane(task, layout)
        search = _search(plane, options, budget)
        verdict, late = _judge(search, limits, options["max_hypotheses"], budget)
        tried += search.links
        moved = None if late else _with_other_lens(task, verdict)
        if moved is None:
            break
        task = moved
    if verdict.cause is None and verdict.best is not None:
        return _registration(plane, finish(plane, verdict.best), verdict, tried, index, options)
    cause, reason, best = verdict.cause or "nothing", verdict.reason, verdict.best
    if cause == "time" or (budget.out_of_time and cause not in ("ambiguous", "focal", "wrong_focal", "labels")):
        cause, reason = "time", f"{budget.why}; so far: {reason}"
    elif late:
        reason = f"{reason}; {budget.why}"
    if best is None:
        return NotRegistered(reason, cause, n_hypotheses=tried, options=options)
    weak: tuple[WeakDirection, ...] = ()
    if cause == "focal":
        weak = weak_directions(best.cam_from_model, best.focal_px, best.cov, task.markers.xyz[best.marker])
    return NotRegistered(reason, cause, best.count, best.cam_from_model, verdict.runner_up, tried, weak, options)


def _search(plane: Plane, options: dict[str, Any], budget: Budget) -> Search | QuadSearch:
    if options["method"] == "hash" and not plane.task.fixed:
        return QuadSearch(plane, STOP_AT, budget=budget)
    rng = np.random.default_rng(options["seed"])
    return FixedSearch(plane, rng, STOP_AT, budget) if plane.task.fixed else Search(plane, rng, budget)


def _with_other_lens(task: Task, verdict: Verdict) -> Task | None:
    """The task with the lens at the focal length of a refused solution; None where that is not the trouble.

    The search straightens the spots with the camera as given. A strong lens at a wrong focal length does not fit.
    """
    best = verdict.best
    if not (task.free_focal and is_bent(task.camera) and verdict.cause in ("weak", "misfit")) or best is None:
        return None
    if abs(np.log(best.focal_px / task.camera.focal_px)) < OTHER_FOCAL:
        return None
    camera = replace(task.camera, focal_px=best.focal_px)
    return replace(task, camera=camera) if np.isfinite(camera.unproject(task.xy)).all() else None


def _judge(search: Search | QuadSearch, limits: Limits, max_links: int, budget: Budget) -> tuple[Verdict, bool]:
    """Search until the verdict is clear; the verdict, and whether it took all the work or time."""
    judge = Judge(search, limits, budget)
    judged, patience, late = None, np.inf, False
    for links in search.batches():
        best = search.best
        fresh = best is not judged
        if best is not None and best.score > STOP_AT and (fresh or links > patience):
            verdict = judge.verdict(deformed=not fresh)
            patience = links + PATIENCE if fresh else np.inf
            deformed = verdict.cause is None and isinstance(verdict.best, BentSolution)
            if (verdict.cause is None and not deformed) or verdict.cause in ("focal", "wrong_focal", "labels"):
                return verdict, False
            judged = search.best
            if deformed or verdict.cause == "ambiguous":
                # Of two equally good solutions both may be wrong, and a deformation can stand in for the rigid
                # solution that is not yet found: search on, but not for long.
                max_links = min(max_links, 3 * links + 50_000)
        late = budget.over
        if links >= max_links or late:
            break
    return judge.verdict(), late


def _registration(
    plane: Plane, final: Final, verdict: Verdict, tried: int, index: NDArray[np.int64], options: dict[str, Any]
) -> Registration:
    best, xyz = final.solution, plane.task.markers.xyz
    if final.deformation is not None:
        xyz = xyz + final.deformation.displacement
    pose, camera = final.cam_from_model, final.camera
    seen = project_kernel(camera.packed(), pose.rotation, pose.translation, xyz[best.marker])
    residuals = seen + final.eccentricity_px - plane.task.xy[best.detection]
    distance = np.hypot(residuals[:, 0], residuals[:, 1])
    return Registration(
        cam_from_model=pose,
        camera=camera,
        matching=Matching(index[best.detection], best.marker, distance),
        rms_px=float(np.sqrt((distance**2).mean())),
        residuals=residuals,
        cov=final.cov,
        excess_px=best.excess_px,
        score=best.evidence.score,
        log10_nfa=best.evidence.log10_nfa,
        runner_up=verdict.runner_up,
        n_expected=best.expected,
        n_hypotheses=tried,
        report=final.report,
        xyz=plane.task.markers.xyz,
        deformation=final.deformation,
        options=options,
    )
