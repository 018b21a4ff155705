"""A model followed through pictures on a disk: `tasks.follow` of files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from windmark import io
from windmark.geometry import Camera
from windmark.options.detection import CHANNEL
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
