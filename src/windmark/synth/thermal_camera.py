"""An infrared camera: unequal pixels, noise, and counts or hundredths of a kelvin as its numbers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Picture = NDArray[np.uint16]

BAND_um = (8.0, 12.0)
KELVIN_PER_COUNT = 0.01
EVEN_K = (290.0, 322.0)
"""Black bodies that fill the view, from which pixels are made equal."""
_C1, _C2 = 1.191042972e8, 1.438776877e4  # W um^4 / (m2 sr), um K


def band_radiance(temperature: ArrayLike) -> Array:
    """Black body at temperatures (...) in K, W / (m2 sr) in the band: Planck's law by Simpson's rule, tabulated."""
    return np.asarray(np.interp(np.asarray(temperature, dtype=float), *_table()))


@cache
def _table() -> tuple[Array, Array]:
    """Temperatures and their radiance; made when it is asked for, as it takes a quarter of a second."""
    kelvin = np.linspace(200.0, 500.0, 60_001)
    um, weight = np.linspace(*BAND_um, 401), np.full(401, 2.0)
    weight[1::2], weight[[0, -1]] = 4.0, 1.0  # Simpson's
    total = np.zeros(len(kelvin))
    for length, part in zip(um.tolist(), (weight * (um[1] - um[0]) / 3).tolist(), strict=True):
        total += part * _C1 / length**5 / np.expm1(_C2 / (length * kelvin))
    return kelvin, total


@cache
def _near_300() -> float:
    """Radiance of a kelvin at 300 K."""
    return float(band_radiance(300.5) - band_radiance(299.5))


@dataclass(frozen=True)
class ThermalCamera:
    """One camera.

    Parameters
    ----------
    kind : "temperature" (its numbers are that of a black body, `KELVIN_PER_COUNT` each) or "counts"
    offset, gain : (H, W) each pixel's own: it says gain * light + offset, in W / (m2 sr)
    netd : noise of a pixel, W / (m2 sr)
    counts : level without light, and counts for 1 W / (m2 sr)
    blur_px : of the lens
    """

    kind: str
    offset: Array
    gain: Array
    netd: float
    counts: tuple[float, float] = (3100.0, 210.0)
    blur_px: float = 0.7

    @staticmethod
    def random(
        rng: np.random.Generator, size_px: tuple[int, int], kind: str, netd_K: float, unequal_K: float
    ) -> ThermalCamera:
        """Pixels as unequal as ``unequal_K`` at 300 K, in columns as much as alone; half a percent in their gain."""
        shape = size_px[::-1]
        uneven = rng.standard_normal(shape) + rng.standard_normal((1, shape[1]))
        offset = unequal_K * _near_300() * uneven / np.sqrt(2)
        return ThermalCamera(kind, offset, 1 + 0.005 * rng.standard_normal(shape), netd_K * _near_300())

    def expose(self, light: ArrayLike, rng: np.random.Generator) -> Picture:
        """The picture of light (H, W), W / (m2 sr)."""
        noise = self.netd * rng.standard_normal(self.gain.shape)
        return self._numbers(self.gain * np.asarray(light, dtype=float) + self.offset + noise)

    def even(self, temperature: float, rng: np.random.Generator) -> Picture:
        """A picture of a black body that fills the view."""
        return self.expose(np.full(self.gain.shape, float(band_radiance(temperature))), rng)

    def calibration(self, temperatures: ArrayLike, rng: np.random.Generator) -> Iterator[tuple[float, float, float]]:
        """Kelvin, mean count of the view and its sigma, of black bodies that are 0.02 K off what is said of them."""
        for t in np.asarray(temperatures, dtype=float):
            true = float(band_radiance(t + 0.02 * rng.standard_normal()))
            yield float(t), self.counts[0] + self.counts[1] * true, 0.02 * _near_300() * self.counts[1]

    def _numbers(self, light: Array) -> Picture:
        if self.kind == "counts":
            levels = self.counts[0] + self.counts[1] * light
        else:
            levels = np.interp(light, *_table()[::-1]) / KELVIN_PER_COUNT
        return np.clip(np.rint(levels), 0, 16383 if self.kind == "counts" else 65535).astype(np.uint16)
