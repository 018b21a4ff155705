"""What a camera's numbers say: the signal of its calibration, pixels made equal by even pictures, and noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.errors import DataError, g3
from windmark.paint import NotFitted, PlanckBand, SensorRadiance, fit_sensor_radiance
from windmark.paint.radiance import Radiance
from windmark.pipeline.deform.frames import files_of
from windmark.pipeline.deform.pictures import read
from windmark.pipeline.infrared.project import CameraEntry, InfraredProject
from windmark.pipeline.light import without_dead
from windmark.pipeline.psp.bits import Bits, otherwise, shifted
from windmark.pipeline.psp.columns import temperatures
from windmark.pipeline.psp.stream import FROZEN_K, TEMPERATURE
from windmark.scene.levels import saturation_level
from windmark.tasks.deform.task import Image, Reader, Station

MOST_DEAD = 0.1
"""Part of a sensor's pixels that may have died."""
Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ODD = 2.0
"""Factor on the median response from which on, and below which, a pixel is dead."""
HOT = 5.0
"""So many times the median scatter is no noise."""


@dataclass(frozen=True, eq=False)
class ThermalSensor:
    """A camera.

    Parameters
    ----------
    radiance : black body's signal
    entry : of the project: how numbers become a signal
    cold, hot : (H, W) signal of the even pictures, means; None without
    frames : pictures in each of these
    noise : variance of a pixel's signal
    dead : (H, W) pixels that do not count; None: all do
    bits, level : how the numbers of the even pictures are stored, and a typical one; NaN without even pictures
    patterns : (H, W) numbers of the even pictures, means, the colder first
    """

    radiance: Radiance
    entry: CameraEntry
    cold: Array | None
    hot: Array | None
    frames: int
    noise: float
    dead: Mask | None
    bits: Bits = field(default_factory=Bits)
    level: float = float("nan")
    patterns: tuple[Array, ...] = ()

    def evened(self, picture: NDArray[np.generic]) -> NDArray[np.generic]:
        """A picture (H, W) with its pixels made equal, in its own numbers: what markers are looked for in.

        Pixels that are saturated or dead are as they were, and so is a picture in other bits than the even ones.
        """
        if not self.patterns or self._in_other_bits(picture):
            return picture
        value, cold, hot = np.asarray(picture, dtype=float), self.patterns[0], self.patterns[-1]
        gain = np.ones(cold.shape)
        if len(self.patterns) == 2:
            with np.errstate(invalid="ignore", divide="ignore"):
                gain = (np.median(hot) - np.median(cold)) / (hot - cold)
        out = np.median(cold) + gain * (value - cold)
        left = _full(picture, self.entry.saturation) | ~np.isfinite(out)
        out = np.where(left if self.dead is None else left | self.dead, value, out)
        if picture.dtype.kind in "ui":
            most = np.iinfo(picture.dtype.name)
            out = np.clip(np.rint(out), most.min, most.max)
        return np.asarray(out.astype(picture.dtype))

    def _in_other_bits(self, picture: NDArray[np.generic]) -> int:
        """By how many bits a picture's numbers are stored otherwise than those of the even pictures; 0: as they are."""
        by = Bits.of(picture).beyond(self.bits)
        return by if by and shifted(by, float(np.median(np.asarray(picture, dtype=float))) / self.level) else 0

    def signal(self, picture: NDArray[np.generic]) -> tuple[Array, Array, Mask]:
        """Signal (H, W), its variance and which pixels are saturated; NaN where a pixel does not count.

        Raises
        ------
        DataError
            For numbers that are stored in other bits than those of the even pictures.
        """
        if by := self._in_other_bits(picture):
            raise DataError(otherwise("this frame", "the even pictures", by))
        value = to_signal(self.entry, self.radiance, picture)
        full = _full(picture, self.entry.saturation)
        variance = np.full(value.shape, self.noise)
        if self.cold is not None and self.hot is not None:
            a, b = self.cold, self.hot
            with np.errstate(invalid="ignore", divide="ignore"):
                part, gain = (value - a) / (b - a), (np.nanmedian(b) - np.nanmedian(a)) / (b - a)
            value = np.nanmedian(a) + part * (np.nanmedian(b) - np.nanmedian(a))
            variance = gain**2 * variance * (1 + ((1 - part) ** 2 + part**2) / self.frames)
        elif self.cold is not None:
            value = value - self.cold + np.nanmedian(self.cold)
            variance = variance * (1 + 1 / self.frames)
        bad = full if self.dead is None else full | self.dead
        value = without_dead(np.where(bad, np.nan, value))
        return value, np.where(np.isnan(value), np.nan, variance), full


