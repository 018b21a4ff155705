"""Search, judge, and the registration that comes of it, for one camera or several."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.adjust import SolveReport
from windmark.geometry import Camera, Pose
from windmark.registration.budget import PER_CAMERA, Budget, work_for
from windmark.registration.directions import WeakDirection, weak_directions
from windmark.registration.judge.answer import answer
from windmark.registration.judge.discs import stands
from windmark.registration.judge.judge import Judge
from windmark.registration.judge.source import Source
from windmark.registration.judge.verdict import Verdict
from windmark.registration.result import Deformation, NotRegistered, Registration, RigRegistration
from windmark.registration.search.layout import Layout
from windmark.registration.search.plane import Plane
from windmark.registration.search.search import Search
from windmark.registration.settle._kernels.state import COST_END, COST_START, EXPECTED, PLACE, STEPS, WIDE
from windmark.registration.settle.solution import Solution
from windmark.registration.settle.views import Views
from windmark.registration.task import MIN_COUNT, Limits, Task, is_bent
from windmark.scene import Matching

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

STOP_AT = 45.0
"""Search score (nats) from which a candidate is worth a verdict."""
PATIENCE = 40_000
"""Links (some milliseconds) that a refused candidate has to wait before it is tried on a bent model, which takes
longer: most often it was wrong, and a better one is found meanwhile."""
WINDOW = 60.0
"""Candidates whose search score (nats) is this much below the best are no rivals."""
WORTH_CARRYING = 25.0
"""Search score (nats) of one camera's candidate from which the other cameras are asked at once."""
CLEAR = ("focal", "wrong_focal", "wrong_camera", "exchanged", "mirrored")
"""Causes that no better candidate would change; one that has the given labels may come late."""
LENS_STARTS, OTHER_FOCAL = 4, 0.005
"""How often a search is begun with the lens at another focal length, and how much (relative) that must differ."""


def solve(
    tasks: Sequence[Task], cam_from_rig: Sequence[Pose] | None, rig_cov: Sequence[Array | None],
    layout: Layout | None, limits: Limits, index: Sequence[Ints], options: dict[str, Any],
) -> Registration | RigRegistration | NotRegistered:  # fmt: skip
    """Register the tasks of one camera, or of several with known places in a rig, known to ``rig_cov``.

    ``layout`` is of their markers, ``index`` names their spots, ``options`` are those of `register`, all checked.
    Cameras without spots take no part.
    """
    layout = layout or Layout(tasks[0].markers)
    if options["method"] == "hash":
        layout.ready()
    one = work_for(tasks[0], options["method"])
    work = one if cam_from_rig is None else max(one, PER_CAMERA) * len(tasks)
    budget = Budget.of(work, options["max_time_s"])
    names = [c for c, task in enumerate(tasks) if len(task.xy)]
    used = [_uncounted(tasks[c], budget) for c in names]
    poses = None if cam_from_rig is None else [cam_from_rig[c] for c in names]
    covs, tried = [rig_cov[c] for c in names], 0
    for _ in range(LENS_STARTS):
        planes = [Plane(task, layout) for task in used]
        searches = (
            [search_for(planes[0], options, budget)] if poses is None else searches_of_rig(planes, options, budget)
        )
        source = Source(Views.of(planes, poses, names, covs), searches, WINDOW if poses is None else np.inf, budget)
        verdict, late = judge(source, limits, options["max_hypotheses"], budget)
        tried += source.links
        moved = None if late else _with_other_lenses(used, verdict)
        if moved is None:
            break
        used = moved
    verdict = stands(verdict, limits)
    if verdict.cause is None and verdict.best is not None:
        if cam_from_rig is None:
            return _registration(verdict.best, verdict, tried, index[0], options)
        return _of_rig(verdict.best, verdict, tried, tasks, names, cam_from_rig, index, options)
    return _refused(verdict, late, budget, tried, tasks, cam_from_rig, options)


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
            good = verdict.best if verdict.cause is None else None
            open_ = good is not None and (good.is_bent or _leaves_most(good))
            if (verdict.cause is None and not open_) or verdict.cause in CLEAR:
                return verdict, False
            judged = source.worth_judging(STOP_AT)
            if open_ or verdict.cause == "ambiguous":
                # Of two equally good solutions both may be wrong, and a deformation can stand in for the rigid
                # solution that is not yet found: search on, but not for long.
                max_links = min(max_links, 3 * links + 50_000)
        late = budget.over
        if links >= max_links or late:
            break
    return judge_.verdict(final=True), late


