"""A camera for paint: pixels of unequal response, a dark pattern, photon noise of a known gain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.synth.degrade import Sensor, defects, gaussian_blur, noise, quantise, vignette

Array = NDArray[np.float64]
Picture = NDArray[np.uint8] | NDArray[np.uint16]
Rng = np.random.Generator

SENSOR = Sensor(exposure=0.33, blur_px=0.7, vignetting=0.2, full_well_e=30_000.0, read_noise_e=6.0, hot=8, dead=6,
                bits=14, black=200)  # fmt: skip


@dataclass(frozen=True)
class PaintCamera:
    """What one camera does to the light.

    Parameters
    ----------
    sensor : lens, noise and numbers; ``black`` is the least dark level
    response : (H, W) of each pixel, about 1
    dark : (H, W) what each pixel shows without light, part of full scale
    defects_seed : where hot and dead pixels are
    """

    sensor: Sensor
    response: Array
    dark: Array
    defects_seed: tuple[int, ...]

    @staticmethod
    def random(
        rng: Rng, size_px: tuple[int, int], defects_seed: tuple[int, ...], *, sensor: Sensor = SENSOR,
        unequal: float = 0.01, dark: float = 4e-4,
    ) -> PaintCamera:  # fmt: skip
        """Response and dark pattern: ``unequal`` and ``dark`` are standard deviations over the pixels."""
        shape = size_px[::-1]
        slope = np.linspace(0, 4 * dark, shape[0])[:, None]
        pattern = np.maximum(slope + dark * rng.standard_normal(shape) + 3 * dark, 0)
        return PaintCamera(sensor, 1 + unequal * rng.standard_normal(shape), pattern, defects_seed)

    @property
    def electrons_per_level(self) -> float:
        """The gain: photo-electrons of one grey level."""
        return self.sensor.full_well_e / (2.0**self.sensor.bits - 1 - self.sensor.black)

    def expose(self, intensity: ArrayLike, rng: Rng) -> Picture:
        """The picture of a perfect intensity (H, W)."""
        s = self.sensor
        light = vignette(gaussian_blur(intensity, s.blur_px), s.vignetting) * s.exposure * self.response
        return self._read(light, rng)

    def flat(self, rng: Rng, level: float = 0.85) -> Picture:
        """A picture of evenly lit white, whose middle is ``level`` of full scale."""
        even = vignette(np.full(self.response.shape, level), self.sensor.vignetting)
        return self._read(even * self.response, rng)

    def dark_picture(self, rng: Rng) -> Picture:
        """A picture with the lens closed."""
        return self._read(np.zeros(self.response.shape), rng)

    def _read(self, light: Array, rng: Rng) -> Picture:
        s = self.sensor
        seen = noise(light, rng, full_well_e=s.full_well_e, read_noise_e=s.read_noise_e) + self.dark
        seen = defects(seen, np.random.default_rng(self.defects_seed), hot=s.hot, dead=s.dead)
        return quantise(seen, s.bits, s.black)
