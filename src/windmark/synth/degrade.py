"""What a real lens and sensor do to a perfect image. Each effect is one function; random ones take a generator.

Blurs, shading and clutter work on any intensity. `noise`, `defects` and `quantise` want the fraction
of full scale (1 = saturated). `Sensor.expose` does the whole chain.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError
from windmark.synth.marks import Clutter, draw, scatter

Array = NDArray[np.float64]
Rng = np.random.Generator

# --- lens and motion --------------------------------------------------------------------------


def gaussian_blur(image: ArrayLike, sigma_px: float) -> Array:
    """Blur by a Gaussian; the border is mirrored, so the mean is kept.

    The kernel is a sampled Gaussian whose discrete variance is exactly ``sigma_px``^2 (the plain
    samples are 1 % too narrow at 0.6 px and 30 % at 0.4), so widths and edges spread as they should.
    """
    from scipy.ndimage import correlate1d

    a = _image(image, "gaussian_blur")
    if not sigma_px >= 0:
        raise UsageError(f"gaussian_blur: sigma_px must be >= 0, got {sigma_px}")
    if sigma_px == 0:
        return a.copy()
    kernel = gaussian_kernel(sigma_px)
    return correlate1d(correlate1d(a, kernel, axis=0, mode="reflect"), kernel, axis=1, mode="reflect")


def gaussian_kernel(sigma_px: float) -> Array:
    """(2 h + 1,) positive, symmetric, sum 1, variance exactly ``sigma_px``^2."""
    from scipy.optimize import brentq

    k = np.arange(-int(np.ceil(6 * sigma_px + 2)), int(np.ceil(6 * sigma_px + 2)) + 1)

    def kernel(s: float) -> Array:
        w = np.exp(-0.5 * (k / s) ** 2)
        return w / w.sum()

    def excess(s: float) -> float:
        return float((kernel(s) * k * k).sum()) - sigma_px**2

    return kernel(brentq(excess, 0.03, sigma_px + 1, xtol=1e-14))


def average_blur(image: ArrayLike, passes: int) -> Array:
    """The paper's blur (AIAA 2005-5007, II.C): ``passes`` times the mean of 3 x 3 pixels, mirrored borders.

    One pass has a variance of 2/3 px^2 along each axis.
    """
    from scipy.ndimage import uniform_filter

    a = _image(image, "average_blur")
    if passes < 0:
        raise UsageError(f"average_blur: passes must be >= 0, got {passes}")
    out = a.copy()
    for _ in range(passes):
        out = uniform_filter(out, 3, mode="reflect")
    return out


def motion_blur(image: ArrayLike, shift_px: tuple[float, float]) -> Array:
    """Blur by a straight, even motion of ``shift_px`` = (dx, dy) during the exposure, centred on its middle.

    The mean of linearly interpolated shifts, at least four per pixel of motion; mirrored borders.
    """
    from scipy.ndimage import shift

    a = _image(image, "motion_blur")
    dx, dy = shift_px
    steps = max(2, int(np.ceil(4 * np.hypot(dx, dy))))
    if dx == 0 and dy == 0:
        return a.copy()
    fractions = (np.arange(steps) + 0.5) / steps - 0.5
    return np.mean([shift(a, (f * dy, f * dx), order=1, mode="reflect") for f in fractions], axis=0)


def vignette(image: ArrayLike, strength: float, center: tuple[float, float] | None = None) -> Array:
    """Darkening towards the corners, 1 - ``strength`` (r / half diagonal)^2, round ``center`` or the image's middle."""
    a = _image(image, "vignette")
    if not 0 <= strength <= 1:
        raise UsageError(f"vignette: strength must be in [0, 1], got {strength}")
    height, width = a.shape
    cx, cy = ((width - 1) / 2, (height - 1) / 2) if center is None else center
    square = (np.arange(width) - cx) ** 2 + (np.arange(height)[:, None] - cy) ** 2
    return a * np.maximum(1 - strength * square / (0.25 * (width**2 + height**2)), 0)


def clutter(
    image: ArrayLike,
    rng: Rng,
    what: Clutter | None = None,
    *,
    radius_px: float = 4.0,
    keep_clear: ArrayLike = (),
    clearance_px: float = 0.0,
) -> Array:
    """The image with specks, scratches, rings, lettering, tape and blocks drawn into it at random.

    Parameters
    ----------
    what : how many of each, `Clutter()` by default
    radius_px : radius of a marker, to which all sizes are relative
    keep_clear, clearance_px : points (N, 2) to which nothing comes nearer than the clearance
    """
    a = _image(image, "clutter")
    items = (Clutter() if what is None else what).items(rng, radius_px)
    size = (a.shape[1], a.shape[0])
    return draw(a, scatter(items, size, rng, keep_clear=keep_clear, clearance_px=clearance_px))


