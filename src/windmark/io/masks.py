"""Masks: which pixels of an image are used, as a picture or as polygons in a table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark.io._pillow import transparent_pixels
from windmark.io.colour import to_grey
from windmark.io.csvtable import read_table
from windmark.io.errors import FileError, decoding
from windmark.io.images import read_image
from windmark.io.recordings.address import frame_address
from windmark.io.text import Pathlike

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

TABLES = (".csv", ".txt")
_CROSSINGS = 2**21
_FARTHEST_PX = 1e9


def read_mask(path: Pathlike, shape: tuple[int, ...]) -> Mask:
    """Pixels to be used, (H, W).

    A picture of the image's size: the pixels that are not 0, in its grey levels. Or a table (.csv, .txt) of corners
    with the columns x, y in pixels and, where there are several polygons, `polygon`: the pixels whose centre is inside
    an odd number of them (a polygon in another is a hole).

    Raises
    ------
    FileError
        Where the picture has not the given shape (H, W), is transparent where its colour is not black, has several grey
        levels and none of them 0; where a polygon has fewer than three corners; where no pixel is used.
    """
    if Path(path).suffix.lower() in TABLES:
        use = _from_table(path, shape)
    else:
        use = _from_picture(path, shape)
    if not use.any():
        raise FileError(path, "no pixel is used: the mask is 0 everywhere, and 0 is what is left out")
    return use


def _from_picture(path: Pathlike, shape: tuple[int, ...]) -> Mask:
    picture = read_image(path)
    grey = to_grey(picture)
    if grey.shape != tuple(shape):
        (h, w), (height, width) = grey.shape, shape
        raise FileError(path, f"is {w} x {h} pixels, the image {width} x {height}; expected a mask of the image's size")
    use = np.asarray(grey != 0)
    if picture.ndim == 3 and picture.shape[2] in (2, 4):
        clear = np.asarray(picture[..., -1] == 0)
    else:
        file = frame_address(path).file
        with decoding(file):
            clear = transparent_pixels(file, shape)
    if (count := int((clear & use).sum())) or (clear.any() and not use.any()):  # a shape that only an eye would see
        which = f"{count} transparent pixels of it are not black" if count else "it is black, its shape transparency"
        what = "expected grey levels alone to say what is used (0: left out): save it without transparency"
        raise FileError(path, f"{which}; {what}")
    if use.all() and (grey != grey.flat[0]).any():
        low, high = grey.min(), grey.max()
        what = f"its pixels are {low:g} to {high:g} and none is 0: it would mask nothing"
        raise FileError(path, f"{what}; expected 0 where pixels are left out")
    return use


def _from_table(path: Pathlike, shape: tuple[int, ...]) -> Mask:
    table = read_table(path, required=("x", "y"), known=("polygon", "x", "y"))
    corners = np.column_stack([table.numbers("x"), table.numbers("y")])
    table.check((np.abs(corners) < _FARTHEST_PX).all(axis=1), "x and y must be pixels, within a thousand million")
    names = table.text("polygon") if "polygon" in table else [""] * len(corners)
    if not names:
        raise FileError(path, "the table has no corners; expected at least three of a polygon")
    polygons: dict[str, list[int]] = {}
    for row, name in enumerate(names):
        polygons.setdefault(name, []).append(row)
    for name, rows in polygons.items():
        if len(rows) < 3:
            which = f"polygon {name!r}" if name else "the polygon"
            raise FileError(path, f"{which} has {len(rows)} corners; expected at least three")
    return filled([corners[rows] for rows in polygons.values()], shape)


def filled(polygons: Sequence[Array], shape: tuple[int, ...]) -> Mask:
    """Pixels (H, W) whose centre is inside an odd number of polygons with corners (N, 2) each, which may cross.

    Each row is filled between its crossings with the sides; a side counts with its upper end and without its lower one,
    so that polygons with a common side share no pixel.
    """
    height, width = shape
    ends = [np.stack([xy, np.roll(xy, -1, axis=0)], axis=1) for xy in polygons]
    sides = np.concatenate(ends)  # (S, 2, 2): beginning and end, x and y
    low, high = np.sort(sides[:, :, 1], axis=1).T
    first = np.clip(np.ceil(low), 0, height).astype(np.int64)  # low <= row < high
    behind = np.clip(np.ceil(high), 0, height).astype(np.int64)
    odd = np.zeros((height, width + 1), dtype=bool)
    for part in _parts_of(np.maximum(behind - first, 0)):
        (x0, y0), (x1, y1) = sides[part, 0].T, sides[part, 1].T
        count = np.maximum(behind[part] - first[part], 0)
        k = np.repeat(np.arange(len(count)), count)
        row = first[part][k] + np.arange(len(k)) - (np.cumsum(count) - count)[k]
        places = x0[k] + (row - y0[k]) * (x1[k] - x0[k]) / (y1[k] - y0[k])
        column = np.clip(np.ceil(places), 0, width).astype(np.int64)
        odd ^= np.bincount(row * (width + 1) + column, minlength=odd.size).reshape(odd.shape) % 2 == 1
    return np.logical_xor.accumulate(odd, axis=1)[:, :width]


def _parts_of(counts: NDArray[np.int64]) -> Iterator[slice]:
    """Runs of sides that cross some millions of rows."""
    total = np.cumsum(counts)
    cuts = np.searchsorted(total, np.arange(_CROSSINGS, total[-1], _CROSSINGS)) + 1
    bounds = [0, *np.unique(cuts[cuts < len(counts)]).tolist(), len(counts)]
    yield from (slice(a, b) for a, b in pairwise(bounds))
