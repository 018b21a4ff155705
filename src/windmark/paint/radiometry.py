"""Grey levels to light: dark, linearity and flat taken off, a variance and a flag for every pixel.

light = linearity(level - dark) / flat. Its variance is that of the photons and of reading, gain * (level - dark) +
read_variance (Janesick, Photon Transfer, 2007, eq. 4.15), and those of the dark and flat pictures, through the slope of
the linearity.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import DataError, UsageError, g3
from windmark.geometry.described import described
from windmark.scene.levels import saturation_level
from windmark.scene.shown import ARRAY, check_kinds

Array = NDArray[np.float64]
Flags = NDArray[np.uint8]

SATURATED, DEAD, DARKER, NOT_FINITE, NO_FLAT, NOT_LINEARISED = 1, 2, 4, 8, 16, 32
PIXEL_FLAGS = {
    SATURATED: "saturated",
    DEAD: "dead or hot",
    DARKER: "darker than the dark picture by more than noise",
    NOT_FINITE: "no number",
    NO_FLAT: "the flat picture shows no light",
    NOT_LINEARISED: "beyond the range of the linearity",
}
"""Bits of a pixel's flag, in words."""
NOISY = 5.0
"""Sigmas by which a pixel must be below the dark picture before that is no noise."""
MOST_DARKER = 0.1
"""Part of the pixels that may be below the dark picture: more is the dark picture of another exposure."""
HOT = 8.0
"""Robust sigmas from all others by which a pixel of the dark or flat picture is dead or hot."""


