"""Analytic scenes drawn by supersampling: what the camera would see of discs, without noise, and its derivatives.

Shares nothing with windmark: the scene (ellipses with anti-aliased rims, a plane of light, shadow, line, dirt) is drawn
on a grid `FINE` times finer than the pixels; the optics (Gaussian, defocus disc, motion, the pixel's light-sensitive
square) are products of analytic transfer functions, and the pixels' centres are picked. The bound of a centre follows
from numerical derivatives of this picture by *every* number that the scene is made of, so that whatever disturbs a disc
counts as unknown.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import j1

Array = NDArray[np.float64]

FINE = 6  # sub-pixels along a pixel's side
PAD = 7  # px round a tile that the optics may bring in
STEP = 1e-2  # of the numerical derivatives: px, radians, shares; of the level 1e-3 of it, of its slope 1e-4 per px
DISC = ("x", "y", "sxx", "sxy", "syy", "contrast")
EXTRAS = {
    "touching": ("x2", "y2", "sxx2", "sxy2", "syy2", "contrast2"),
    "shadow": ("edge", "edge angle", "dimmed", "penumbra"),
    "line": ("line", "line angle", "half width", "opacity"),
    "scratch": ("line", "line angle", "half width", "opacity", "end"),
    "dirt": ("dirt x", "dirt y", "dirt radius", "opacity"),
    "fields": ("shift x", "shift y"),
}


@dataclass(frozen=True)
class Optics:
    """What blurs: a Gaussian (px), a defocus disc's radius, a motion's length and angle, the pixel's active side."""

    gauss: float = 0.6
    defocus: float = 0.0
    motion: float = 0.0
    motion_angle: float = 0.0
    active: float = 1.0

    @property
    def spread(self) -> float:
        """Standard deviation per axis of all that, without the pixel."""
        return float(np.sqrt(self.gauss**2 + self.defocus**2 / 4 + self.motion**2 / 12))

    def transfer(self, size: int) -> Array:
        """(size, size // 2 + 1) at the frequencies of a real FFT of the fine grid."""
        v, u = np.fft.fftfreq(size)[:, None] * FINE, np.fft.rfftfreq(size)[None] * FINE  # per px
        out = np.exp(-2 * (np.pi * self.gauss) ** 2 * (u**2 + v**2))
        out = out * np.sinc(self.active * u) * np.sinc(self.active * v)
        if self.defocus > 0:
            w = 2 * np.pi * self.defocus * np.hypot(u, v)
            out = out * np.where(w > 1e-9, 2 * j1(w) / np.maximum(w, 1e-9), 1.0)
        if self.motion > 0:
            out = out * np.sinc(self.motion * (u * np.cos(self.motion_angle) + v * np.sin(self.motion_angle)))
        return np.asarray(out)


