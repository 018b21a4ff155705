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
RATIO = 4.0
"""Times that by which four pixels before it differ, of a step into a group, to be looked at."""
INTO = 0.25
"""Part of that step that makes a pixel one of the group, to find its box, where less takes in too much."""
FRAME = 4
"""Pixels round a group that are looked at, of which the outer two say what it would be."""
OUT, STRONG = 5.0, 0.5
"""Times the noise that a pixel of a group is off that; part of the most that it is for its outside to be looked at."""
BESIDE = 3.5
"""Times the noise that the two pixels before a corner may differ from the next ones, of which noise alone makes one."""
SIDES = 6
"""Sides of pixels of a group of which that is known, at least."""
TOO_MANY = 400
"""Groups to look at: more are a picture's own, or how it was drawn."""
_FOUR = ((0, 1), (0, -1), (1, 0), (-1, 0))


def dead_groups(
    g: Pixels, seeds: NDArray[np.int64], noise: Any, blur_px: float, step: float, ends: tuple[float, float]
) -> Mask | None:
    """(H, W) pixels in groups of few whose outside is as dark as if they were not there, which beside what an optic of
    ``blur_px`` has imaged it is not; None where there are none.

    Less than the least light beside such an image by three sigma, on the median side.

    Parameters
    ----------
    g : (H, W), NaN are missing
    seeds : (K, 3: row, column, side) that may be its corners, of `_kernels.dead.dead_pixels`
    noise : (H, W) 1 sigma of a pixel
    step : between grey levels
    ends : of the picture's levels
    """
    out: Mask | None = None
    if not np.isfinite(blur_px) or len(seeds := _dark_beside(g, seeds, noise, blur_px)) > TOO_MANY:
        return None
    done = set()
    for y, x, side in seeds.tolist():
        window = _box(g, y, x, side, float(noise[y, x]))
        if window is None or (where := (window[0].start, window[1].start)) in done:
            continue
        done.add(where)
        part, sigma = g[window].astype(float), float(np.median(noise[window]))
        group = _group(part, sigma, blur_px, (y - where[0], x - where[1]), step, ends)
        if group.any():
            out = np.zeros(g.shape, bool) if out is None else out
            out[window] |= group
    return out


def _dark_beside(g: Pixels, seeds: NDArray[np.int64], noise: Any, blur_px: float) -> NDArray[np.int64]:
    """The seeds beside which it is as dark as beyond, by noise or by half of what an optic leaves there: of all others
    the whole group is not asked for. Most are corners of painted dots, whose rims have light.
    """
    y, x, side = seeds.T
    beside = 0.5 * (g[y, x + side].astype(float) + g[y + side, x])
    beyond = 0.5 * (g[y, x + 2 * side].astype(float) + g[y + 2 * side, x])
    least = 0.5 * min(sharpest_pair(blur_px), sharpest_line(blur_px)) * np.abs(g[y, x] - beyond)
    return np.asarray(seeds[np.abs(beside - beyond) <= np.maximum(BESIDE * noise[y, x], least)])


def _box(g: Pixels, y: int, x: int, side: int, sigma: float) -> tuple[slice, slice] | None:
    """The window of a group that has a corner in a pixel: its own box with `FRAME` round it; None if that is large."""
    from scipy.ndimage import find_objects, label

    top, left = y - ACROSS - FRAME, x - ACROSS - FRAME
    if not all(FRAME <= at < n - FRAME for at, n in zip((y, x), g.shape, strict=True)):
        return None
    part = g[max(top, 0) : y + ACROSS + FRAME + 1, max(left, 0) : x + ACROSS + FRAME + 1]
    top, left = max(top, 0), max(left, 0)
    off = np.abs(part - np.median([g[y + side, x], g[y + 2 * side, x], g[y, x + side], g[y, x + 2 * side]]))
    for limit in (OUT * sigma, max(OUT * sigma, INTO * off[y - top, x - left])):
        parts = label(off > limit, np.ones((3, 3), bool))[0]
        box = find_objects((parts == parts[y - top, x - left]).astype(np.int8))[0]
        if max(_length(s) for s in box) <= ACROSS:
            at = zip(box, (top, left), strict=True)
            window = tuple(slice(s.start + o - FRAME, s.stop + o + FRAME) for s, o in at)
            inside = all(s.start >= 0 and s.stop <= n for s, n in zip(window, g.shape, strict=True))
            return (window[0], window[1]) if inside else None
    return None


def _length(part: slice) -> int:
    return int(part.stop - part.start)


def _group(
    window: NDArray[np.float64],
    sigma: float,
    blur_px: float,
    seed: tuple[int, int],
    step: float,
    ends: tuple[float, float],
) -> Mask:
    """Pixels of a window that are those of a dead group with that at ``seed``; ``ends`` of the picture's levels."""
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
    parts, _ = label(np.abs(off) > OUT * sigma, np.ones((3, 3), bool))
    part = (parts == parts[seed]) & (parts[seed] > 0)
    group = LEAST <= part.sum() <= MOST and not (part & ~inner).any()
    return part if group and _is_sharp(off, clipped, part, sigma, blur_px, step) else none


def _is_sharp(
    off: NDArray[np.float64], clipped: Mask, part: Mask, sigma: float, blur_px: float, step: float
) -> bool:
    """Whether there is no light beside the strong ones of a group's pixels; a ``clipped`` pixel does not tell."""
    strong = part & (np.abs(off) >= STRONG * np.abs(off[part]).max())
    beside, sizes = [], []
    for dy, dx in _FOUR:
        # Beside a strong one, with none beyond.
        beyond = np.roll(strong, (-dy, -dx), (0, 1))
        row, column = np.nonzero(np.roll(strong, (dy, dx), (0, 1)) & ~strong & ~beyond & ~clipped)
        change = off[row - dy, column - dx] - off[row, column]
        beside.append(off[row, column] / change)
        sizes.append(np.abs(change))
    light, size = np.concatenate(beside), np.concatenate(sizes)
    if len(light) < SIDES:
        return False
    thick = (strong[:-1, :-1] & strong[1:, :-1] & strong[:-1, 1:] & strong[1:, 1:]).any()
    least_light = sharpest_pair(blur_px) if thick else sharpest_line(blur_px)
    # What is beside one that does not measure scatters by noise alone; a light that is less than half a step is rounded
    # away.
    usual, across = float(np.median(light)), float(np.median(size))
    noise, rounded, n = sigma / across, 0.5 * step / across, len(light)
    scatter = max(noise, float(np.median(np.abs(light - usual))) / 0.6745)
    if abs(usual) + 3 * 1.25 * scatter / np.sqrt(n) + rounded < least_light:
        return True
    # Where it is no more than noise on all sides (chi squared), their mean tells it more sharply than the median.
    alone = bool((light**2).mean() < noise**2 * (1 + 3 * np.sqrt(2 / n)))
    return alone and abs(float(light.mean())) + 3 * noise / np.sqrt(n) + rounded < least_light
