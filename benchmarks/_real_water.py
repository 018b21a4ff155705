"""Truth of the real sets with bright dots under water: block, ridge, cavity (see `_real_truth`)."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from _real_views import View
from _reference import blobs
from windmark.io import read_grey

Array = NDArray[np.float64]


def vblock(folder: Path) -> Iterator[View]:
    """Bright regions above 60 grey levels, 105 in every view; centroid above the background."""
    for k in range(1, 5):
        image = read_grey(folder / f"cam{k}.tif")
        found = blobs(image > 60, 8, 1000)
        if len(found.xy) != 105:
            raise ValueError(f"cam{k}: {len(found.xy)} bright regions, expected 105")
        true = np.array([_centroid(image, p, a) for p, a in zip(found.xy, found.area, strict=True)])
        yield View(f"cam{k}", image, "bright", true, gate_px=2.0)


def _centroid(image: NDArray, xy: Array, area: float) -> Array:
    """Grey-level centroid within 1.6 radii + 1 px, the background (median of the rim) taken off."""
    reach = 1.6 * np.sqrt(area / np.pi) + 1
    half = int(np.ceil(reach))
    x, y = np.rint(xy).astype(int)
    patch = image[y - half : y + half + 1, x - half : x + half + 1].astype(float)
    dy, dx = np.mgrid[-half : half + 1, -half : half + 1]
    dx, dy = dx + x - xy[0], dy + y - xy[1]
    r = np.hypot(dx, dy)
    weight = np.clip(patch - np.median(patch[r > reach - 1]) - 3, 0, None) * (r <= reach)
    return xy + np.array([(weight * dx).sum(), (weight * dy).sum()]) / weight.sum()


def ridge(folder: Path) -> Iterator[View]:
    """The source's own labelled points, 480 per camera."""
    for k in range(1, 4):
        points = np.loadtxt(folder / f"cam{k}_cal_points")
        yield View(f"cam{k}", read_grey(folder / f"cam{k}.tif"), "bright", points[:, :2], gate_px=1.5)


def cavity(folder: Path) -> Iterator[View]:
    """The table's dots that no wall hides, by OpenPTV's camera without its water, bent so that bright spots are met.

    The dots are domes lit from one side: their brightest place is some 1.5 px from their middle, so the gate is wide.
    """
    table, image = np.loadtxt(folder / "target_on_a_side.txt"), read_grey(folder / "cam1.tif")
    rows = [line.split() for line in (folder / "cam1.tif.ori").read_text().splitlines() if line.strip()]
    centre, turn, focal = np.array(rows[0], dtype=float), np.array(rows[2:5], dtype=float), float(rows[6][0]) / 0.012
    seen = (table[:, 1:] - centre) @ turn
    plain = np.array([639.5, 511.5]) + focal * seen[:, :2] / seen[:, 2:] * [-1, 1]
    x, y, z = (plain[:, 0] - 640) / 640, (plain[:, 1] - 512) / 512, table[:, 3] / 8
    terms = np.stack([np.ones_like(x), x, y, z, x * y, x * x, x * z], axis=1)
    clicked = np.loadtxt(folder / "man_ori.dat")[:4]
    mine = np.loadtxt(folder / "man_ori.par", dtype=int)[:4] - 1
    smooth, measured = cv2.GaussianBlur(image.astype(float), (0, 0), 2.5), clicked
    for count, gate in ((3, 14), (4, 10), (6, 7), (7, 5), (7, 4)):
        part = np.linalg.lstsq(terms[mine, :count], measured - plain[mine], rcond=None)[0]
        places = plain + terms[:, :count] @ part
        mine = np.flatnonzero(places[:, 1] < 660)  # below is the block's unlit front
        measured = np.array([_brightest(smooth, p, gate) for p in places[mine]])
        away = np.hypot(*(measured - places[mine]).T)
        keep = away < 4 * np.median(away) + 0.5
        mine, measured = mine[keep], measured[keep]
    places = places[places[:, 1] < 660]
    hidden = np.hypot(*(places - [685, 609]).T) < 8  # one dot behind a cloud of bubbles
    if len(places) != 44 or hidden.sum() != 1:
        raise ValueError(f"{folder}: {len(places)} dots in sight, {hidden.sum()} behind the bubbles; expected 44 and 1")
    yield View("cam1", image, "bright", places[~hidden], places[hidden], 4.0, 6.0)


def _brightest(smooth: Array, xy: Array, gate: int) -> Array:
    x, y = np.rint(xy).astype(int)
    window = smooth[y - gate : y + gate + 1, x - gate : x + gate + 1]
    row, column = np.unravel_index(int(window.argmax()), window.shape)
    return np.array([x - gate + column, y - gate + row], dtype=float)