@dataclass(frozen=True)
class Drawing:
    """One tile: names and values of everything in it, pixel (0, 0) in its middle; `disturbed` is one of `EXTRAS`."""

    size: int
    optics: Optics
    values: dict[str, float]
    disturbed: str = ""
    unknown_blur: str = "gauss"

    def unknowns(self) -> list[str]:
        """Every number that a fit of the right model would have to find; the centre first."""
        return [*DISC, "level", "slope x", "slope y", "blur", *EXTRAS.get(self.disturbed, ())]

    def draw(self) -> Array:
        """(size, size) grey levels."""
        if self.disturbed != "fields":
            return self._one(self.values)
        half = {k: 0.5 * self.values[f"shift {k}"] for k in "xy"}
        both = [
            self._one({**self.values, "x": self.values["x"] + s * half["x"], "y": self.values["y"] + s * half["y"]})
            for s in (1, -1)
        ]
        out = both[0].copy()
        out[1::2] = both[1][1::2]
        return out

    def _one(self, p: dict[str, float]) -> Array:
        wide = self.size + 2 * PAD
        place = (np.arange(wide * FINE) + 0.5) / FINE - 0.5 - PAD - self.size // 2
        x, y = place[None, :], place[:, None]
        picture = p["level"] * (1 + p["slope x"] * x + p["slope y"] * y)
        picture = picture * (1 - p["contrast"] * _ellipse(x, y, p, ""))
        if self.disturbed == "touching":
            picture *= 1 - p["contrast2"] * _ellipse(x, y, p, "2")
        elif self.disturbed == "shadow":
            away = (x * np.cos(p["edge angle"]) + y * np.sin(p["edge angle"]) - p["edge"]) / p["penumbra"]
            picture *= 1 - p["dimmed"] * np.clip(0.5 + away, 0.0, 1.0)
        elif self.disturbed in ("line", "scratch"):
            across = x * np.cos(p["line angle"]) + y * np.sin(p["line angle"]) - p["line"]
            cover = np.clip(0.5 + FINE * (p["half width"] - np.abs(across)), 0, 1)
            if self.disturbed == "scratch":
                along = y * np.cos(p["line angle"]) - x * np.sin(p["line angle"])
                cover = cover * np.clip(0.5 + FINE * (along - p["end"]), 0, 1)
            picture *= 1 - p["opacity"] * cover
        elif self.disturbed == "dirt":
            distance = np.hypot(x - p["dirt x"], y - p["dirt y"]) - p["dirt radius"]
            picture *= 1 - p["opacity"] * np.clip(0.5 - FINE * distance, 0, 1)
        optics = self.optics
        if "blur" in p:  # the numerical derivative by what blurs
            optics = replace(optics, **{self.unknown_blur: p["blur"]})
        # The mean is taken off so that the far sides of the periodic picture meet with a small step only.
        middle = picture.mean()
        seen = np.fft.irfft2(np.fft.rfft2(picture - middle) * optics.transfer(wide * FINE), s=picture.shape) + middle
        return _at_pixels(seen)[PAD:-PAD, PAD:-PAD]

    def derivatives(self) -> Array:
        """(U, size, size) by `unknowns`, central differences."""
        base = {**self.values, "blur": getattr(self.optics, self.unknown_blur)}
        rows = []
        for name in self.unknowns():
            step = 1e-3 * base["level"] if name == "level" else 1e-4 if name.startswith("slope") else STEP
            up, down = ({**base, name: base[name] + s} for s in (step, -step))
            more, less = (replace(self, values=v).draw() for v in (up, down))
            rows.append((more - less) / (2 * step))
        return np.array(rows)


def _ellipse(x: Array, y: Array, p: dict[str, float], which: str) -> Array:
    """Share of each sub-pixel that an ellipse covers: the half-axes matrix S maps the unit disc on it.

    The signed distance is |u| - 1 over the length of its gradient, u = S^-1 (x - c): exact at the rim.
    """
    xx, xy, yy = (p[f"{k}{which}"] for k in ("sxx", "sxy", "syy"))
    determinant = xx * yy - xy**2
    dx, dy = x - p[f"x{which}"], y - p[f"y{which}"]
    u, v = (yy * dx - xy * dy) / determinant, (xx * dy - xy * dx) / determinant
    length = np.maximum(np.hypot(u, v), 1e-9)
    gradient = np.hypot((yy * u - xy * v) / determinant, (xx * v - xy * u) / determinant) / length
    return np.asarray(np.clip(0.5 - FINE * (length - 1) / gradient, 0.0, 1.0))


def _at_pixels(fine: Array) -> Array:
    """Values at the pixels' centres: FINE is even, so between four sub-pixels (a shift by half a sub-pixel, undone)."""
    size = len(fine)
    turn_y = np.exp(1j * np.pi * np.fft.fftfreq(size) * (FINE - 1))[:, None]
    turn_x = np.exp(1j * np.pi * np.fft.rfftfreq(size) * (FINE - 1))[None]
    return np.fft.irfft2(np.fft.rfft2(fine) * turn_y * turn_x, s=fine.shape)[::FINE, ::FINE]
