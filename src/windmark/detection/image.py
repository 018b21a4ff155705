"""An image as the detector wants it: float32, markers dark, zero near the median, dead pixels NaN."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

POLARITIES = ("dark", "bright")
DEAD_NOISE = 10.0  # a dead pixel leaves the range of its neighbours by so many times the noise
DEAD_RATIO = 5.0  # and by so many times that range: the smallest disc, blurred by 0.4 px, does so 2.8 times
Pixels = NDArray[np.float32]


@dataclass(frozen=True)
class Prepared:
    """A prepared image.

    Parameters
    ----------
    g : (H, W) float32, sign * (image - offset); NaN where the image is not finite
    filled : (H, W) float32, `g` with the NaN pixels interpolated along their row (the same array if there are none)
    sign : 1 for dark markers, -1 for bright ones
    quantum : smallest step between grey levels; for images without steps 2^-16 of their range
    clip : saturation level in units of sign * g (inf where it is not known: floating-point images)
    """

    g: Pixels
    filled: Pixels
    sign: float
    quantum: float
    clip: float


def check_polarity(polarity: str) -> float:
    """+1 for dark and -1 for bright markers."""
    if polarity not in POLARITIES:
        raise ValueError(f"polarity must be one of {', '.join(POLARITIES)}, got {polarity!r}")
    return 1.0 if polarity == "dark" else -1.0


def check_image(image: ArrayLike) -> NDArray[np.generic]:
    """The image as a 2-D array of real numbers, or a ValueError that says what is wrong."""
    a = np.asarray(image)
    if a.dtype == np.bool_:
        a = a.view(np.uint8)
    if a.dtype.kind not in "iuf":
        raise ValueError(f"image must have a real number type (integers or floats), got {a.dtype}")
    if a.ndim == 3:
        raise ValueError(f"image must be (H, W), one grey level per pixel; got shape {a.shape}: reduce colour to grey")
    if a.ndim != 2 or a.size == 0:
        raise ValueError(f"image must be (H, W) with at least one pixel, got shape {a.shape}")
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
    sample = _sample(image, use)
    if sample.size == 0:
        return None
    offset = float(np.median(sample))
    wide = image.dtype.itemsize > 2 and image.dtype != np.float32
    with np.errstate(over="ignore", invalid="ignore"):
        g = np.empty(image.shape, np.float32)
        np.subtract(image, offset, out=g, dtype=np.float64 if wide else np.float32, casting="unsafe")
    if sign < 0:
        np.negative(g, out=g)
    quantum = _quantum(sample)
    filled = g
    if _mark_missing(g, use, quantum):
        from windmark.detection._kernels_map import fill_rows

        filled = g.copy()
        fill_rows(filled)
    low, high = float(filled.min()), float(filled.max())
    if not high > low:
        return None
    return Prepared(g, filled, sign, quantum or (high - low) * 2.0**-16, _clip_level(image) - offset)


def _sample(image: NDArray[np.generic], use: NDArray[np.bool_] | None) -> NDArray[np.float64]:
    """Finite pixels on a coarse lattice, all if there are none of them on it."""
    step = max(1, int(np.sqrt(image.size / 60_000)))
    for s in (step, 1):
        part = image[::s, ::s]
        values = (part if use is None else part[use[::s, ::s]]).astype(np.float64).ravel()
        values = values[np.isfinite(values)]
        if values.size:
            break
    return values


def _mark_missing(g: Pixels, use: NDArray[np.bool_] | None, quantum: float) -> bool:
    """NaN where `g` is not finite, masked out or dead; whether there is such a pixel."""
    from windmark.detection._kernels_dead import dead_pixels

    missing = not np.isfinite(g.min() + g.max())
    if missing:
        g[~np.isfinite(g)] = np.nan
    if use is not None and not use.all():
        g[~use] = np.nan
        missing = True
    row, column = dead_pixels(g, max(DEAD_NOISE * _noise(g), 3.0 * quantum), DEAD_RATIO)
    g[row, column] = np.nan
    return bool(missing or len(row))


def _noise(g: Pixels) -> float:
    """Scatter of neighbouring pixels of a row about their trend: the median, which markers do not reach."""
    rows = g[:: max(1, g.shape[0] // 64)]
    bend = np.abs(rows[:, :-2] - 2.0 * rows[:, 1:-1] + rows[:, 2:])
    bend = bend[np.isfinite(bend)]
    return float(np.median(bend)) / (0.6745 * np.sqrt(6.0)) if bend.size else 0.0


def _quantum(sample: NDArray[np.float64]) -> float:
    """Step between grey levels, 0 if there is none: integers come in steps of 16 or 257, floats may hold integers."""
    if (sample == np.round(sample)).all() and np.ptp(sample) < 2**53:
        step = int(np.gcd.reduce((sample - sample[0]).astype(np.int64)))
        return float(step) if step > 0 else 1.0
    return 0.0


def _clip_level(image: NDArray[np.generic]) -> float:
    """Largest grey level of the sensor: of the type, or of 10, 12, 14 bits in a 16-bit file if the image ends there."""
    if image.dtype.kind == "f":
        return np.inf
    top = float(np.iinfo(image.dtype.name).max)
    if image.dtype.itemsize == 2:
        high = float(image.max())
        for bits in (10, 12, 14):
            for shift in (0, 16 - bits):
                if high == float(((1 << bits) - 1) << shift):
                    return high
    return top
