"""Photon transfer: grey levels per electron and the noise of reading, from pictures of one scene.

The difference of two frames of one scene holds noise alone, once their lamps are brought to one power. Its variance
grows with the light as gain * level + read variance (Janesick, Photon Transfer, 2007, ch. 5).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError, g3
from windmark.paint.refusal import NotFitted

Array = NDArray[np.float64]

BINS = 40
"""Groups of equally many pixels by their level."""
LEAST = 200
"""Pixels of a group that tell its variance within 10 %."""
UNSURE = 0.2
"""The levels do not spread where the gain's sigma is more than this part of it."""
MOST = 400_000
"""Pixels that are asked: twenty frames then tell the gain within 0.3 %, whatever a sensor's size."""
QUIET = 0.5
"""Part of photons' variance below which bright pixels are quieter than light is: half of it is left where the response
has seven tenths of its slope."""
CUT = 4.0
"""Differences beyond so many sigmas of their group are motion, dust and hot pixels, no noise."""


@dataclass(frozen=True, eq=False)
class PhotonTransfer:
    """Noise of a sensor: variance = gain * (level - dark) + read_variance, in grey levels.

    Parameters
    ----------
    gain : grey levels per electron; 1 / gain electrons make one level
    read_variance : in grey levels squared, rounding included; at least 1/12 for whole numbers
    cov : (2, 2) of gain and read variance
    levels, variances : (B,) level less dark and variance of each group of pixels
    flicker : (F,) the light of each frame relative to the mean
    misfit : root of the groups' mean squared misfit in sigmas; above 2 the noise is not that of photons alone
    intercept : the read variance as it comes out of the fit, which may be less than that of rounding, or than none
    """

    gain: float
    read_variance: float
    cov: Array
    levels: Array
    variances: Array
    flicker: Array
    misfit: float
    intercept: float = float("nan")

    def __bool__(self) -> bool:
        return True

    @property
    def sigma(self) -> tuple[float, float]:
        """Standard deviations of gain and read variance."""
        return float(np.sqrt(self.cov[0, 0])), float(np.sqrt(self.cov[1, 1]))


def photon_transfer(
    frames: ArrayLike, *, dark: ArrayLike = 0.0, saturation: float | None = None
) -> PhotonTransfer | NotFitted:
    """Gain and read noise from frames of one scene.

    Parameters
    ----------
    frames : (F, H, W) at least two of the same scene, unmoved; consecutive ones make the pairs
    dark : (H, W) or one number
    saturation : grey level from which pixels do not count

    Returns
    -------
    PhotonTransfer; or NotFitted where the levels do not spread enough to tell photons from reading (an even picture),
    too few pixels are left, or the noise does not grow with the light.

    Raises
    ------
    ValueError
        For another shape or fewer than two frames.

    Notes
    -----
    Frames of compressed video, or interpolated from a mosaic of colours, have correlated noise, and their gain is too
    small.

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> rng = np.random.default_rng(0)
    >>> electrons = np.tile(np.linspace(200.0, 8000.0, 200), (4, 100, 1))
    >>> frames = np.rint(0.5 * rng.poisson(electrons) + rng.normal(0.0, 2.0, electrons.shape)).astype(np.uint16)
    >>> sensor = wm.photon_transfer(frames)
    >>> round(sensor.gain, 2)  # grey levels per electron
    0.5
    """
    given = np.asarray(frames)
    if given.ndim != 3 or len(given) < 2:
        raise UsageError(f"photon_transfer: frames must be (F, H, W) with F at least 2, got {given.shape}")
    found = _noise_by_level(given, dark, saturation)
    if isinstance(found, NotFitted):
        return found
    least = 1 / 12 if given.dtype.kind in "biu" else 0.0
    return _fitted(*found, least)


@dataclass(frozen=True)
class SoftLimit:
    """Bright pixels of which the noise is far less than that of photons.

    Parameters
    ----------
    level : from which on, less dark
    part : of the noise's variance that is left at the brightest pixels
    """

    level: float
    part: float


def soft_limit(
    frames: ArrayLike, gain: float, read_variance: float, *, dark: ArrayLike = 0.0, limit: float = np.inf
) -> SoftLimit | None:
    """Where a camera's response bends towards its limit: noise falls with the slope of the response, light does not.

    What moves between frames adds to the noise, so that nothing is found that is not there.

    Parameters
    ----------
    frames : (F, H, W) at least two of about the same scene, NaN where a pixel does not count
    gain, read_variance : of the camera, see `photon_transfer`
    dark : (H, W) or one number
    limit : grey level at which pixels are clipped, and known to be: those within their noise of it are not asked

    Returns
    -------
    SoftLimit where the brightest of `BINS` groups of pixels have less than `QUIET` of photons' noise, by more than
    chance, and those of middle levels have all of it; else None.
    """
    given = np.asarray(frames, dtype=float)
    if not gain > 0 or len(given) < 2:
        return None
    light = given.mean(axis=0) - dark
    near = given.max(axis=0) + CUT * np.sqrt(gain * np.maximum(light, 0.0) + read_variance) >= limit
    found = _noise_by_level(np.where(near, np.nan, given), dark, None)
    if isinstance(found, NotFitted):
        return None
    levels, variances, number, _ = found
    part = variances / (gain * np.maximum(levels, 0.0) + read_variance)
    usual = min(float(np.median(part)), 1.0)
    sure = QUIET * usual * (1 - CUT * np.sqrt(3 / number))
    quiet = part < sure
    if not quiet[-1:].any() or quiet.mean() > 0.5:
        return None
    first = len(quiet) - int(np.argmin(np.append(quiet[::-1], False)))
    return SoftLimit(float(levels[first]), float(part[-1] / usual))


