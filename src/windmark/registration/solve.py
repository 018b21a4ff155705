"""Search, judge, and the registration that comes of it, for one image."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.adjust import SolveReport
from windmark.geometry import PARAMETERS, Camera
from windmark.registration.budget import Budget
from windmark.registration.directions import WeakDirection, weak_directions
from windmark.registration.judge.answer import answer
from windmark.registration.judge.solve import WINDOW, judge, search_for
from windmark.registration.judge.source import Source
from windmark.registration.judge.verdict import Verdict
from windmark.registration.result import Deformation, NotRegistered, Registration
from windmark.registration.search.layout import Layout
from windmark.registration.search.plane import Plane
from windmark.registration.settle._kernels.state import COST_END, COST_START, STEPS
from windmark.registration.settle.solution import Solution
from windmark.registration.settle.views import Views
from windmark.registration.task import Limits, Task
from windmark.scene import Matching

Array = NDArray[np.float64]

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
    budget = Budget(options["max_time_s"])
    task = replace(task, visible=budget.without(task.visible))
    tried = 0
    for _ in range(LENS_STARTS):
        plane = Plane(task, layout)
        source = Source(Views.of([plane]), [search_for(plane, options)], WINDOW)
        verdict, late = judge(source, limits, options["max_hypotheses"], budget)
        tried += source.links
        moved = None if late else _with_other_lens(task, verdict)
        if moved is None:
            break
        task = moved
    if verdict.cause is None and verdict.best is not None:
        return _registration(verdict.best, verdict, tried, index, options)
    cause, reason, best = verdict.cause or "nothing", verdict.reason, verdict.best
    if cause == "time" or (late and cause in ("nothing", "weak", "misfit")):
        cause, reason = "time", f"stopped after max_time_s = {options['max_time_s']:g} s; so far: {reason}"
    if best is None:
        return NotRegistered(reason, cause, n_hypotheses=tried, options=options)
    weak: tuple[WeakDirection, ...] = ()
    if cause == "focal":
        xyz = task.markers.xyz[best.pairs()[1]]
        weak = weak_directions(best.cam_from_model(), best.camera().focal_px, _cov(best, best.unit_cov), xyz)
    return NotRegistered(reason, cause, best.count, best.cam_from_model(), verdict.runner_up, tried, weak, options)


def is_bent(camera: Camera) -> bool:
    """Whether the lens does anything but a pinhole does."""
    return any(getattr(camera, name) != 0.0 for name in ("k1", "k2", "p1", "p2", "k3", "tilt_x", "tilt_y"))


def _with_other_lens(task: Task, verdict: Verdict) -> Task | None:
    """The task with the lens at the focal length of a refused solution; None where that is not the trouble.

    The search straightens the spots with the camera as given. A strong lens at a wrong focal length does not fit.
    """
    best = verdict.best
    if not (task.free_focal and is_bent(task.camera) and verdict.cause in ("weak", "misfit")) or best is None:
        return None
    focal = best.camera().focal_px
    if abs(np.log(focal / task.camera.focal_px)) < OTHER_FOCAL:
        return None
    camera = replace(task.camera, focal_px=focal)
    return replace(task, camera=camera) if np.isfinite(camera.unproject(task.xy)).all() else None


def _registration(
    best: Solution, verdict: Verdict, tried: int, index: NDArray[np.int64], options: dict[str, Any]
) -> Registration:
    final, unit_cov = answer(best)
    spot, marker = final.pairs()
    residuals = final.state.residual[0, marker]
    distance = np.hypot(residuals[:, 0], residuals[:, 1])
    report = final.state.report
    steps = int(report[STEPS])
    return Registration(
        cam_from_model=final.cam_from_model(),
        camera=_camera(final, unit_cov),
        matching=Matching(index[spot], marker, distance),
        rms_px=float(np.sqrt((distance**2).mean())),
        residuals=residuals,
        cov=_cov(final, unit_cov),
        excess_px=float(final.excess_px[0]),
        score=best.score,
        log10_nfa=best.log10_nfa,
        runner_up=verdict.runner_up,
        n_expected=best.expected,
        n_hypotheses=tried,
        report=SolveReport("converged_gradient", True, steps, steps, float(report[COST_START]), float(report[COST_END])),
        xyz=final.views.planes[0].task.markers.xyz,
        deformation=_deformation(final, unit_cov) if final.is_bent else None,
        unchecked=verdict.unchecked,
        options=options,
    )


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


def _camera(best: Solution, unit_cov: Array) -> Camera:
    """The camera as found, with the covariance of what was open of it."""
    camera, loose = best.camera(), best.views.loose[0]
    if not loose.shape[1]:
        return camera
    columns = loose[: len(PARAMETERS)].copy()
    columns[0] *= camera.focal_px
    own = slice(6, 6 + loose.shape[1])
    return replace(camera, cov=columns @ unit_cov[own, own] @ columns.T)


def _deformation(best: Solution, unit_cov: Array) -> Deformation:
    """The deformation in the model's own units and in the picture."""
    views, modes = best.views, best.views.modes
    scale, cov = views.layout.frame.scale, unit_cov[-len(modes) :, -len(modes) :]
    displacement = scale * best.displacement
    variance = np.einsum("knc,kj,jnc->nc", modes, cov, modes, optimize=True)
    xyz, pose, camera = views.planes[0].task.markers.xyz, best.cam_from_model(), best.camera()
    shift = camera.project(pose.apply(xyz + displacement))[0] - camera.project(pose.apply(xyz))[0]
    seen = (best.state.match >= 0).any(axis=0)
    largest = float(np.linalg.norm(displacement[seen], axis=1).max()) / (scale * views.layout.size)
    parameters = float(len(modes) - np.trace(best.unit_cov[-len(modes) :, -len(modes) :]))
    return Deformation(displacement, scale * np.sqrt(variance), shift, largest, parameters)
