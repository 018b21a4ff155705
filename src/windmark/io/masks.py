"""Masks: which pixels of an image are used, as a picture or as polygons in a table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.io.csvtable import read_table
from windmark.io.errors import FileError
from windmark.io.images import read_grey
from windmark.io.text import Pathlike

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

TABLES = (".csv", ".txt")


def read_mask(path: Pathlike, shape: tuple[int, ...]) -> Mask:
    """Pixels to be used, (H, W).

    A picture of the image's size: the pixels that are not 0. Or a table (.csv, .txt) of corners with the columns x, y
    in pixels and, where there are several polygons, `polygon`: the pixels whose centre is inside an odd number of them
    (a polygon in another is a hole).

    Raises
    ------
    FileError
        Where the picture has not the given shape (H, W), or a polygon has fewer than three corners.
    """
    if Path(path).suffix.lower() in TABLES:
        return _from_table(path, shape)
    picture = read_grey(path)
    if picture.shape != tuple(shape):
        (h, w), (height, width) = picture.shape, shape
        raise FileError(path, f"is {w} x {h} pixels, the image {width} x {height}; expected a mask of the image's size")
    return np.asarray(picture != 0)


def _from_table(path: Pathlike, shape: tuple[int, ...]) -> Mask:
    table = read_table(path, required=("x", "y"), known=("polygon", "x", "y"))
    corners = np.column_stack([table.numbers("x"), table.numbers("y")])
    names = table.text("polygon") if "polygon" in table else [""] * len(corners)
    inside = np.zeros(tuple(shape), dtype=bool)
    if not names:
        raise FileError(path, "the table has no corners; expected at least three of a polygon")
    for name in dict.fromkeys(names):
        mine = np.array([other == name for other in names])
        if mine.sum() < 3:
            which = f"polygon {name!r}" if name else "the polygon"
            raise FileError(path, f"{which} has {mine.sum()} corners; expected at least three")
        inside ^= polygon_pixels(corners[mine], inside.shape)
    return inside


def polygon_pixels(corners: ArrayLike, shape: tuple[int, ...]) -> Mask:
    """Pixels (H, W) whose centre is inside a polygon with corners (N, 2); where it crosses itself, even is outside.

    Each row is filled between its crossings with the sides; a side counts with its upper end and without its lower one,
    so that polygons with a common side share no pixel.
    """
    xy = np.asarray(corners, dtype=float)
    height, width = shape
    inside = np.zeros((height, width), dtype=bool)
    (x0, y0), (x1, y1) = xy.T, np.roll(xy, -1, axis=0).T
    for row in range(max(0, int(np.ceil(xy[:, 1].min()))), min(height - 1, int(np.floor(xy[:, 1].max()))) + 1):
        across = (y0 <= row) != (y1 <= row)
        places = np.sort(x0[across] + (row - y0[across]) * (x1[across] - x0[across]) / (y1[across] - y0[across]))
        edges = np.clip(np.ceil(places), 0, width).astype(np.int64)
        for left, right in zip(edges[::2], edges[1::2], strict=True):
            inside[row, left:right] = True
    return inside
