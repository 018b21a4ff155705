"""A model followed through pictures on a disk: `tasks.follow` of files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any

from windmark import detection, io
from windmark.geometry import Camera
from windmark.options.detection import CHANNEL
from windmark.pipeline.verdict.picture import PictureState, picture_state
from windmark.scene import MarkerSet
from windmark.tasks import follow as task
from windmark.tasks.follow import FollowedFrame, Image


@dataclass(frozen=True)
class FollowOptions(task.FollowOptions):
    """How to follow pictures; ``channel`` and ``bayer`` of `io.read_grey` besides what `tasks.follow` has."""

    channel: str = CHANNEL.default
    bayer: str | None = None


def follow(
    images: Iterable[io.PictureFile | tuple[str, Image]],
    markers: MarkerSet,
    camera: Camera,
    *,
    options: FollowOptions | None = None,
    instants: Sequence[float] | None = None,
    handed_on: dict[str, Any] | None = None,
) -> Iterator[FollowedFrame]:
    """`tasks.follow.follow` of paths, frames of recordings, or names with grey images."""
    how = options or FollowOptions()
    read = partial(io.read_grey, channel=how.channel, bayer=how.bayer)
    return task.follow(images, markers, camera, options=how, read=read, instants=instants, handed_on=handed_on)


def first_state(images: Iterable[io.PictureFile], options: FollowOptions) -> PictureState | None:
    """State of the first picture that can be read, for a sequence in which none gave a pose; None where none can."""
    for image in images:
        with suppress(io.FileError):
            grey = io.read_grey(image, channel=options.channel, bayer=options.bayer)
            look = detection.find_markers(
                grey, radius_px=options.radius_px, polarity=options.polarity, merit_max=options.merit_max,
                mask=options.mask,
            )  # fmt: skip
            return picture_state(grey, look.detections, look.polarity)
    return None
