"""Scenes for the hunt: faint discs, tilted discs, and discs among things that are none (`_clutter`)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from _clutter import FINE, OVERALL, PAINTERS
from _raster import Drawing, Optics
from _sensor import Sensor

Array = NDArray[np.float64]
CELL = 44  # px between pieces of clutter
LIGHT, DIM, GAIN = 180.0, 60.0, 2.6  # of dark markers' paint; of bright ones' surface, and how much brighter they are
OPTICS = Optics(0.6)


@dataclass(frozen=True)
class Hunt:
    """A picture and its markers: centres (N, 2), radius, signal over noise of the matched filter (N,), tilt (N,)."""

    image: NDArray
    xy: Array
    radius: float
    snr: Array
    tilt_deg: Array
    polarity: str


def places(size: int, rng: np.random.Generator, cell: float, margin: float) -> Array:
    """Jittered places on a grid, in random order."""
    count = int((size - 2 * margin) / cell)
    grid = np.stack(np.meshgrid(np.arange(count), np.arange(count)), axis=-1).reshape(-1, 2)
    xy = margin + (grid + 0.5) * cell + rng.uniform(-0.12, 0.12, (len(grid), 2)) * cell
    return np.asarray(xy[rng.permutation(len(xy))])


def stamp(radius: float, tilt_deg: float, xy: Array, rng: np.random.Generator, optics: Optics = OPTICS) -> Drawing:
    """A disc of contrast 1 on light of level 1, at a place in its pixel."""
    minor, turn = radius * np.cos(np.radians(tilt_deg)), rng.uniform(0, np.pi)
    c, s = np.cos(turn), np.sin(turn)
    away = xy - np.rint(xy)
    values = {"x": away[0], "y": away[1], "sxx": radius * c * c + minor * s * s, "sxy": (radius - minor) * c * s,
              "syy": radius * s * s + minor * c * c, "contrast": 1.0, "level": 1.0,
              "slope x": 0.0, "slope y": 0.0}  # fmt: skip
    return Drawing(2 * int(np.ceil(radius + 5 * optics.spread + 1)) + 1, optics, values)


def faint(radius: float, seed: int, sensor: Sensor, snr: tuple[float, float], size: int = 512) -> Hunt:
    """Discs of a signal to noise of the matched filter sqrt(s^T C^-1 s), tilted by up to 60 deg, on bare paint."""
    rng = np.random.default_rng([seed, round(1000 * radius), 1])
    centres = places(size, rng, 4 * radius + 22, 10)
    share, kept, ratio, tilts = np.ones((size, size)), [], [], []
    for xy in centres:
        tilt, wanted = np.degrees(np.arccos(rng.uniform(0.5, 1))), np.exp(rng.uniform(*np.log(snr)))
        cover = 1 - stamp(radius, tilt, xy, rng).draw()
        window = cover > 0.01
        cov = sensor.covariance(np.full(cover.shape, LIGHT), window, rng)
        contrast = wanted / (LIGHT * np.sqrt(cover[window] @ np.linalg.solve(cov, cover[window])))
        if contrast > 0.9:
            continue
        press(share, xy, contrast * cover)
        kept.append(xy), ratio.append(wanted), tilts.append(tilt)
    return Hunt(sensor.picture(share * _light(size, rng), rng), np.array(kept), radius, np.array(ratio),
                np.array(tilts), "dark")  # fmt: skip


def clean(radius: float, seed: int, depth_over_noise: float, size: int = 512) -> Hunt:
    """Discs tilted by 0 to 70 deg, nothing else."""
    rng = np.random.default_rng([seed, round(1000 * radius), 2])
    centres = places(size, rng, 4 * radius + 22, 10)
    share, tilts = np.ones((size, size)), rng.uniform(0, 70, len(centres))
    for xy, tilt in zip(centres, tilts, strict=True):
        press(share, xy, 0.7 * (1 - stamp(radius, tilt, xy, rng).draw()))
    sensor = Sensor(white=0.7 * LIGHT / depth_over_noise)
    image = sensor.picture(share * _light(size, rng, 0.0), rng)
    return Hunt(image, centres, radius, np.full(len(centres), np.nan), tilts, "dark")


def cluttered(kind: str, radius: float, seed: int, markers: int, size: int = 768) -> tuple[Hunt, Hunt]:
    """Clutter of one kind over the whole picture but where markers are: dark markers, and the same bright on dark."""
    rng = np.random.default_rng([seed, round(1000 * radius), *kind.encode()])
    fine = np.ones((size * FINE, size * FINE), dtype=np.float32)
    # A marker's surroundings are free of clutter: this is about false markers, `detection_limits` about disturbed ones.
    centres = places(size, rng, max(CELL, 4 * radius + 20), 12)
    mine, rest = centres[:markers], centres[markers:]
    PAINTERS[kind](fine, rest, radius, rng)
    share = cv2.resize(fine, (size, size), interpolation=cv2.INTER_AREA)
    for xy in mine if kind in OVERALL else ():
        _clear(share, xy, 2 * radius + 6)
    share = np.asarray(cv2.GaussianBlur(share, (0, 0), OPTICS.gauss), dtype=float)
    tilts = np.degrees(np.arccos(rng.uniform(0.5, 1, len(mine))))
    for xy, tilt in zip(mine, tilts, strict=True):
        press(share, xy, 0.7 * (1 - stamp(radius, tilt, xy, rng).draw()))
    sensor, unknown = Sensor(white=2.0, bits=8), np.full(len(mine), np.nan)
    dark = sensor.picture(share * _light(size, rng), rng)
    bright = sensor.picture(DIM * (1 + GAIN * (1 - share)), rng)
    return (Hunt(dark, mine, radius, unknown, tilts, "dark"), Hunt(bright, mine, radius, unknown, tilts, "bright"))


def _light(size: int, rng: np.random.Generator, uneven: float = 0.15) -> Array:
    y, x = np.mgrid[:size, :size] / size
    a, b = rng.uniform(0, 2 * np.pi, 2)
    return np.asarray(LIGHT * (1 + uneven * np.sin(3 * x + a) * np.cos(2 * y + b)))


def press(share: Array, xy: Array, cover: Array) -> None:
    """A disc's share of the light taken away from the scene."""
    x, y = np.rint(xy).astype(int)
    half = len(cover) // 2
    share[y - half : y + half + 1, x - half : x + half + 1] *= 1 - cover


def _clear(share: NDArray[np.float32], xy: Array, reach: float) -> None:
    """Bare paint round a place, faded in."""
    size = len(share)
    x0, x1, y0, y1 = (int(np.clip(v, 0, size)) for v in (xy[0] - reach, xy[0] + reach, xy[1] - reach, xy[1] + reach))
    y, x = np.mgrid[y0:y1, x0:x1]
    keep = np.clip((np.hypot(x - xy[0], y - xy[1]) - reach + 3) / 3, 0, 1)
    share[y0:y1, x0:x1] = 1 + (share[y0:y1, x0:x1] - 1) * keep
