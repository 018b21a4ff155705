"""Which cameras of a project stand still to each other, and which of its images were taken at one instant."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from pydantic import Field

from windmark.errors import UsageError
from windmark.pipeline.settings import Strict

CameraNames = Annotated[tuple[str, ...], Field(min_length=2)]


class RigOptions(Strict):
    """Cameras with known places to each other: their images of one instant are registered together.

    ``file``: where they are, as ``windmark calibrate --rig`` writes it (rig.json), by the names of the cameras; without
    it the poses in the cameras' own files, all from one frame (the tunnel's, or that of the model at some instant).
    ``cameras``: which ones, by default all whose pose is to be found. ``trust``: those that get their pose from the
    others even where none of their own markers checks it, as an infrared camera that sees none. Images with the same
    ``point`` are of one instant; where no image has one, all are.
    """

    file: Path | None = None
    cameras: CameraNames | None = None
    trust: tuple[str, ...] = ()


Image = tuple[str, str | None, str]
"""Name, point and camera of an image."""


def check_rig(rig: RigOptions, find: Sequence[str], known: Sequence[str], images: Sequence[Image]) -> None:
    """Refuse a [rig] table that does not fit the cameras and images.

    Parameters
    ----------
    find, known : names of the cameras whose pose is to be found, and of those whose pose is known
    images : (name, point, camera) of each

    Raises
    ------
    ValueError
        For cameras that are unknown, have a known pose or are fewer than two; images without a point beside others that
        have one; two images of one camera at one instant.
    """
    for name in rig.cameras or ():
        if name in known:
            raise UsageError(f'rig: the pose of camera {name} is known (pose = "known"), there is nothing to find; '
                             "leave it out of rig.cameras")  # fmt: skip
        if name not in find:
            raise UsageError(f"rig: cameras: {name!r} is not the name of a camera; they are {', '.join(find)}")
    if rig.cameras is not None and len(set(rig.cameras)) < len(rig.cameras):
        raise UsageError("rig: cameras: every camera is named once")
    cameras = rig_cameras(rig, find)
    if len(cameras) < 2:
        raise UsageError(
            f"rig: expected at least two cameras whose pose is to be found, got {', '.join(cameras) or 'none'}"
        )
    strange = [name for name in rig.trust if name not in cameras]
    if strange:
        raise UsageError(f"rig: trust: {strange[0]!r} is not a camera of the rig; they are {', '.join(cameras)}")
    mine = [image for image in images if image[2] in cameras]
    without = [name for name, point, _ in mine if point is None]
    if without and len(without) < len(mine):
        raise UsageError(f"rig: image {without[0]} has no point while others have one; images of one instant have the "
                         "same point")  # fmt: skip
    for point, members in instants(rig, find, images).items():
        taken = [camera for _, camera in members]
        double = next((c for c in taken if taken.count(c) > 1), None)
        if double is not None:
            two = [image for image, camera in members if camera == double]
            at = "" if point is None else f" of point {point}"
            raise UsageError(f"rig: images {two[0]} and {two[1]}{at} are both of camera {double}, so of different"
                             ' instants; give the images of each instant their own point (point = "...")')  # fmt: skip


def rig_cameras(rig: RigOptions | None, find: Sequence[str]) -> tuple[str, ...]:
    """The cameras of the rig, in its order; none without one."""
    if rig is None:
        return ()
    return rig.cameras or tuple(find)


def instants(
    rig: RigOptions | None, find: Sequence[str], images: Sequence[Image]
) -> dict[str | None, list[tuple[str, str]]]:
    """Point -> (image, camera) of the images that the rig took at this instant, in the order of its cameras."""
    cameras = rig_cameras(rig, find)
    out: dict[str | None, list[tuple[str, str]]] = {}
    for name, point, camera in images:
        if camera in cameras:
            out.setdefault(point, []).append((name, camera))
    return {point: sorted(members, key=lambda m: cameras.index(m[1])) for point, members in out.items()}