# --- sensor -----------------------------------------------------------------------------------


def noise(image: ArrayLike, rng: Rng, *, full_well_e: float = 20_000.0, read_noise_e: float = 8.0) -> Array:
    """Shot and read noise on an image in fractions of full scale.

    A pixel of level L collects Poisson(L full_well_e) electrons and is read with a Gaussian error of
    ``read_noise_e`` electrons. SNR at mid level is about sqrt(full_well_e / 2).
    """
    a = _image(image, "noise")
    if full_well_e <= 0 or read_noise_e < 0:
        raise UsageError(f"noise: need full_well_e > 0 and read_noise_e >= 0, got {full_well_e} and {read_noise_e}")
    electrons = rng.poisson(np.maximum(a, 0) * full_well_e).astype(float)
    if read_noise_e:
        electrons += read_noise_e * rng.standard_normal(a.shape)
    return electrons / full_well_e


def defects(image: ArrayLike, rng: Rng, *, hot: int = 0, dead: int = 0) -> Array:
    """Hot pixels (at 70-100 % of full scale) and dead ones (at 0), all at different places."""
    a = _image(image, "defects").copy()
    if hot < 0 or dead < 0 or hot + dead > a.size:
        raise UsageError(f"defects: hot and dead must be >= 0 and fit the image, got {hot} and {dead}")
    where = rng.choice(a.size, hot + dead, replace=False)
    a.flat[where[:hot]] = np.maximum(a.flat[where[:hot]], rng.uniform(0.7, 1.0, hot))
    a.flat[where[hot:]] = 0.0
    return a


def quantise(image: ArrayLike, bits: int, black: int = 0) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """Grey levels of an image in fractions of full scale: uint8 up to 8 bits, uint16 up to 16.

    Level 0 is read as ``black``, 1 as 2^bits - 1; outside that it saturates.
    """
    a = _image(image, "quantise")
    top = 2**bits - 1
    if not (1 <= bits <= 16 and 0 <= black < top):
        raise UsageError(f"quantise: need 1 <= bits <= 16 and 0 <= black < 2^bits - 1, got {bits} and {black}")
    levels = np.clip(np.rint(black + a * (top - black)), 0, top)
    return levels.astype(np.uint8) if bits <= 8 else levels.astype(np.uint16)


@dataclass(frozen=True)
class Sensor:
    """A camera's weaknesses, in the order of the light's way.

    Parameters
    ----------
    exposure : fraction of full scale that intensity 1 gives
    blur_px : standard deviation of the lens's blur
    vignetting : loss of light in the corners
    full_well_e, read_noise_e : see `noise`; full_well_e = inf for no noise at all
    hot, dead : numbers of defective pixels
    bits, black : see `quantise`
    """

    exposure: float = 0.55
    blur_px: float = 0.6
    vignetting: float = 0.15
    full_well_e: float = 20_000.0
    read_noise_e: float = 8.0
    hot: int = 12
    dead: int = 8
    bits: int = 12
    black: int = 64

    def expose(
        self, intensity: ArrayLike, rng: Rng, defects_rng: Rng | None = None
    ) -> NDArray[np.uint8] | NDArray[np.uint16]:
        """The image of a perfect intensity. A camera's defects stay where they are: same ``defects_rng`` state.

        The blur mirrors what is inside at the border, which moves the centres of discs that it cuts by up to 0.1 px.
        """
        a = vignette(gaussian_blur(intensity, self.blur_px), self.vignetting) * self.exposure
        if np.isfinite(self.full_well_e):
            a = noise(a, rng, full_well_e=self.full_well_e, read_noise_e=self.read_noise_e)
        if self.hot or self.dead:
            a = defects(a, rng if defects_rng is None else defects_rng, hot=self.hot, dead=self.dead)
        return quantise(a, self.bits, self.black)


def _image(values: ArrayLike, name: str) -> Array:
    a = np.asarray(values, dtype=float)
    if a.ndim != 2:
        raise ValueError(f"{name}: image must be (H, W), got {a.shape}")
    return a