@dataclass(frozen=True, eq=False)
class Linearity:
    """What a sensor's level less dark stands for in light, a rising function.

    Parameters
    ----------
    level, light : (N,) rising; straight between. `polynomial` makes a fine table of one
    """

    level: Array
    light: Array

    def __post_init__(self) -> None:
        a, b = np.asarray(self.level, dtype=float), np.asarray(self.light, dtype=float)
        if a.ndim != 1 or a.shape != b.shape or len(a) < 2 or not (np.isfinite(a).all() and np.isfinite(b).all()):
            raise ValueError(f"Linearity: level and light must be (N,) finite numbers, N > 1, got {a.shape}, {b.shape}")
        if not ((np.diff(a) > 0).all() and (np.diff(b) > 0).all()):
            raise UsageError("Linearity: level and light must both rise all the way")
        object.__setattr__(self, "level", a)
        object.__setattr__(self, "light", b)

    @staticmethod
    def polynomial(coefficients: ArrayLike, top: float, *, points: int = 4097) -> Linearity:
        """Light = sum of coefficients_k level^k, for levels (less dark) from -5 % of ``top`` to ``top``."""
        c = np.asarray(coefficients, dtype=float)
        level = np.linspace(-0.05 * top, top, points)
        return Linearity(level, np.polynomial.polynomial.polyval(level, c))

    def apply(self, level: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Light, its slope by the level, and where the level is outside of the table (NaN there)."""
        at = np.clip(np.searchsorted(self.level, level, side="right") - 1, 0, len(self.level) - 2)
        slope = np.diff(self.light)[at] / np.diff(self.level)[at]
        outside = ~((level >= self.level[0]) & (level <= self.level[-1]))
        light = self.light[at] + slope * (level - self.level[at])
        return np.where(outside, np.nan, light), slope, outside


@described(lambda m: {
    "gain": f"{m.gain:.4g}", "saturation": f"{m.saturation:g}", "read sigma": g3(m.read_variance**0.5),
    "flat": "even" if m.flat is None else "yes", "dead pixels": 0 if m.dead is None else int(m.dead.sum()),
})  # fmt: skip
@dataclass(frozen=True, eq=False)
class SensorModel:
    """A camera's sensor.

    Parameters
    ----------
    dark : (H, W) or one number, grey level without light at the pictures' exposure
    saturation : grey level from which a pixel is saturated
    gain : grey levels per electron (`photon_transfer`); 0: no photon noise
    read_variance : of reading one pixel, in grey levels squared; rounding (1/12) included
    dark_variance, flat_variance : (H, W) or one number, of the dark and the flat picture themselves
    flat : (H, W) relative sensitivity, None for an even one
    linearity : of the sensor, None for a linear one
    dead : (H, W) bool, pixels that do not count

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> sensor = wm.SensorModel(dark=100.0, saturation=4000.0, gain=0.5, read_variance=4.0)
    >>> light = wm.correct_picture(np.full((2, 3), 1100, dtype=np.uint16), sensor)
    >>> light.value[0].tolist()
    [1000.0, 1000.0, 1000.0]
    >>> light.variance[0].tolist()  # gain * light + read_variance
    [504.0, 504.0, 504.0]
    """

    dark: Array | float
    saturation: float
    gain: float
    read_variance: float
    dark_variance: Array | float = 0.0
    flat: Array | None = None
    flat_variance: Array | float = 0.0
    linearity: Linearity | None = None
    dead: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        if not (self.gain >= 0 and self.read_variance >= 0 and self.saturation > 0):
            raise UsageError(
                "SensorModel: gain and read_variance must be at least 0, saturation above 0, got "
                f"{self.gain}, {self.read_variance}, {self.saturation}"
            )


@dataclass(frozen=True, eq=False)
class Intensity:
    """Light on each pixel.

    Parameters
    ----------
    value : (H, W) in grey levels of the linear sensor at the flat's mean; NaN where flagged as no number
    variance : (H, W)
    flags : (H, W) uint8, sums of `PIXEL_FLAGS`
    lasting : (H, W) part of the variance that is the dark and the flat picture's: the same error in every picture of
        the camera, which no mean of them makes smaller
    """

    value: Array
    variance: Array
    flags: Flags
    lasting: Array

    @property
    def usable(self) -> NDArray[np.bool_]:
        """(H, W) pixels without any flag."""
        return np.asarray(self.flags == 0)

    def share(self, flag: int) -> float:
        """Part of the pixels that have a flag."""
        return float(np.mean((self.flags & flag) > 0))


def correct_picture(picture: ArrayLike, sensor: SensorModel, *, most_saturated: float = 0.25) -> Intensity:
    """Light on each pixel of one picture.

    Parameters
    ----------
    picture : (H, W) grey levels, as read
    sensor : the camera
    most_saturated : part of the pixels that may be saturated

    Raises
    ------
    DataError
        Where the dark picture is brighter than the picture, the picture shows no light, or more than ``most_saturated``
        of it is saturated.
    ValueError
        For pictures of another size.

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> sensor = wm.SensorModel(dark=100.0, saturation=4000.0, gain=0.5, read_variance=4.0)
    >>> light = wm.correct_picture(np.array([[1100, 2100, 3100, 2600, 4095]], dtype=np.uint16), sensor)
    >>> light.value[0].tolist(), light.flags[0].tolist()  # the last pixel is saturated
    ([1000.0, 2000.0, 3000.0, 2500.0, 3995.0], [0, 0, 0, 0, 1])
    """
    check_kinds("correct_picture", picture=(picture, ARRAY), sensor=(sensor, SensorModel))
    raw = np.asarray(picture, dtype=float)
    if raw.ndim != 2:
        raise ValueError(f"correct_picture: the picture must be (H, W), got {raw.shape}")
    for name, part in (("dark", sensor.dark), ("flat", sensor.flat), ("dead", sensor.dead),
                       ("dark_variance", sensor.dark_variance), ("flat_variance", sensor.flat_variance)):  # fmt: skip
        if part is not None and np.shape(part) not in ((), raw.shape):
            raise DataError(f"{name}: {_size(np.shape(part))}; expected {_size(raw.shape)} as the picture")
    flags = np.zeros(raw.shape, np.uint8)
    flags[~np.isfinite(raw)] |= NOT_FINITE
    flags[saturated_pixels(picture, sensor.saturation)] |= SATURATED
    if sensor.dead is not None:
        flags[sensor.dead] |= DEAD
    signal = raw - sensor.dark
    own = sensor.gain * np.maximum(signal, 0.0) + sensor.read_variance
    total = own + sensor.dark_variance
    below = signal < -NOISY * np.sqrt(total)
    flags[below] |= DARKER
    _refuse(raw, signal, total, flags, most_saturated)
    value, slope = signal, np.ones(raw.shape)
    if sensor.linearity is not None:
        value, slope, outside = sensor.linearity.apply(signal)
        flags[outside & np.isfinite(raw)] |= NOT_LINEARISED
    flat = np.ones(raw.shape) if sensor.flat is None else np.asarray(sensor.flat, dtype=float)
    lit = (flat > 0) & np.isfinite(flat)
    flags[~lit] |= NO_FLAT
    flat = np.where(lit, flat, np.nan)
    value = value / flat
    lasting = (slope**2 * sensor.dark_variance + value**2 * sensor.flat_variance) / flat**2
    variance = slope**2 * own / flat**2 + lasting
    # No number of the dark picture, or of what is known of its error: the picture itself may be fine there.
    flags[(flags == 0) & ~(np.isfinite(value) & np.isfinite(variance))] |= NOT_FINITE
    return Intensity(value, variance, flags, lasting)


def saturated_pixels(picture: ArrayLike, saturation: float) -> NDArray[np.bool_]:
    """(H, W) pixels of a picture as read that are saturated, or at a level where it is clipped below that; or full."""
    raw = np.asarray(picture)
    return np.asarray(raw >= min(saturation, saturation_level(raw)))


def _size(shape: tuple[int, ...]) -> str:
    return f"{shape[1]} x {shape[0]} pixels" if len(shape) == 2 else f"an array of {shape}"


def _refuse(raw: Array, signal: Array, variance: Array, flags: Flags, most_saturated: float) -> None:
    if not np.isfinite(signal).any():
        raise DataError("the picture, or the dark picture, has no pixel that is a number")
    share = float(np.mean((flags & DARKER) > 0))
    if share > MOST_DARKER:
        raise DataError(
            f"the dark picture is brighter than the picture on {100 * share:.0f} % of the pixels (medians "
            f"{np.nanmedian(raw - signal):.4g} and {np.nanmedian(raw):.4g}): of another exposure, or not dark"
        )
    full = float(np.mean((flags & SATURATED) > 0))
    if full > most_saturated:
        raise DataError(f"{100 * full:.0f} % of the picture is saturated; at most {100 * most_saturated:.0f} % may be")
    good = flags == 0
    if good.any() and full == 0 and float(np.quantile((signal / np.sqrt(variance + 1e-300))[good], 0.99)) < NOISY:
        raise DataError("the picture shows no light above the dark picture")


def mean_dark(frames: ArrayLike) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Dark picture of F frames (F, H, W): mean (H, W), its variance by the scatter, and dead or hot pixels.

    A pixel is hot or dead where its level or its scatter is more than `HOT` robust sigmas from all others'. One frame
    alone has the variance of all pixels together.
    """
    stack = np.asarray(frames)
    if stack.ndim != 3 or not len(stack):
        raise ValueError(f"mean_dark: frames must be (F, H, W), got {stack.shape}")
    mean = stack.mean(axis=0, dtype=float)
    if len(stack) > 1:
        own = np.zeros(mean.shape)
        for frame in stack:  # never all of them as floating point numbers
            own += (frame - mean) ** 2
        own /= len(stack) - 1
        # With few frames a pixel's own scatter says little: all pixels' scatter, and only hot ones their own.
        common = float(np.median(own)) * (len(stack) - 1) / _chi_median(len(stack) - 1)
        noisy = _apart(np.sqrt(own))
        variance = np.where(noisy, own, max(common, 1 / 12)) / len(stack)
    else:
        noisy = np.zeros(mean.shape, bool)
        variance = np.full(mean.shape, max(_robust_sigma(mean) ** 2, 1 / 12))
    return mean, variance, _apart(mean) | noisy | ~np.isfinite(mean)


def mean_flat(frames: ArrayLike, sensor: SensorModel) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Relative sensitivity (H, W) of F frames of an even field, of mean 1; its variance; pixels that do not count."""
    stack = np.asarray(frames)
    if stack.ndim != 3 or not len(stack):
        raise ValueError(f"mean_flat: frames must be (F, H, W), got {stack.shape}")
    value, variance, bad = np.zeros(stack.shape[1:]), np.zeros(stack.shape[1:]), np.zeros(stack.shape[1:], bool)
    for frame in stack:  # a hundred frames of 5 Mpx in full would be 12 GB
        light = correct_picture(frame, sensor)
        value += light.value
        variance += light.variance
        bad |= ~light.usable
    value /= len(stack)
    bad |= ~(value > 0)
    scale = float(np.mean(value[~bad])) if (~bad).any() else 0.0
    if not scale > 0:
        raise DataError("the flat pictures show no light")
    return value / scale, variance / (len(stack) ** 2 * scale**2), bad


def _robust_sigma(values: Array) -> float:
    v = values[np.isfinite(values)]
    return float(np.subtract(*np.quantile(v, [0.75, 0.25]))) / 1.349 if len(v) else 0.0


def _apart(values: Array) -> NDArray[np.bool_]:
    """Values that stand out of all others by more than `HOT` robust sigmas, and half a grey level."""
    middle = float(np.nanmedian(values))
    return np.asarray(np.abs(values - middle) > max(HOT * _robust_sigma(values), 0.5))


def _chi_median(dof: int) -> float:
    """Median of chi-square."""
    from scipy.special import chdtri

    return float(chdtri(dof, 0.5))