def _leaves_most(best: Solution) -> bool:
    """Whether a solution that has labels leaves most spots and most markers alone.

    Rivals must have the labels, too, and a regular layout turned about a labelled marker has them and few others: that
    it has no rival says little. Nor does it that it explains all markers in view, where most spots are left: from near
    by, where each marker lies on every second spot of every second row, few are in view.
    """
    planes = best.views.planes
    markers, spots = len(planes[0].task.markers), sum(len(plane.task.xy) for plane in planes)
    most = 2 * best.count < min(best.expected, spots) or 3 * best.count < min(markers, spots)
    return most and any(plane.task.fixed and not plane.task.binding for plane in planes)


def _uncounted(task: Task, budget: Budget) -> Task:
    """The task with the time of its ``visible`` not counted."""
    return task if task.visible is None else replace(task, visible=budget.without(task.visible))


def _refused(
    verdict: Verdict, late: bool, budget: Budget, tried: int, tasks: Sequence[Task],
    cam_from_rig: Sequence[Pose] | None, options: dict[str, Any],
) -> NotRegistered:  # fmt: skip
    cause, reason, best = verdict.cause or "nothing", verdict.reason, verdict.best
    if cause == "time" or (budget.out_of_time and cause in ("nothing", "weak")):
        cause, reason = "time", f"{budget.why}; so far: {reason}"
    elif late and cause in ("nothing", "weak"):
        reason = f"{reason}; {budget.why}"
    if best is None:
        return NotRegistered(reason, cause, n_hypotheses=tried, options=options)
    weak: tuple[WeakDirection, ...] = ()
    if cause == "focal" and cam_from_rig is None:
        xyz = tasks[0].markers.xyz[best.pairs()[1]]
        weak = weak_directions(best.cam_from_model(), best.camera().focal_px, _cov(best, best.unit_cov), xyz)
    pose = best.rig_from_model if cam_from_rig is None else cam_from_rig[0] @ best.rig_from_model
    return NotRegistered(reason, cause, best.count, pose, verdict.runner_up, tried, weak, options)


def _with_other_lenses(tasks: Sequence[Task], verdict: Verdict) -> list[Task] | None:
    """The tasks with the lenses at the focal lengths of a refused solution; None where that is not the trouble.

    The search straightens the spots with the camera as given. A strong lens at a wrong focal length does not fit.
    """
    best = verdict.best
    if best is None or verdict.cause not in ("weak", "misfit"):
        return None
    moved = list(tasks)
    for c, task in enumerate(tasks):
        focal = best.camera(c).focal_px
        if task.free_focal and is_bent(task.camera) and abs(np.log(focal / task.camera.focal_px)) > OTHER_FOCAL:
            camera = replace(task.camera, focal_px=focal)
            if np.isfinite(camera.unproject(task.xy)).all():
                moved[c] = replace(task, camera=camera)
    return moved if any(a is not b for a, b in zip(moved, tasks, strict=True)) else None


def _registration(
    best: Solution, verdict: Verdict, tried: int, index: Ints, options: dict[str, Any], bends: float = 0.0
) -> Registration:
    final, unit_cov = _answer(best, verdict, bends)
    spot, marker = final.pairs()
    residuals = final.state.residual[0, marker]
    distance = np.hypot(residuals[:, 0], residuals[:, 1])
    return Registration(
        cam_from_model=final.cam_from_model(),
        camera=_camera(final, unit_cov),
        matching=Matching(index[spot], marker, distance),
        rms_px=float(np.sqrt((distance**2).mean())),
        residuals=residuals,
        cov=_cov(final, unit_cov),
        excess_px=float(final.excess_px[0]),
        n_expected=best.expected,
        **_told(best, final, unit_cov, verdict, tried, options),
    )


