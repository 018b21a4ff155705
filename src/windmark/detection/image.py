"""An image as the detector wants it: float32, markers dark, zero near the median, dead pixels NaN."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

POLARITIES = ("dark", "bright")
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


def prepare(image: NDArray[np.generic], sign: float) -> Prepared | None:
    """Prepare a checked image; None where no pixel is finite or all are equal (nothing can be found there)."""
    step = max(1, int(np.sqrt(image.size / 60_000)))
    sample = image[::step, ::step].astype(np.float64).ravel()
    sample = sample[np.isfinite(sample)]
    if sample.size == 0:
        sample = image[np.isfinite(image)].astype(np.float64)
        if sample.size == 0:
            return None
    offset = float(np.median(sample))
    wide = image.dtype.itemsize > 2 and image.dtype != np.float32
    with np.errstate(over="ignore", invalid="ignore"):
        g = np.empty(image.shape, np.float32)
        np.subtract(image, offset, out=g, dtype=np.float64 if wide else np.float32, casting="unsafe")
    if sign < 0:
        np.negative(g, out=g)
    filled = g
    if image.dtype.kind == "f" and not np.isfinite(g.min() + g.max()):
        from windmark.detection._kernels_map import fill_rows

        g[~np.isfinite(g)] = np.nan
        filled = g.copy()
        fill_rows(filled)
    low, high = float(filled.min()), float(filled.max())
    if not high > low:
        return None
    return Prepared(g, filled, sign, _quantum(sample, high - low), _clip_level(image) - offset)


def _quantum(sample: NDArray[np.float64], span: float) -> float:
    """Step between grey levels: integers may come in steps of 16 or 257, floats may hold integers."""
    if (sample == np.round(sample)).all() and span < 2**53:
        step = int(np.gcd.reduce((sample - sample[0]).astype(np.int64)))
        return float(step) if step > 0 else 1.0
    return span * 2.0**-16


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
