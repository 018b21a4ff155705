"""Pictures whose grey levels are stored in other bits than those that they are compared with.

A camera of 12 bits may write its levels into the upper bits of 16 or into the lower ones, by a switch of its program:
then they differ by a factor of 16. Less a dark picture of the other kind they are no light, and no sigma shows it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.errors import DataError
from windmark.pipeline.psp.taken import Taken, said
from windmark.scene.levels import UNUSED, unused_bits

Array = NDArray[np.float64]
Image = NDArray[np.generic]

STRIDE = 8
"""Rows and columns of pictures of which one is asked for their light."""
HALF = 0.5
"""Of the bits by which levels would be shifted, from which on that they are is nearer than that they are not."""
DARKEST = 0.01
"""Quantile of a picture over its dark picture that tells whether their levels are the same: of its background."""
ADVICE = ("one of them is stored in other bits of its numbers; save all pictures of a camera alike (the mean of "
          "several as floating point numbers)")  # fmt: skip


@dataclass(frozen=True)
class Bits:
    """Which low bits of pictures are unused, see `unused_bits`.

    Parameters
    ----------
    least, most : at least, and at most, so many
    """

    least: int = 0
    most: int = UNUSED

    @staticmethod
    def of(pictures: Image) -> Bits:
        """Of a picture, or of several."""
        return Bits(*unused_bits(pictures))

    def beyond(self, other: Bits) -> int:
        """By how many bits these levels may be shifted up against the other ones; 0 where they may be stored alike."""
        if self.least > other.most:
            return self.least - other.most
        return self.most - other.least if other.least > self.most else 0


@dataclass(frozen=True, eq=False)
class DarkLevel:
    """What dark pictures say of how their camera's levels are stored.

    Parameters
    ----------
    level : (H, W) their mean
    bits : of theirs
    noise : variance of a pixel of one of them from picture to picture; NaN where there is one alone
    """

    level: Array
    bits: Bits
    noise: float = float("nan")

    def check(self, picture: Image, of: str) -> None:
        """See that a picture is stored as they are.

        Levels that use more bits may also be the rounded mean of several pictures, which is as bright as one. The
        darkest part of the picture tells it: it is never darker than the dark picture, and where a mean is the picture
        it is not much brighter; of shifted levels it is brighter by their factor.

        Parameters
        ----------
        picture, of : (H, W) grey levels, and what they are of in words

        Raises
        ------
        DataError
            Where it is stored otherwise.
        """
        by = Bits.of(picture).beyond(self.bits)
        there = self.level > 0
        if not by or not there.any():
            return
        floor = _bits_of(float(np.quantile(np.asarray(picture, float)[there] / self.level[there], DARKEST)))
        if floor > HALF * by if by > 0 else abs(floor) > HALF:
            raise DataError(otherwise(of, "the dark pictures", by))


class SameBits:
    """The pictures of a point so far, by camera and colour: are they all stored alike?"""

    def __init__(self) -> None:
        self._first: dict[tuple[str, str], tuple[Bits, float, str]] = {}

    def check(self, kind: str, pictures: Mapping[str, Sequence[Taken]]) -> None:
        """See that the pictures of a kind are stored as those before.

        Levels that use more bits may be the mean of several pictures: the light tells it, which is about the same then.

        Raises
        ------
        DataError
            Naming two pictures that are not.
        """
        colour = kind.partition(" (")[0].partition(" ")[2]
        for camera, own in pictures.items():
            for picture in own:
                if picture.image is None:
                    continue
                light = picture.light[::STRIDE, ::STRIDE]
                seen = float(np.median(light[good])) if (good := light > 0).any() else 1.0
                now = Bits.of(picture.image), seen, said(kind, camera, picture)
                before = self._first.setdefault((camera, colour), now)
                by = now[0].beyond(before[0])
                if shifted(by, now[1] / before[1]):
                    raise DataError(otherwise(now[2], before[2], by))


def shifted(by: int, times: float) -> bool:
    """Whether levels that are so many times as large as others of the same light are so for ``by`` bits.

    Levels that use more bits may be the mean of several pictures, which is as bright as one.
    """
    return by != 0 and _bits_of(times) / by > HALF


def _bits_of(times: float) -> float:
    """A factor between levels in bits."""
    return float(np.log2(np.maximum(times, 1e-9)))


def otherwise(of: str, other: str, by: int) -> str:
    """That two are stored otherwise, in words."""
    upper, lower = (of, other) if by > 0 else (other, of)
    return f"the grey levels of {upper} are multiples of {2 ** abs(by)}, those of {lower} are not: {ADVICE}"
