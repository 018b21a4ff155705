"""Groups of a sensor's pixels that do not measure: dead or hot ones that touch."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.detection.sharpest import sharpest_line, sharpest_pair

Pixels = NDArray[np.float32]
Mask = NDArray[np.bool_]

LEAST, MOST, ACROSS = 3, 25, 12
"""Pixels of a group; across which it is at most. One and two are looked at by themselves."""
LIMIT, FLAT = 10.0, 0.25
"""Times the noise of a step into a group; part of it that the pixels before it may differ by, to be looked at."""
FRAME = 4
"""Pixels round a group that are looked at, of which the outer two say what it would be."""
OUT, STRONG = 5.0, 0.5
"""Times the noise that a pixel of a group is off that; part of the most that it is for its outside to be looked at."""
SIDES = 6
"""Sides of pixels of a group of which that is known, at least."""
TOO_MANY = 400
"""Groups to look at: more are a picture's own, or how it was drawn."""
_FOUR = ((0, 1), (0, -1), (1, 0), (-1, 0))


def dead_groups(g: Pixels, noise: Any, blur_px: float, least: float) -> Mask | None:
    """(H, W) pixels in groups of few whose outside is as dark as if they were not there, which beside what an optic of
    ``blur_px`` has imaged it is not; None where there are none.

    Parameters
    ----------
    g : (H, W), NaN are missing
    noise : (H, W) 1 sigma of a pixel
    least : a step that is smaller makes no group

    Less than the least light beside such an image by three sigma, on the median side.
    """
    if min(g.shape) < 2 * FRAME + 3 or not np.isfinite(blur_px):
        return None
    seeds = _steep(g, noise, least) | _steep(g.T, noise.T, least).T
    if not seeds.any():
        return None
    from scipy.ndimage import binary_dilation, find_objects, label

    eight = np.ones((3, 3), bool)
    groups = find_objects(label(binary_dilation(seeds, eight), eight)[0])
    small = [p for p in groups if max(_length(s) for s in p) <= ACROSS + 2]
    if len(small) > TOO_MANY:
        return None
    out, ends = np.zeros(g.shape, bool), (float(np.fmin.reduce(g, axis=None)), float(np.fmax.reduce(g, axis=None)))
    for rows, columns in small:
        # The seeds' own box is one pixel less on each side.
        window = tuple(slice(s.start + 1 - FRAME, s.stop - 1 + FRAME) for s in (rows, columns))
        if min(s.start for s in window) >= 0 and all(s.stop <= n for s, n in zip(window, g.shape, strict=True)):
            part, sigma = g[window].astype(float), float(np.median(noise[window]))
            out[window] |= _group(part, sigma, blur_px, seeds[window], ends)
    return out if out.any() else None


def _length(part: slice) -> int:
    return int(part.stop - part.start)


def _steep(g: Pixels, noise: Any, least: float) -> Mask:
    """Pixels that are a step off the next one in their row, which is at the level of the next but one."""
    step = np.diff(g, axis=1)
    size = np.abs(step)
    out = np.zeros(g.shape, bool)
    large = size > np.maximum(LIMIT * noise[:, 1:], least)
    out[:, 2:] |= large[:, 1:] & (size[:, :-1] < FLAT * size[:, 1:])
    out[:, :-2] |= large[:, :-1] & (size[:, 1:] < FLAT * size[:, :-1])
    return out


def _group(window: NDArray[np.float64], sigma: float, blur_px: float, seeds: Mask, ends: tuple[float, float]
           ) -> Mask:  # fmt: skip
    """Pixels of a window that are those of a dead group; ``ends`` of the picture's levels."""
    from scipy.ndimage import label

    inner = np.zeros(window.shape, bool)
    inner[2:-2, 2:-2] = True
    around = window[~inner]
    none = np.zeros(window.shape, bool)
    if not np.isfinite(window).all():
        return none
    usual = np.median(around)
    sigma = max(sigma, float(np.median(np.abs(around - usual))) / 0.6745)
    off = window - usual
    clipped = (window <= ends[0]) | (window >= ends[1])
    parts, count = label(np.abs(off) > OUT * sigma, np.ones((3, 3), bool))
    out = none.copy()
    for k in range(1, count + 1):
        part = parts == k
        group = LEAST <= part.sum() <= MOST and not (part & ~inner).any() and (part & seeds).any()
        if group and _is_sharp(off, clipped, part, sigma, blur_px):
            out |= part
    return out


def _is_sharp(off: NDArray[np.float64], clipped: Mask, part: Mask, sigma: float, blur_px: float) -> bool:
    """Whether there is no light beside the strong ones of a group's pixels; a ``clipped`` pixel does not tell."""
    strong = part & (np.abs(off) >= STRONG * np.abs(off[part]).max())
    beside, sizes = [], []
    for dy, dx in _FOUR:
        # Beside a strong one, with none beyond.
        beyond = np.roll(strong, (-dy, -dx), (0, 1))
        row, column = np.nonzero(np.roll(strong, (dy, dx), (0, 1)) & ~strong & ~beyond & ~clipped)
        step = off[row - dy, column - dx] - off[row, column]
        beside.append(off[row, column] / step)
        sizes.append(np.abs(step))
    light, size = np.concatenate(beside), np.concatenate(sizes)
    if len(light) < SIDES:
        return False
    thick = (strong[:-1, :-1] & strong[1:, :-1] & strong[:-1, 1:] & strong[1:, 1:]).any()
    least_light = sharpest_pair(blur_px) if thick else sharpest_line(blur_px)
    spread = 1.25 * sigma / float(np.median(size)) / np.sqrt(len(light))
    return bool(abs(np.median(light)) + 3 * spread < least_light)
