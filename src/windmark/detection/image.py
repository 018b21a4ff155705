"""An image as the detector wants it: float32, markers dark, zero near the median, dead pixels NaN."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError
from windmark.options.detection import POLARITY
from windmark.scene.levels import full_scale

POLARITIES = POLARITY.choices
SAMPLE = 20_000  # pixels that say what an image's levels and noise are, to about 1 %
BLOCK_ROWS = 32  # converted at a time: they stay in the cache
DEAD_NOISE = 10.0  # a dead pixel leaves the range of its neighbours by so many times the noise
DEAD_RATIO = 5.0  # and by so many times that range: the smallest disc, blurred by 0.4 px, does so 2.8 times
Pixels = NDArray[np.float32]


@dataclass(frozen=True)
class Levels:
    """How an image's grey levels become the detector's: sign * (image - offset).

    Parameters
    ----------
    sign : 1 for dark markers, -1 for bright ones
    offset : the image's median
    step : smallest step between grey levels, 0 for images without steps
    dead : a pixel that leaves the range of its neighbours by less is not dead
    """

    sign: float
    offset: float
    step: float
    dead: float


@dataclass(frozen=True)
class Prepared:
    """A prepared image.

    Parameters
    ----------
    g : (H, W) float32, sign * (image - offset); NaN where a pixel is not finite, masked out or dead
    missing : whether there are such pixels
    sign : 1 for dark markers, -1 for bright ones
    quantum : smallest step between grey levels; for images without steps 2^-16 of their range
    clip : saturation level in units of sign * g (inf where it is not known: floating-point images)
    """

    g: Pixels
    missing: bool
    sign: float
    quantum: float
    clip: float


def check_polarity(polarity: str) -> float:
    """+1 for dark and -1 for bright markers."""
    if polarity not in POLARITIES:
        raise UsageError(f"polarity must be one of {', '.join(POLARITIES)}, got {polarity!r}")
    return 1.0 if polarity == "dark" else -1.0


def check_image(image: ArrayLike) -> NDArray[np.generic]:
    """The image as a 2-D array of real numbers, or a ValueError that says what is wrong."""
    a = np.asarray(image)
    if a.dtype == np.bool_:
        a = a.view(np.uint8)
    if isinstance(image, str | PathLike):
        raise UsageError(f"image must be an array, got the path {image}: windmark.read_image reads it")
    if a.dtype.kind not in "iuf":
        raise UsageError(f"image must have a real number type (integers or floats), got {a.dtype}")
    if a.ndim == 3:
        raise UsageError(f"image must be (H, W), one grey level per pixel; got shape {a.shape}: reduce colour to grey")
    if a.ndim != 2 or a.size == 0:
        raise UsageError(f"image must be (H, W) with at least one pixel, got shape {a.shape}")
    return a


def check_mask(mask: ArrayLike | None, shape: tuple[int, ...]) -> NDArray[np.bool_] | None:
    """The pixels to be used as (H, W) booleans, or None for all of them."""
    if mask is None:
        return None
    use = np.asarray(mask)
    if use.dtype.kind not in "biuf" or use.shape != shape:
        raise ValueError(f"mask must be true or false for each pixel of the image {shape}, got {use.dtype} {use.shape}")
    return use if use.dtype == np.bool_ else use != 0


def prepare(image: NDArray[np.generic], sign: float, mask: ArrayLike | None = None) -> Prepared | None:
    """Prepare a checked image; None where no pixel is finite or all are equal (nothing can be found there).

    Pixels outside the mask become NaN, and so do dead ones: single pixels far above or below all their neighbours.
    """
    use = check_mask(mask, image.shape)
    sample = usable_sample(image, use)
    if sample.size == 0:
        return None
    levels = levels_of(image, sign, use, sample)
    g, missing = grey_rows(image, use, levels, 0, len(image))
    quantum = levels.step
    if quantum == 0.0 or not np.ptp(sample) > 0.0:
        low, high = float(np.fmin.reduce(g, axis=None)), float(np.fmax.reduce(g, axis=None))
        if not high > low:
            return None
        quantum = quantum or (high - low) * 2.0**-16
    return Prepared(g, missing, sign, quantum, full_scale(image) - levels.offset)


def usable_sample(image: NDArray[np.generic], use: NDArray[np.bool_] | None) -> NDArray[np.float64]:
    """Finite pixels on a coarse lattice, all if there are none of them on it."""
    step = max(1, int(np.sqrt(image.size / SAMPLE)))
    for s in (step, 1):
        part = image[::s, ::s]
        values = (part if use is None else part[use[::s, ::s]]).astype(np.float64).ravel()
        values = values[np.isfinite(values)]
        if values.size:
            break
    return values


def levels_of(
    image: NDArray[np.generic], sign: float, use: NDArray[np.bool_] | None, sample: NDArray[np.float64]
) -> Levels:
    """The levels of an image, given its `usable_sample`."""
    offset, step = float(np.median(sample)), _step(sample)
    every = max(1, image.size // SAMPLE)
    rows, _ = shifted(image[::every], None if use is None else use[::every], sign, offset)
    return Levels(sign, offset, step, max(DEAD_NOISE * _noise(rows), 3.0 * step))


def grey_rows(
    image: NDArray[np.generic], use: NDArray[np.bool_] | None, levels: Levels, first: int, last: int
) -> tuple[Pixels, bool]:
    """Rows first ... last - 1 as the detector wants them, NaN where missing or dead, and whether there is such a pixel.

    What a row gives does not depend on which rows are asked for.
    """
    from windmark.detection._kernels.dead import dead_pixels

    top, bottom = max(first - 1, 0), min(last + 1, len(image))
    part = None if use is None else use[top:bottom]
    g, missing = shifted(image[top:bottom], part, levels.sign, levels.offset)
    dead = dead_pixels(g, levels.dead, DEAD_RATIO, 0.0, 0.0)
    g[dead[:, 0], dead[:, 1]] = np.nan
    return g[first - top : last - top], missing or bool(len(dead))


def shifted(
    image: NDArray[np.generic], use: NDArray[np.bool_] | None, sign: float, offset: float
) -> tuple[Pixels, bool]:
    """The image as float32 sign * (image - offset), NaN where not finite or not used, and whether there is a NaN."""
    g, missing = np.empty(image.shape, np.float32), False
    wide = image.dtype.itemsize > 2 and image.dtype != np.float32
    for y in range(0, len(g), BLOCK_ROWS):
        out, part = g[y : y + BLOCK_ROWS], image[y : y + BLOCK_ROWS]
        with np.errstate(over="ignore", invalid="ignore"):
            if wide:
                np.subtract(part, offset, out=out, dtype=np.float64, casting="unsafe")
            else:
                out[...] = part
                out -= np.float32(offset)
            if sign < 0:
                np.negative(out, out=out)
            if image.dtype.kind == "f" and not np.isfinite(out.min() + out.max()):
                out[~np.isfinite(out)] = np.nan
                missing = True
        if use is not None and not use[y : y + BLOCK_ROWS].all():
            out[~use[y : y + BLOCK_ROWS]] = np.nan
            missing = True
    return g, missing


def _noise(rows: Pixels) -> float:
    """Scatter of neighbouring pixels of a row about their trend: the median, which markers do not reach."""
    bend = np.abs(rows[:, :-2] - 2.0 * rows[:, 1:-1] + rows[:, 2:])
    bend = bend[np.isfinite(bend)]
    return float(np.median(bend)) / (0.6745 * np.sqrt(6.0)) if bend.size else 0.0


def _step(sample: NDArray[np.float64]) -> float:
    """Step between grey levels, 0 if there is none: integers come in steps of 16 or 257, floats may hold integers."""
    if (sample == np.round(sample)).all() and np.ptp(sample) < 2**53:
        step = int(np.gcd.reduce((sample - sample[0]).astype(np.int64)))
        return float(step) if step > 0 else 1.0
    return 0.0