def _of_rig(
    best: Solution, verdict: Verdict, tried: int, tasks: Sequence[Task], names: list[int],
    cam_from_rig: Sequence[Pose], index: Sequence[Ints], options: dict[str, Any],
) -> RigRegistration:  # fmt: skip
    """What several cameras found; those without spots are given back as they were."""
    final, unit_cov = _answer(best, verdict)
    nothing = np.zeros(0, np.int64)
    matchings = [Matching(nothing, nothing, np.zeros(0)) for _ in tasks]
    residuals = [np.zeros((0, 2)) for _ in tasks]
    cameras, excess, expected = [task.camera for task in tasks], np.full(len(tasks), np.nan), [0] * len(tasks)
    places = list(cam_from_rig)
    for c, name in enumerate(names):
        spot, marker = final.pairs(c)
        residuals[name] = final.state.residual[c, marker]
        matchings[name] = Matching(index[name][spot], marker, np.hypot(residuals[name][:, 0], residuals[name][:, 1]))
        cameras[name], expected[name] = _camera(final, unit_cov, c), int(final.state.numbers[c, EXPECTED])
        excess[name] = final.excess_px[c] if len(marker) else np.nan
        if final.views.loose[c, PLACE:WIDE].any():
            places[name] = final.cam_from_model(c) @ final.rig_from_model.inverse()
    to_model = best.to_model()
    return RigRegistration(
        rig_from_model=final.rig_from_model,
        cameras=tuple(cameras),
        cam_from_rig=tuple(places),
        matchings=tuple(matchings),
        rms_px=float(np.sqrt((np.concatenate(residuals) ** 2).sum(axis=1).mean())),
        residuals=tuple(residuals),
        cov=to_model @ unit_cov[:6, :6] @ to_model.T,
        excess_px=excess,
        n_expected=tuple(expected),
        **_told(best, final, unit_cov, verdict, tried, options),
    )


def _answer(best: Solution, verdict: Verdict, bends: float = 0.0) -> tuple[Solution, Array]:
    """The solution as it is reported, and its covariance, see `judge.answer`."""
    others = {"near": verdict.near, "without": verdict.without, "imaged": verdict.imaged}
    return answer(best, verdict.beside, bends, final=verdict.published, **others)  # type: ignore[arg-type]


def _told(
    best: Solution, final: Solution, unit_cov: Array, verdict: Verdict, tried: int, options: dict[str, Any]
) -> dict[str, Any]:
    """What is told alike of one camera and of a rig."""
    report = final.state.report
    steps = int(report[STEPS])
    return {
        "score": best.score, "log10_nfa": best.log10_nfa, "runner_up": verdict.runner_up, "n_hypotheses": tried,
        "report": SolveReport("converged_gradient", True, steps, steps, *report[[COST_START, COST_END]].tolist()),
        "xyz": final.views.planes[0].task.markers.xyz,
        "deformation": _deformation(final, unit_cov) if final.is_bent else None,
        "unchecked": verdict.unchecked, "options": options,
    }  # fmt: skip


def _cov(best: Solution, unit_cov: Array) -> Array:
    """(6, 6) of [rotation, translation] of the model; (7, 7) with a free focal length in pixels last."""
    task = best.views.planes[0].task
    change = np.zeros((7, len(unit_cov)))
    change[:6, :6] = best.to_model()
    if not task.free_focal:
        change = change[:6]
    else:
        change[6, 6] = task.focal_sigma * best.camera().focal_px
    return np.asarray(change @ unit_cov @ change.T)


def _camera(best: Solution, unit_cov: Array, c: int = 0) -> Camera:
    """Camera c as found, with the covariance of what was open of it."""
    camera, loose = best.camera(c), np.delete(best.views.loose[c], slice(PLACE - 1, WIDE), axis=0)
    if not loose.any():
        return camera
    columns = loose.copy()
    columns[0] *= camera.focal_px
    own = slice(6 + c * loose.shape[1], 6 + (c + 1) * loose.shape[1])
    return replace(camera, cov=columns @ unit_cov[own, own] @ columns.T)


def _deformation(best: Solution, unit_cov: Array) -> Deformation:
    """The deformation in the model's own units and in the picture."""
    views, modes = best.views, best.views.modes
    scale, cov = views.layout.frame.scale, unit_cov[-len(modes) :, -len(modes) :]
    displacement = scale * best.displacement
    variance = np.einsum("knc,kj,jnc->nc", modes, cov, modes, optimize=True)
    xyz, pose, camera = views.planes[0].task.markers.xyz, best.cam_from_model(), best.camera()
    shift = camera.project(pose.apply(xyz + displacement))[0] - camera.project(pose.apply(xyz))[0]
    parameters = float(len(modes) - np.trace(best.unit_cov[-len(modes) :, -len(modes) :]))
    return Deformation(displacement, scale * np.sqrt(variance), shift, best.largest, parameters)
