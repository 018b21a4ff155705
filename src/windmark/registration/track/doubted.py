"""Frames whose labels the motion has chosen but whose residuals speak against the rigid model: the judge is asked.

What it weighs is the one labelling that the motion left, so it need not search; the rest is as in `register`: a bent
model, other cameras, the mirrored table, a pair that holds the pose. A model that bends in some frames may do so in
those that do not show it, and their sigma has that.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Pose
from windmark.registration.budget import Budget, work_for
from windmark.registration.judge.discs import stands
from windmark.registration.judge.judge import Judge
from windmark.registration.judge.source import Source
from windmark.registration.judge.verdict import Verdict
from windmark.registration.result import Registration
from windmark.registration.search.plane import Plane
from windmark.registration.search.pool import Candidate
from windmark.registration.settle.settling import settle
from windmark.registration.settle.views import Views
from windmark.registration.solve import WINDOW, _registration
from windmark.registration.task import Limits, Task
from windmark.registration.track._kernels.step import TRUSTED
from windmark.registration.track.prepared import BENT, Prepared
from windmark.scene import Detections


class _Followed:
    """A search that proposes what was followed and nothing else: its rivals were weighed with the motion."""

    links = 1

    def __init__(self, candidate: Candidate) -> None:
        self.best = candidate

    def batches(self) -> Iterator[int]:
        yield self.links

    def top(self, count: int, within: float = np.inf) -> list[Candidate]:
        return [self.best][:count]

    def rivals(self, seen: Candidate, over: Callable[[], bool]) -> bool:
        return True


def judged(
    prepared: Prepared, detections: Detections, pose: Pose, match: NDArray[np.int32], worth: float, tolerance: float,
    limits: Limits, bends: float, options: dict[str, Any],
) -> Registration | str:  # fmt: skip
    """What the judge makes of a pose and its labels (N,), worth so many nats; why it is refused otherwise."""
    plane, usable, match = _seen(prepared, detections, match, tolerance)
    candidate = Candidate(pose, prepared.camera.focal_px, worth, int((match >= 0).sum()), match)
    budget = Budget.of(work_for(plane.task, "hash"), options["max_time_s"])
    source = Source(Views.of([plane]), [cast(Any, _Followed(candidate))], WINDOW, budget)
    verdict = stands(Judge(source, replace(limits, deformation=BENT), budget).verdict(), limits)
    if verdict.cause is not None or verdict.best is None:
        return verdict.reason
    return _registration(verdict.best, verdict, source.links, usable, options, bends)


def covered(
    prepared: Prepared, detections: Detections, pose: Pose, match: NDArray[np.int32], tolerance: float, limits: Limits,
    bends: float, options: dict[str, Any],
) -> Registration | str:  # fmt: skip
    """A rigid pose and its labels (N,), with the sigma of a model that bends in other frames; "" if they part.

    Where its discs contradict it, why.
    """
    plane, usable, match = _seen(prepared, detections, match, tolerance)
    best = settle(Views.of([plane]), *prepared.layout.frame.unit(pose), match[None], trusted=TRUSTED)
    if best is None:
        return ""
    verdict = stands(Verdict(best, None, None, ""), limits)
    return verdict.reason if verdict.cause is not None else _registration(best, verdict, 1, usable, options, bends)


def _seen(
    prepared: Prepared, detections: Detections, match: NDArray[np.int32], tolerance: float
) -> tuple[Plane, NDArray[np.int64], NDArray[np.int32]]:
    """The spots that the lens can invert, their numbers, and the labels (N,) among them."""
    usable = np.isfinite(prepared.camera.unproject(detections.xy)).all(axis=1)
    within = np.append(np.where(usable, np.cumsum(usable) - 1, -1), -1).astype(np.int32)  # the last is for "no spot"
    task = Task(
        prepared.layout.markers, prepared.camera, detections.xy[usable], detections.cov[usable], tolerance,
        radius_px=detections.radius_px[usable],
    )  # fmt: skip
    return Plane(task, prepared.layout), np.flatnonzero(usable), within[match]
