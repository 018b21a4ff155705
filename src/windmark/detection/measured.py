"""Which pixels of a picture were measured: of one colour of a mosaic the others are interpolated and know nothing new.

A channel of a colour sensor's mosaic has a quarter (red, blue) or half (green) of the pixels; the rest are means of
their neighbours (`io.from_mosaic`; cameras and raw converters do the same). Least squares that takes each for a
measurement of its own states variances up to four times too small, and an edge between two pixels of the colour is
smeared by how it happens to lie to them, which moves centres. The fits see the measured ones alone.

That a picture is such a one its levels say by themselves: every pixel off the lattice is the mean of those on it that
are next to it, to the last bit that rounding leaves, and those on it are not. So it is known whichever way the picture
came, and no other picture is touched.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.generic]
Flags = NDArray[np.bool_]
Counts = tuple[NDArray[np.int64], NDArray[np.int64]]

ROUNDING = 4.0  # units in the last place of the largest level: means are sums of two or four
STRIPS, STRIP_ROWS = 8, 4  # rows that are asked first: they tell nearly every picture in no time


@dataclass(frozen=True)
class Lattice:
    """The pixels that one colour of a mosaic has.

    Parameters
    ----------
    shape : (height, width) of the picture
    row, column : parity of a pixel that belongs to it
    diagonal : whether its diagonal neighbours belong to it, too: green, every second pixel; else every fourth
    """

    shape: tuple[int, int]
    row: int
    column: int
    diagonal: bool

    @property
    def share(self) -> float:
        """Part of the pixels that are measured."""
        return 0.5 if self.diagonal else 0.25

    @property
    def scatter(self) -> float:
        """Mean variance of the picture's pixels over that of a measured one: means of two and four have less noise."""
        return (1.0 + 0.25) / 2 if self.diagonal else (1.0 + 2 * 0.5 + 0.25) / 4

    def pixels(self) -> Flags:
        """(H, W) true where a pixel is measured."""
        out = np.zeros(self.shape, dtype=bool)
        out[self.row :: 2, self.column :: 2] = True
        if self.diagonal:
            out[1 - self.row :: 2, 1 - self.column :: 2] = True
        return out

    def within(self, pixel: NDArray[np.int64], start: NDArray[np.float64], reach: NDArray[np.float64]) -> Counts:
        """Pixels (K,) that are measured, and all, within `reach` (K,) of the places pixel + start (K, 2)."""
        half = int(np.ceil(reach.max(initial=0.0) + 1.0))
        step, out = np.arange(-half, half + 1), np.zeros((2, len(pixel)), np.int64)
        height, width = self.shape
        for k, ((x, y), (dx, dy)) in enumerate(zip(pixel, start, strict=True)):
            i, j = (step + x)[None, :], (step + y)[:, None]
            inside = ((step - dx)[None, :] ** 2 + (step - dy)[:, None] ** 2 <= reach[k] ** 2) & (i >= 0) & (i < width)
            inside &= (j >= 0) & (j < height)
            own = (j % 2 == self.row) & (i % 2 == self.column)
            if self.diagonal:
                own |= (j % 2 != self.row) & (i % 2 != self.column)
            out[:, k] = (inside & own).sum(), inside.sum()
        return out[0], out[1]


def lattice_of(image: Image) -> Lattice | None:
    """The lattice from which all other pixels of an image (H, W) are interpolated; None where each is its own.

    Only floating-point pictures can be told: rounding to whole numbers leaves means that are none.
    """
    if image.dtype.kind != "f" or min(image.shape) < STRIP_ROWS + 2:
        return None
    rows = 2 * np.unique(np.linspace(0, (image.shape[0] - STRIP_ROWS) // 2, STRIPS).astype(int))
    found = list(_lattices(image.shape))
    for y in (*rows, None):
        part = image if y is None else image[y : y + STRIP_ROWS]
        found = [lattice for lattice in found if _interpolated(part, lattice)]
        if not found:
            return None
    # An even surface is the mean of its neighbours everywhere: that says nothing.
    found = [lattice for lattice in found if not _even(image, lattice)]
    return found[0] if len(found) == 1 else None


def _lattices(shape: tuple[int, ...]) -> list[Lattice]:
    two = (int(shape[0]), int(shape[1]))
    quarter = [Lattice(two, j, i, False) for j in range(2) for i in range(2)]
    return [*quarter, *(Lattice(two, 0, i, True) for i in range(2))]


def _interpolated(part: Image, lattice: Lattice) -> bool:
    """Whether all pixels off the lattice, but for those at the border, are means of their neighbours on it."""
    if lattice.diagonal:
        across = _off(part, "four", 0, 1 - lattice.column), _off(part, "four", 1, lattice.column)
        return all(_none(off, part) for off in across)
    j, i = lattice.row, lattice.column
    return (
        _none(_off(part, "row", j, 1 - i), part)
        and _none(_off(part, "column", 1 - j, i), part)
        and _none(_off(part, "corners", 1 - j, 1 - i), part)
    )


def _even(image: Image, lattice: Lattice) -> bool:
    """Whether the lattice's own pixels are means of their neighbours as well."""
    return _none(_off(image, "four", lattice.row, lattice.column), image)


def _off(part: Image, which: str, row: int, column: int) -> NDArray[np.float64]:
    """Pixels of a parity less the mean of some of their neighbours, without those at the border."""
    p = np.asarray(part, dtype=np.float64)
    here = slice(2 - row, -1, 2), slice(2 - column, -1, 2)

    def beside(dy: int, dx: int) -> NDArray[np.float64]:
        return np.roll(p, (-dy, -dx), axis=(0, 1))[here]

    with np.errstate(invalid="ignore"):
        along, down = 0.5 * (beside(0, -1) + beside(0, 1)), 0.5 * (beside(-1, 0) + beside(1, 0))
        if which == "corners":
            mean = 0.25 * (beside(-1, -1) + beside(-1, 1) + beside(1, -1) + beside(1, 1))
        else:
            mean = {"row": along, "column": down, "four": 0.5 * (along + down)}[which]
        return np.asarray(p[here] - mean)


def _none(off: NDArray[np.float64], part: Image) -> bool:
    """Whether differences are rounding; pixels that are not finite say nothing."""
    off = off[np.isfinite(off)]
    size = np.abs(part[np.isfinite(part)].astype(np.float64))
    if not off.size or not size.size:
        return True
    return bool(np.abs(off).max() <= ROUNDING * float(np.finfo(part.dtype.name).eps) * size.max())