def _noise_by_level(
    given: NDArray[np.generic], dark: ArrayLike, saturation: float | None
) -> tuple[Array, Array, Array, Array] | NotFitted:
    """Level, variance and number of differences of each group of pixels, and (F,) the light of each frame."""
    black = np.broadcast_to(np.asarray(dark, dtype=float), given.shape[1:])
    good = np.isfinite(black)
    for frame in given:
        good &= np.isfinite(frame) if saturation is None else np.isfinite(frame) & (frame < saturation)
    asked = _drawn(np.flatnonzero(good))
    if len(asked) < 2 * LEAST:
        return NotFitted(f"photon_transfer: {len(asked)} pixels count in all frames; {2 * LEAST} are needed")
    stack = given.reshape(len(given), -1)[:, asked].astype(float) - black.ravel()[asked]
    level = stack.mean(axis=0)
    order = np.argsort(level, kind="stable")
    stack, level = stack[:, order], level[order]
    light = _flicker(stack, level)
    edges = np.unique(np.quantile(level, np.linspace(0, 1, min(BINS, len(level) // LEAST) + 1)))
    if len(edges) < 3:
        return NotFitted("photon_transfer: the picture has one level everywhere: its gain cannot be told")
    return (*_groups(stack, light, level, np.searchsorted(level, edges[:-1])), light)


def _drawn(pixels: NDArray[np.int64]) -> NDArray[np.int64]:
    """At most `MOST` of them, drawn with a fixed seed: a stride would meet a sensor's even columns alone."""
    if len(pixels) <= MOST:
        return pixels
    return np.sort(np.random.default_rng(0).choice(pixels, MOST, replace=False))


def _flicker(stack: Array, level: Array) -> Array:
    """(F,) light of each frame over the mean, by the brighter half of the pixels."""
    bright = level > np.median(level)
    if not bright.any() or not level[bright].mean() > 0:
        return np.ones(len(stack))
    relative = stack[:, bright].mean(axis=1) / level[bright].mean()
    return np.asarray(np.where(relative > 0.1, relative, 1.0))


def _groups(stack: Array, light: Array, level: Array, start: NDArray[np.int64]) -> tuple[Array, Array, Array]:
    """Level, variance at unit light, and number of differences of each group, all pairs together.

    Pixels are in the order of their level, group g begins at ``start[g]``.
    """
    squares, number = np.zeros(len(start)), np.zeros(len(start))
    for a, b in pairwise(range(len(stack))):
        # At the mean's light: what the lamp did is gone, noise is scaled by little.
        d = (stack[a] / light[a] - stack[b] / light[b]) / np.sqrt(1 / light[a] + 1 / light[b])
        for g, part in enumerate(np.split(d, start[1:])):
            off = part - np.median(part)
            # Of whole numbers half of the differences may be nought.
            inside = off[np.abs(off) <= CUT * max(float(np.median(np.abs(off))) / 0.6745, 0.3 * float(off.std()))]
            squares[g] += float((inside**2).sum())
            number[g] += len(inside)
    middle = np.add.reduceat(level, start) / np.diff(np.append(start, len(level)))
    keep = number >= LEAST
    return middle[keep], squares[keep] / np.maximum(number[keep] - 1, 1), number[keep]


def _fitted(levels: Array, variances: Array, number: Array, light: Array, least: float) -> PhotonTransfer | NotFitted:
    """The line through the groups' variances, each as sure as it has pixels."""
    if len(levels) < 3:
        return NotFitted(f"photon_transfer: {len(levels)} groups of levels; 3 are needed to tell gain and reading")
    design = np.stack([levels, np.ones(len(levels))], axis=1)
    model = np.maximum(variances, 1e-12)
    for _ in range(20):
        # Consecutive pairs share frames: each frame is in two differences, which costs half of the extra pairs.
        pairs = max(len(light) - 1, 1)
        sigma = model * np.sqrt(2 / number * (1.0 if pairs == 1 else 1.5))
        weighted = design / sigma[:, None]
        inverse = np.linalg.pinv(weighted.T @ weighted, hermitian=True)
        line = inverse @ weighted.T @ (variances / sigma)
        model = np.maximum(design @ line, 0.05 * np.median(variances))
    misfit = float(np.sqrt(np.mean(((variances - design @ line) / sigma) ** 2) * len(levels) / (len(levels) - 2)))
    cov = inverse * max(misfit, 1.0) ** 2
    gain, read = float(line[0]), float(line[1])
    unsure = float(np.sqrt(cov[0, 0]))
    if gain <= 0 and gain < -2 * unsure:
        return NotFitted("photon_transfer: the noise falls with the light: not frames of one scene, or saturated ones",
                         {"gain": gain, "sigma": unsure})  # fmt: skip
    if not gain > 0 or unsure > UNSURE * gain:
        return NotFitted(
            "photon_transfer: the picture's levels do not spread enough to tell photons from reading "
            f"({levels.min():.4g} to {levels.max():.4g}): gain {g3(gain)} +- {g3(unsure)}",
            {"gain": gain, "sigma": unsure},
        )
    return PhotonTransfer(gain, max(read, least), np.asarray(cov), levels, variances, light, misfit, read)
