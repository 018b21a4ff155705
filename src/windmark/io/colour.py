"""Colour pictures and colour mosaics as one grey level per pixel, centres of markers kept in place."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError
from windmark.options.detection import BAYER, CHANNEL
from windmark.scene.levels import saturation_level

Image = NDArray[Any]
Mask = NDArray[np.bool_]

CHANNELS = CHANNEL.choices
MOSAICS = BAYER.choices
"""Bayer patterns: the first two letters are the colours of the first two pixels of the first row."""

RED, GREEN, BLUE = 0.299, 0.587, 0.114
"""Weights of `to_grey` (ITU-R BT.601, as OpenCV and Pillow have them)."""


APART = 4
"""Pixels of a grey picture made of a mosaic that are so far apart have no pixel of it in common, and are of the same
kind, measured or interpolated."""


def to_grey(image: ArrayLike, *, channel: str = CHANNEL.default) -> Image:
    """Grey levels of an image: (H, W).

    (H, W) is returned as it is. Of (H, W, 2) and (H, W, 4) the alpha is dropped. Colours become
    0.299 R + 0.587 G + 0.114 B (ITU-R BT.601, on the stored values), not rounded: float32, or float64 for 64-bit types;
    or one channel, in its own type.

    Raises
    ------
    ValueError
        For another shape, an unknown channel, or a colour channel of an image without colours.
    """
    values: Image = np.asarray(image)
    check_channel(channel)
    if values.ndim != 2 and (values.ndim != 3 or not 1 <= values.shape[2] <= 4):
        raise UsageError(f"to_grey: image must be (H, W) or (H, W, 1 to 4), got {values.shape}")
    if values.ndim == 2 or values.shape[2] < 3:
        if channel != "grey":
            raise UsageError(f"to_grey: channel must be grey, as the image has no colours, got {channel!r}")
        return values if values.ndim == 2 else np.ascontiguousarray(values[..., 0])
    if channel != "grey":
        return np.ascontiguousarray(values[..., CHANNELS.index(channel) - 1])
    kind = np.float64 if values.dtype.itemsize > 4 else np.float32
    red, green, blue = np.moveaxis(values[..., :3].astype(kind), -1, 0)
    return green + RED * (red - green) + BLUE * (blue - green)  # exact where red = green = blue


def from_mosaic(mosaic: ArrayLike, pattern: str, *, channel: str = CHANNEL.default) -> Image:
    """Grey levels of a colour sensor's raw picture (Bayer mosaic), at full size: (H, W) float32 or float64.

    Every pixel becomes the binomial mean (1 2 1) x (1 2 1) / 16 of its 3 x 3 neighbourhood. Wherever that lies, red has
    the weight 1/4, green 1/2 and blue 1/4, so the mosaic vanishes whatever the channels' gains and the light's colour;
    the kernel is symmetric, so centres stay in place. It widens the blur (0.7 px become 1.0) and correlates the noise
    of neighbours. One channel is bilinear interpolation between its own pixels, which stay as they are: `detect` knows
    such a picture and fits those alone (`detection.measured`).

    Parameters
    ----------
    mosaic : (H, W) as the sensor gave it, at least 2 x 2; a pixel that is not finite spoils its neighbours
    pattern : one of `MOSAICS`
    channel : "grey" for the sum of all, or one of "red", "green", "blue"

    Raises
    ------
    ValueError
        For a colour picture, an unknown pattern or channel.
    """
    values = np.asarray(mosaic)
    if values.ndim != 2 or min(values.shape) < 2:
        raise UsageError(f"from_mosaic: mosaic must be (H, W), at least 2 x 2, got {values.shape}")
    check_channel(channel)
    check_mosaic(pattern)
    values = values.astype(np.float64 if values.dtype.itemsize > 4 else np.float32)
    if channel == "grey":
        return _binomial(values)
    here = _of_colour(pattern, channel, values.shape)
    mean = _binomial(np.where(here, values, 0)) * 4.0
    # Green has two of four pixels: elsewhere the kernel sees four of them, half a weight; there it would smooth.
    return np.where(here, values, mean / here[:2, :2].sum())


def made_of_saturated(image: ArrayLike, channel: str = CHANNEL.default, bayer: str | None = None) -> Mask | None:
    """(H, W) pixels of `to_grey` or `from_mosaic` that were made of saturated ones; None where there is none such.

    Where one colour alone is saturated, the grey that it has a part in is below its own highest level. None, too, of
    pictures whose grey is as they were stored: `scene.levels` knows those by themselves.
    """
    raw = np.asarray(image)
    if bayer is None and (raw.ndim == 2 or raw.shape[2] < 3 or channel != "grey"):
        return None
    planes = [raw[..., k] for k in range(3)] if bayer is None else [raw]
    levels = [saturation_level(plane) for plane in planes]
    if bayer is not None and channel != "grey":
        colour = _of_colour(bayer, channel, raw.shape)
        levels[0] = min(levels[0], saturation_level(raw[colour]))
        planes[0] = np.where(colour, raw, 0)
    full = np.logical_or.reduce([np.asarray(p >= level) for p, level in zip(planes, levels, strict=True)])
    if not full.any():
        return None
    return full if bayer is None else _binomial(full.astype(np.float32)) > 0


def check_channel(channel: str) -> None:
    """ValueError for an unknown channel."""
    if channel not in CHANNELS:
        raise UsageError(f"channel must be one of {', '.join(CHANNELS)}, got {channel!r}")


def check_mosaic(pattern: str) -> None:
    """ValueError for an unknown pattern."""
    if pattern not in MOSAICS:
        raise UsageError(f"bayer must be one of {', '.join(MOSAICS)}, got {pattern!r}")


def _of_colour(pattern: str, channel: str, shape: tuple[int, ...]) -> Mask:
    """Where a mosaic has the pixels of a colour."""
    mine = np.array([letter == channel[0].upper() for letter in pattern]).reshape(2, 2)
    height, width = shape
    return np.tile(mine, (height // 2 + 1, width // 2 + 1))[:height, :width]


def _binomial(values: Image) -> Image:
    """Mean with the weights 1 2 1 along both axes; mirrored at the border pixels, which keeps the mosaic's order."""
    for axis in (0, 1):
        wide = np.pad(values, [(1, 1) if a == axis else (0, 0) for a in (0, 1)], mode="reflect")
        n = values.shape[axis]
        before, after = (np.take(wide, np.arange(k, k + n), axis) for k in (0, 2))
        values = 0.5 * values + 0.25 * (before + after)
    return values
