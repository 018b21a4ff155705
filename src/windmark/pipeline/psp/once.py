"""Every picture of a point is one measurement: named as two kinds the point is refused, named twice it counts once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from windmark.errors import DataError
from windmark.pipeline.psp.bits import SameBits
from windmark.pipeline.psp.sensors import CameraSensor
from windmark.pipeline.psp.taken import Taken, said

NAMED = 3
"""Pictures that are named of those of two kinds."""


class Once:
    """The pictures of a point by what they show.

    Parameters
    ----------
    sensors : camera -> its sensor, whose dark and flat pictures are known

    Attributes
    ----------
    remarks : what is to be said of copies
    pictures : content -> kind, name and camera of every picture so far; of dark and flat ones the kind is ""
    """

    def __init__(self, sensors: Mapping[str, CameraSensor]) -> None:
        self.pictures: dict[bytes, tuple[str, str, str]] = {}
        for camera, sensor in sensors.items():
            self.pictures |= {content: ("", name, camera) for content, name in sensor.contents.items()}
        self.remarks: list[str] = []
        self._stored = SameBits()

    def of(self, kind: str, pictures: Mapping[str, list[Taken]]) -> dict[str, list[Taken]]:
        """The pictures of a kind, each in its place, copies of earlier ones without their image.

        Raises
        ------
        DataError
            For a picture that was named as another kind, or another camera's, before: a ratio of pictures with
            themselves is 1 whatever the wind does, and no sigma shows it. For pictures whose levels are stored in other
            bits than those before, see `SameBits`.
        """
        out: dict[str, list[Taken]] = {}
        both: list[str] = []
        for camera, own in pictures.items():
            out[camera] = []
            for picture in own:
                words = said(kind, camera, picture)
                there = (kind, picture.name, camera)
                before = there if picture.image is None else self.pictures.setdefault(picture.content, there)
                if before[::2] != there[::2]:
                    both.append(f"{words} is {' picture '.join(w for w in before[:2] if w)} of {before[2]}")
                elif before is not there:
                    self.remarks.append(f"{words} is the same picture as {before[1]}: it counts once")
                out[camera].append(picture if before is there else replace(picture, image=None, copy=True))
        if both:
            more = f", and {len(both) - NAMED} more" if len(both) > NAMED else ""
            raise DataError(
                f"the same pictures are named as two: {'; '.join(both[:NAMED])}{more}; expected others for each: "
                "correct the patterns in the table of points, or copy the pictures again"
            )
        self._stored.check(kind, out)
        return out
