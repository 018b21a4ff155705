"""Pictures of a camera that repeat the one before: it dropped a frame, and they are no measurement of their time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from windmark.io import FileError
from windmark.pipeline.deform.pictures import read
from windmark.pipeline.same_picture import content_of
from windmark.tasks.deform.task import DeformationTest, FrameImages

REPEATS = "its picture repeats the one before: the camera dropped a frame, and it does not count"


def without_repeats(
    frames: Iterable[FrameImages], before: Sequence[FrameImages], test: DeformationTest
) -> Iterator[FrameImages]:
    """The frames with the pictures that are new in them; one that repeats another is ``missing``, see `repeated_in`.

    Taken as new, a repeated picture has the temperature of an earlier time, and heat flux is made of its changes: it
    would be zero there, too large at the next picture, and of noise that is counted more than once. What a camera with
    a clock of its own took at other instants (``shots``) is not asked.

    Parameters
    ----------
    before : the frames that these go on from, see `resume`
    """
    last: dict[str, bytes] = {}
    for frame in reversed(before):
        if len(last) == len(test.stations):
            break
        last = {**_contents(frame, test), **last}
    for frame in frames:
        own = _contents(frame, test)
        same = tuple(name for name, content in own.items() if last.get(name) == content)
        last |= own
        if same:
            images = {name: image for name, image in frame.images.items() if name not in same}
            frame = replace(frame, images=images, missing={**frame.missing, **dict.fromkeys(same, REPEATS)})
        yield frame


def repeated_in(frame: FrameImages) -> tuple[str, ...]:
    """Cameras whose picture `without_repeats` has taken out."""
    return tuple(name for name, why in frame.missing.items() if why == REPEATS)


def _contents(frame: FrameImages, test: DeformationTest) -> dict[str, bytes]:
    """Camera -> content of its picture of the instant; what cannot be read is told of where it is needed."""
    out = {}
    for name, item in frame.images.items():
        if name not in frame.shots:
            try:
                out[name] = content_of(read(item, test.station(name)))
            except FileError:
                continue
    return out