def to_signal(entry: CameraEntry, radiance: Radiance, picture: NDArray[np.generic]) -> Array:
    """Numbers of a picture in the unit of its radiance."""
    value = entry.offset + entry.scale * np.asarray(picture, dtype=float)
    if entry.quantity == "temperature":
        factor, offset = TEMPERATURE[entry.unit]
        kelvin = value * factor + offset
        # A pixel that has died says 0 or so, which is no temperature of any surface; where many do, it is the unit.
        dead = kelvin <= FROZEN_K
        return np.asarray(_interpolated(radiance, np.where(dead & (dead.mean() < MOST_DEAD), np.nan, kelvin)))
    return value


def _interpolated(radiance: Radiance, kelvin: Array) -> Array:
    """The band's radiance by a table over the picture's range: as exact as the numbers themselves."""
    low, high = float(np.nanmin(kelvin)), float(np.nanmax(kelvin))
    grid = np.linspace(max(low, 20.0), max(high, 21.0), 4097)
    return np.interp(kelvin, grid, radiance.radiance(grid))


def _full(picture: NDArray[np.generic], saturation: float | None) -> Mask:
    """Saturated pixels: by the project's number, and where the picture itself is at its highest level below that."""
    level = saturation_level(picture)
    return np.asarray(picture >= (level if saturation is None else min(level, saturation)))  # type: ignore[operator]


def read_sensor(project: InfraredProject, index: int, station: Station) -> ThermalSensor:
    """A camera's calibration, even pictures and noise.

    Raises
    ------
    FileError
        For tables that say no calibration, patterns that name no picture, and even pictures that do not differ.
    """
    entry, key = project.camera[index], f"camera[{index}]"
    radiance = _radiance(entry)
    even = [_even(project, f"{key}.even", pattern, station) for pattern in entry.even]
    # A pixel that is clipped in an even picture has another response there than it seems: no number shows it later.
    clipped = [np.any([_full(np.asarray(p), entry.saturation) for p in own], axis=0) for own in even]
    if (share := max((float(full.mean()) for full in clipped), default=0.0)) > MOST_DEAD:
        why = f"{g3(100 * share)} % of an even picture's pixels are saturated; expected them below that"
        raise io.FileError(project.path, why, f"{key}.even")
    stacks = [np.stack([to_signal(entry, radiance, p) for p in own]) for own in even]
    bits, level = Bits(), float("nan")
    if even:
        bits, level = Bits.of(np.stack(even[0])), float(np.median(even[0][0]))
    means = [s.mean(axis=0) for s in stacks]
    patterns = [np.mean(own, axis=0, dtype=float) for own in even]
    scatter = [s.var(axis=0, ddof=1) for s in stacks if len(s) > 1]
    if entry.netd_K is not None:
        noise = (entry.netd_K * float(radiance.slope(entry.netd_at_K))) ** 2
    elif scatter:
        noise = float(np.mean([np.mean(s[s < HOT**2 * np.median(s)]) for s in scatter]))
    else:
        raise io.FileError(project.path, "one even picture says no noise; expected several, or netd_K", f"{key}.even")
    dead = None
    if len(means) == 2:
        order = np.argsort([np.median(m) for m in means])
        means, patterns = [means[k] for k in order], [patterns[k] for k in order]
        rise = means[1] - means[0]
        if not float(np.median(rise)) > 5 * np.sqrt(noise):
            why = "the two even pictures hardly differ; expected a colder and a warmer black body"
            raise io.FileError(project.path, why, f"{key}.even")
        dead = ~((rise > np.median(rise) / ODD) & (rise < np.median(rise) * ODD))
    for odd in [*(s > HOT**2 * np.median(s) for s in scatter), *(full for full in clipped if full.any())]:
        dead = odd if dead is None else dead | odd
    cold, hot = (*means, None, None)[:2]
    return ThermalSensor(radiance, entry, cold, hot, min((len(s) for s in stacks), default=1), noise, dead, bits, level,
                         tuple(patterns))  # fmt: skip


def even_reader(sensors: Mapping[str, ThermalSensor]) -> Reader:
    """Reads pictures with their pixels made equal, see `ThermalSensor.evened`."""

    def even(item: io.PictureFile | Image, station: Station) -> Image:
        return sensors[station.name].evened(read(item, station))

    return even


def _radiance(entry: CameraEntry) -> Radiance:
    if entry.planck is not None:
        p = entry.planck
        return SensorRadiance(p.R, p.B, p.O, p.t_range_K)
    if entry.black_bodies is None:
        assert entry.band_um is not None
        return PlanckBand(*entry.band_um)
    table = io.read_table(entry.black_bodies, required=("counts",), known=None)
    sigma = table.numbers("sigma") if "sigma" in table else None
    fit = fit_sensor_radiance(temperatures(table, "temperature"), table.numbers("counts"), signal_sigma=sigma)
    if isinstance(fit, NotFitted):
        raise io.FileError(entry.black_bodies, fit.reason)
    return fit


def _even(project: InfraredProject, key: str, pattern: str, station: Station) -> list[Any]:
    files = files_of(project.path.parent / pattern)
    if not files:
        raise io.FileError(project.path, f"no file matches {pattern!r} beside the project", key)
    return [read(file, station) for file in files]
