"""What a sensor makes of a clean picture: noise of every kind, with the covariance that the right fit would weigh by.

Each `Sensor` turns noise-free grey levels into a picture that a file could hold, and says the covariance of a window's
pixels. JPEG has no covariance in closed form: second moments of its errors over random positions of the 8 x 8 blocks
are measured, as a fit sees them that takes the file's errors for noise (a fit that knew every quantised coefficient
could do better than this bound).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
BLOCK_PLACES, DRAWS = 49, 64  # of the measured second moments of a file's errors


@dataclass(frozen=True)
class Sensor:
    """Noise of one kind; levels are those of the clean picture.

    Parameters
    ----------
    white : standard deviation of a pixel's noise, grey levels
    electrons : collected at `level`; 0 for no photon noise
    level : grey level of the light
    texture, length : standard deviation of the paint's texture over the light, and of the filter that makes it (px)
    gamma : the file's grey levels are 255 (v / 255)^gamma of the light's
    quality : of a JPEG file, 0 for none
    bits : of the file, 0 for floating point
    """

    white: float = 0.0
    electrons: float = 0.0
    level: float = 180.0
    texture: float = 0.0
    length: float = 0.0
    gamma: float = 1.0
    quality: int = 0
    bits: int = 16

    def picture(self, clean: Array, rng: np.random.Generator) -> NDArray:
        """The file's grey levels; 16 bits hold 256 times the light's level, so that rounding adds nothing."""
        image = clean
        if self.texture > 0:
            image = image * (1 + self.texture * grain(clean.shape, self.length, rng))
        if self.electrons > 0:
            gain = self.electrons / self.level
            image = rng.poisson(np.maximum(image, 0) * gain) / gain
        image = image + rng.normal(0, self.white, image.shape) if self.white > 0 else image
        if self.gamma != 1.0:
            image = 255 * np.clip(image / 255, 0, None) ** self.gamma
        if self.bits == 16:
            return np.clip(np.rint(image * 256 / 2), 0, 65535).astype(np.uint16)
        byte = np.clip(np.rint(image), 0, 255).astype(np.uint8)
        if self.quality:
            ok, data = cv2.imencode(".jpg", byte, [cv2.IMWRITE_JPEG_QUALITY, self.quality])
            byte = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if ok else byte
        return byte

    def covariance(self, clean: Array, window: NDArray[np.bool_], rng: np.random.Generator) -> Array:
        """(P, P) of the P pixels of a window of a tile (S, S), in the clean picture's grey levels squared."""
        if self.quality:
            return self._measured(clean, window, rng)
        v = clean[window]
        variance = np.full(len(v), self.white**2)
        if self.electrons > 0:
            variance += np.maximum(v, 0) * self.level / self.electrons
        if self.bits == 8:
            slope = self.gamma * np.maximum(v / 255, 1e-3) ** (self.gamma - 1)  # of the file's level by the light's
            variance += 1 / 12 / slope**2
        out = np.diag(variance)
        if self.texture > 0:
            place = np.argwhere(window)
            gap2 = ((place[:, None] - place[None]) ** 2).sum(axis=2)
            out += self.texture**2 * np.outer(v, v) * np.exp(-gap2 / (4 * self.length**2))
        return out

    def _measured(self, clean: Array, window: NDArray[np.bool_], rng: np.random.Generator) -> Array:
        """Second moments of the file's errors about the clean picture, over positions of the blocks and draws."""
        pad = np.pad(clean, ((0, 8), (0, 8)), mode="edge")
        shifted = [np.roll(pad, (i, j), (0, 1)) for i in range(7) for j in range(7)]
        size, many = len(pad) + (-len(pad)) % 8, []
        sheet = np.zeros((BLOCK_PLACES * size, size))
        for k, one in enumerate(shifted):
            sheet[k * size : (k + 1) * size] = np.pad(one, (0, size - len(pad)), mode="edge")
        for _ in range(DRAWS):
            error = self.picture(sheet, rng) - sheet
            for k in range(BLOCK_PLACES):
                i, j = divmod(k, 7)
                many.append(error[k * size + i :, j:][: len(clean), : len(clean)][window])
        samples = np.array(many)
        n, p = samples.shape
        return samples.T @ samples / n * ((n - 1) / (n - p - 2))  # the inverse of a sample covariance is too large


def grain(shape: tuple[int, ...], length: float, rng: np.random.Generator) -> Array:
    """Gaussian noise of variance 1 with correlation exp(-d^2 / (4 length^2)), periodic."""
    v, u = np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1])[None]
    power = np.exp(-4 * np.pi**2 * length**2 * (u**2 + v**2)) * 4 * np.pi * length**2
    white = np.fft.rfft2(rng.normal(size=shape))
    return np.asarray(np.fft.irfft2(white * np.sqrt(power), s=shape))
