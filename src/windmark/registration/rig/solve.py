"""Search with all cameras, judge, and what comes of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Pose
from windmark.registration.budget import PER_CAMERA, Budget
from windmark.registration.result import NotRegistered
from windmark.registration.rig.joint import Cameras
from windmark.registration.rig.result import RigRegistration
from windmark.registration.rig.search import RigSearch
from windmark.registration.rig.verdict import RigJudge, RigVerdict
from windmark.registration.search.layout import Layout
from windmark.registration.search.plane import Plane
from windmark.registration.solve import STOP_AT
from windmark.registration.task import Limits, Task
from windmark.scene import Matching

Ints = NDArray[np.int64]


def solve_rig(
    tasks: Sequence[Task], cam_from_rig: tuple[Pose, ...], layout: Layout | None, limits: Limits,
    index: Sequence[Ints], options: dict[str, Any],
) -> RigRegistration | NotRegistered:  # fmt: skip
    """Register the tasks of all cameras together; ``index`` names their spots, the options are checked."""
    layout = (layout or Layout(tasks[0].markers)).ready()
    budget = Budget.of(PER_CAMERA * len(tasks), options["max_time_s"])
    names = [c for c, task in enumerate(tasks) if len(task.xy)]
    cameras = Cameras([Plane(tasks[c], layout) for c in names], [cam_from_rig[c] for c in names])
    search = RigSearch(cameras, budget)
    verdict, late = _judge(search, RigJudge(search, names, limits, budget), options["max_hypotheses"], budget)
    if verdict.cause is None:
        return _registration(cameras, names, verdict, search.links, tasks, cam_from_rig, index, options)
    cause, reason, best = verdict.cause, verdict.reason, verdict.best
    if cause == "time" or (budget.out_of_time and cause not in ("ambiguous", "misfit", "wrong_focal")):
        cause, reason = "time", f"{budget.why}; so far: {reason}"
    elif late:
        reason = f"{reason}; {budget.why}"
    if best is None:
        return NotRegistered(reason, cause, n_hypotheses=search.links, options=options)
    pose = cam_from_rig[0] @ best.rig_from_model
    return NotRegistered(reason, cause, best.count, pose, verdict.runner_up, search.links, options=options)


def _judge(search: RigSearch, judge: RigJudge, max_links: int, budget: Budget) -> tuple[RigVerdict, bool]:
    """Search until the verdict is clear; the verdict, and whether it took all the work or time."""
    judged, late = None, False
    for links in search.batches():
        best = next(iter(search.solutions), None)
        if best is not None and best.evidence.score > STOP_AT and best is not judged:
            verdict = judge.verdict()
            if verdict.cause is None or verdict.cause == "wrong_focal":
                return verdict, False
            judged = search.solutions[0]
            if verdict.cause == "ambiguous":
                # Of two equally good solutions both may be wrong: search on, but not for long.
                max_links = min(max_links, 3 * links + 50_000)
        late = budget.over
        if links >= max_links or late:
            break
    return judge.verdict(), late


def _registration(
    cameras: Cameras, names: list[int], verdict: RigVerdict, links: int, tasks: Sequence[Task],
    cam_from_rig: tuple[Pose, ...], index: Sequence[Ints], options: dict[str, Any],
) -> RigRegistration:  # fmt: skip
    assert verdict.best is not None
    best, off = cameras.finish(verdict.best)
    views, offsets = dict(zip(names, best.views, strict=True)), dict(zip(names, off, strict=True))
    nothing = np.zeros(0, np.int64)
    matchings, residuals = [], []
    for c, (task, pose) in enumerate(zip(tasks, cam_from_rig, strict=True)):
        view = views.get(c)
        marker, spot = (nothing, nothing) if view is None else (view.marker, view.detection)
        seen, _ = task.camera.project((pose @ best.rig_from_model).apply(task.markers.xyz[marker]))
        residuals.append(seen + offsets.get(c, 0.0) - task.xy[spot])
        matchings.append(Matching(index[c][spot], marker, np.linalg.norm(residuals[c], axis=1)))
    excess = [views[c].excess_px if c in views and views[c].count else np.nan for c in range(len(tasks))]
    return RigRegistration(
        rig_from_model=best.rig_from_model,
        cameras=tuple(task.camera for task in tasks),
        cam_from_rig=cam_from_rig,
        matchings=tuple(matchings),
        rms_px=float(np.sqrt((np.concatenate(residuals) ** 2).sum(axis=1).mean())),
        residuals=tuple(residuals),
        cov=best.cov,
        excess_px=np.array(excess),
        score=best.evidence.score,
        log10_nfa=best.evidence.log10_nfa,
        runner_up=verdict.runner_up,
        n_expected=tuple(views[c].expected if c in views else 0 for c in range(len(tasks))),
        n_hypotheses=links,
        report=best.report,
        options=options,
    )
