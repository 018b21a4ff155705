"""What a picture's levels say of the camera and of how they were stored: where it clips, which bits say nothing."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

PLATEAU, STEP, ENOUGH_LEVELS = 20, 5, 16
"""So many pixels at a picture's largest level, and so many times as many as at the next lower one that it has, are a
clipped picture. The next lower one: levels of a sensor of fewer bits lie several apart. So many of the largest levels
are looked at, and more."""
APART = 8
"""Usual distances of levels by which one is apart from the next lower one: it is none of a peak of noise."""

NOISY = 0.2
"""Part of second differences of two levels and more: white noise of a third of a level has one in seven, of half a
level three in ten, rounding alone hardly any."""
SMOOTH, EVEN, ALTERNATE, SMALLEST = 1e-5, 0.05, 0.45, 2
"""Part of a picture's range that is left of the rounding of floats; part of a step by which levels may be off. Of white
noise, 73 in 100 second differences have another sign than their neighbour, of the smaller half more than half."""
ENOUGH, A_FEW = 1_000_000, 1000
"""Pixels, in whole rows, that tell it; pixels that say of a picture that it is no mask."""

UNUSED, STAMPED, SURE = 8, 1e-3, 20
"""So many low bits are looked at; part of the pixels that may have them all the same (a number of the frame that a
camera writes into its first pixels); different levels from which on it is no accident that none has them: of twenty
that happens once in 2^20."""


def clipped_level(picture: NDArray[np.generic], *, surely: bool = True) -> float:
    """The largest level of a picture (NaN: no pixel) that is clipped there, by the pixels that pile up; else inf.

    A camera clips where its electronics do, which may be far below the largest number that a file could hold. An even
    plate without noise piles up as well: so the other pixels must show that noise is more than rounding leaves; that it
    is noise and not the rims of markers is asked only where it must be ``surely`` clipped. Of a picture of which all is
    clipped but its markers, little else is left.
    """
    if picture.dtype.kind not in "uif" or not picture.size:
        return float("inf")
    top = _lowest_plateau(picture)
    return float(top) if top is not None and _has_noise(picture, top, surely) else float("inf")


def _lowest_plateau(picture: NDArray[np.generic]) -> np.generic | None:
    """The lowest of the levels at which pixels pile up, with hardly a pixel above that is at none of them.

    A hot pixel, or what was written into a picture, may be above the level at which it is clipped.
    """
    some = picture.ravel()[:: max(1, picture.size // 10_000)]
    some = np.sort(some[np.isfinite(some)])
    if not len(some):
        return None
    for share in (0.998, 0.98, 0.5, 0.0):  # few levels are enough of most pictures
        levels, counts = np.unique(picture[picture >= some[int(share * (len(some) - 1))]], return_counts=True)
        if len(levels) > ENOUGH_LEVELS:
            break
    gaps = np.diff(levels.astype(float))
    alone = gaps > APART * np.median(gaps) if len(gaps) > 2 else np.zeros(len(gaps), bool)
    found, above = None, 0
    for k in range(len(gaps), 0, -1):  # from the highest one down
        if counts[k] >= PLATEAU and (alone[k - 1] or counts[k] > STEP * counts[k - 1]):
            found = levels[k]
            if not alone[k - 1]:
                break
        elif (above := above + int(counts[k])) >= PLATEAU:
            break
    return found


def _has_noise(picture: NDArray[np.generic], top: np.generic, surely: bool) -> bool:
    """Whether second differences along the rows, of pixels below ``top``, are those of noise.

    They change their sign from pixel to pixel, which those of a smooth picture or of the rims of discs do not (at most
    0.4 of them, of pictures drawn without noise); and of numbers that lie on levels they are more than what rounding
    leaves.
    """
    rows = picture if picture.ndim > 1 else picture[None]
    sparse = rows[:: max(1, picture.size // ENOUGH)]
    levels: NDArray[Any] = sparse.astype(np.float64 if picture.dtype.kind == "f" else np.int64)
    change = levels[:, :-2] - 2 * levels[:, 1:-1] + levels[:, 2:]
    below = np.asarray(levels < top)
    inside = below[:, :-2] & below[:, 1:-1] & below[:, 2:]
    if not inside.any():
        return not surely
    step, least = _step_of(levels[below])
    large = inside & (np.abs(change) >= max(1.99 * step, least))
    if step and large.sum() <= NOISY * inside.sum():
        return False
    if not surely:
        return True
    both = large[:, :-1] & large[:, 1:]
    first, second = change[:, :-1][both], change[:, 1:][both]
    # The smallest ones are those of noise, if there is any: rims have large ones, and not by turns.
    small = np.argsort(np.maximum(np.abs(first), np.abs(second)), kind="stable")[: first.size // SMALLEST]
    turned = int(((first < 0) != (second < 0))[small].sum())
    return turned >= PLATEAU and turned > ALTERNATE * small.size


def _step_of(levels: NDArray[Any]) -> tuple[float, float]:
    """The step of the levels that numbers lie on, 0 where they lie on none, and what rounding may be of their range."""
    some = np.unique(levels[:: max(1, levels.size // 10_000)])
    between, least = np.diff(some), SMOOTH * float(some[-1] - some[0])
    if not len(between):
        return 1.0, 0.0
    if levels.dtype.kind != "f":
        return float(np.gcd.reduce(between)), 0.0
    step = float(between.min())
    parts = between / step
    return (step, 0.0) if step > least and np.abs(parts - np.rint(parts)).max() < EVEN else (0.0, least)


def full_scale(picture: NDArray[np.generic]) -> float:
    """Largest level that a picture's numbers hold: of their type, or of 10, 12, 14 bits where a picture of 16 ends
    there; inf for floats.
    """
    if picture.dtype.kind not in "ui" or not picture.size:
        return float("inf")
    top = float(np.iinfo(picture.dtype.name).max)
    if picture.dtype.itemsize == 2:
        high = float(picture.max())
        for bits in (10, 12, 14):
            for shift in (0, 16 - bits):
                if high == float(((1 << bits) - 1) << shift):
                    return high
    return top


def saturation_level(picture: NDArray[np.generic]) -> float:
    """The level from which on a pixel says only that there was so much light or more; inf where there is none.

    A picture of zeros and full scale alone is a mask, whose numbers are no light.
    """
    return float("inf") if _is_mask(picture) else min(clipped_level(picture), full_scale(picture))


def _is_mask(picture: NDArray[np.generic]) -> bool:
    if picture.dtype.kind not in "uif" or not picture.size:
        return False
    most = np.fmax.reduce(picture, axis=None) if picture.dtype.kind == "f" else np.iinfo(picture.dtype.name).max
    some = picture.ravel()[:: max(1, picture.size // A_FEW)]  # says no of nearly all pictures, at once
    return all(bool(((p == 0) | (p == most)).all()) for p in (some, picture))


def saturated_as_missing(
    picture: NDArray[np.generic], raw: NDArray[np.generic] | None = None
) -> tuple[NDArray[np.generic], float]:
    """The picture (H, W) with NaN where it is saturated, and that level; itself and inf where no pixel is.

    Parameters
    ----------
    picture : levels, or what they mean
    raw : the levels, where ``picture`` is no longer as the camera stored it
    """
    levels = picture if raw is None else raw
    level = saturation_level(levels)
    gone = np.asarray(levels >= level) if level < np.inf else np.zeros(0, bool)  # type: ignore[operator]
    if not gone.any():
        return picture, float("inf")
    return missing_at(picture, gone), level


def missing_at(picture: NDArray[np.generic], gone: NDArray[np.bool_] | None) -> NDArray[np.generic]:
    """The picture (H, W) with NaN where pixels are ``gone``, in floats that hold its numbers; itself where none is."""
    if gone is None or not gone.any():
        return picture
    kind = picture.dtype if picture.dtype.kind == "f" else np.float32 if picture.dtype.itemsize < 4 else np.float64
    out = picture.astype(kind)
    out[gone] = np.nan
    return out


def unused_bits(picture: NDArray[np.generic]) -> tuple[int, int]:
    """How many low bits are zero in all levels of a picture, or of several: at least, and at most, so many.

    A camera of 12 bits whose levels are stored as the upper ones of 16 leaves four unused: its levels are multiples of
    16. A picture of few different levels says little, and the two numbers differ; numbers that are no whole ones say
    nothing: (0, `UNUSED`).
    """
    if picture.dtype.kind not in "ui" or not picture.size:
        return 0, UNUSED
    most = 0
    while most < UNUSED and np.mean((picture & ((2 << most) - 1)) != 0) <= STAMPED:  # type: ignore[operator]
        most += 1
    return (most if most and len(np.unique(picture)) >= SURE else 0), most
