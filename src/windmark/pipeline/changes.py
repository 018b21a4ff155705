"""What two runs of one project have differently, per image: names, residuals, poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Pose
from windmark.pipeline.outputs import pose_difference
from windmark.pipeline.results import ImageResult, RunResult

SAME_PX = 1.0
"""Spots of two runs that are no farther apart are the same spot."""


@dataclass(frozen=True)
class SeenImage:
    """What is kept of an image for a comparison.

    Parameters
    ----------
    status : "done", or what went wrong
    spots : how many there are; None without detection
    names : marker name -> (x, y) of its spot
    rms_px : of the residuals; None without any
    pose : None where there is none
    """

    status: str
    spots: int | None
    names: dict[str, NDArray[np.float64]]
    rms_px: float | None
    pose: Pose | None


Seen = dict[str, SeenImage]
"""By the name of the image."""


@dataclass(frozen=True)
class Change:
    """One image before and after; None for an image that only one of the runs has.

    Parameters
    ----------
    gained, lost : names that only the later, only the earlier run has
    moved : names that are at another spot
    angle_deg, distance : between the poses, in length units; None where one of them is missing
    """

    image: str
    before: SeenImage | None
    after: SeenImage | None
    gained: tuple[str, ...] = ()
    lost: tuple[str, ...] = ()
    moved: tuple[str, ...] = ()
    angle_deg: float | None = None
    distance: float | None = None


def seen(result: RunResult) -> Seen:
    """What is to be kept of a run; its pictures are not."""
    return {item.name: _seen(item, result) for item in result.images}


def _seen(item: ImageResult, result: RunResult) -> SeenImage:
    answer, markers = item.registered, result.markers
    names: dict[str, NDArray[np.float64]] = {}
    if answer is not None and markers is not None and item.detections is not None:
        xy = item.detections.xy[answer.matching.detection]
        names = dict(zip((str(n) for n in markers.name[answer.matching.marker]), xy, strict=True))
    return SeenImage(
        item.problem or "done", None if item.detections is None else len(item.detections), names,
        answer.rms_px if answer is not None and len(answer.matching) else None, item.cam_from_model,
    )  # fmt: skip


def changes(before: Seen, after: Seen) -> list[Change]:
    """One per image of either run, in the order of the later one."""
    order: Sequence[str] = [*after, *(name for name in before if name not in after)]
    return [_change(name, before.get(name), after.get(name)) for name in order]


def _change(name: str, old: SeenImage | None, new: SeenImage | None) -> Change:
    if old is None or new is None:
        return Change(name, old, new)
    both = [n for n in new.names if n in old.names]
    moved = [n for n in both if np.linalg.norm(new.names[n] - old.names[n]) > SAME_PX]
    change = Change(
        name, old, new, tuple(n for n in new.names if n not in old.names),
        tuple(n for n in old.names if n not in new.names), tuple(moved),
    )  # fmt: skip
    if old.pose is None or new.pose is None:
        return change
    apart = pose_difference(new.pose, old.pose)
    return Change(name, old, new, change.gained, change.lost, change.moved, apart["angle_deg"],
                  apart["station_distance"])  # fmt: skip
