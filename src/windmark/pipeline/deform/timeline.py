"""Cameras with clocks of their own: when every picture was taken, and which pictures tell of which instant.

A moving model makes pictures of different times wrong by velocity times lag, so they are never simply paired. The
instants are the pictures of one camera; another camera that took none just then takes part with its pictures on both
sides, between which its spots are interpolated (`between`), or not at all.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.errors import UsageError
from windmark.pipeline.deform.entries import RECORDING, CameraEntry
from windmark.pipeline.deform.names import EXACT, is_number, key_of, kind_of, order
from windmark.pipeline.deform.project import DeformProject
from windmark.tasks.deform.task import FrameImages, Shot

Array = NDArray[np.float64]

SAME = 1e-3
"""Pictures nearer in time than this part of the camera's spacing are of one instant."""
MAX_LAG = 0.75
"""The nearest picture of a camera may be so far from an instant, as part of its usual spacing."""
GAP = 1.5
"""A longer pause between two pictures, as part of the usual spacing, is a gap that nothing is interpolated across."""
BEFORE = 3
"""Pictures before the instant that the interpolation takes, besides one after it."""


@dataclass(frozen=True)
class Reel:
    """A camera's pictures by time: names of the frames, times (F,) in seconds, files."""

    name: str
    key: tuple[str, ...]
    time_s: Array
    path: tuple[io.PictureFile, ...]

    @property
    def spacing_s(self) -> float:
        """The usual time from picture to picture; infinite with one picture."""
        return float(np.median(np.diff(self.time_s))) if len(self.key) > 1 else float("inf")


@dataclass(frozen=True)
class Timeline:
    """The frames of all cameras; ``remarks``: pictures that have no time, and the like."""

    frames: list[FrameImages]
    clock: str
    remarks: tuple[str, ...] = field(default=())


def timeline(
    project: DeformProject, found: Mapping[str, Mapping[str, io.PictureFile]], recorded: Mapping[str, Array]
) -> Timeline:
    """Instants and pictures of cameras of which at least one has a clock.

    Parameters
    ----------
    project : cameras and sequence
    found : camera -> {frame: file}
    recorded : camera -> times that its recording holds, one per picture in the order of the frames

    Raises
    ------
    FileError
        For a camera without any time, times that contradict the order of the pictures, cameras that never overlap.
    """
    remarks: list[str] = []
    reels = {}
    for i, camera in enumerate(project.camera):
        reels[camera.name] = _reel(project, i, camera, found[camera.name], recorded.get(camera.name), remarks)
    fastest = min(r.spacing_s for r in reels.values())
    clock = project.sequence.clock or next(n for n, r in reels.items() if r.spacing_s <= (1 + SAME) * fastest)
    own = reels[clock]
    frames = [_frame(own, n, reels, project.sequence.max_lag_s) for n in range(len(own.key))]
    for name, reel in reels.items():
        if not any(name in f.images for f in frames):
            first, last = own.time_s[[0, -1]]
            raise io.FileError(
                project.path, f"no picture of camera {name} ({reel.time_s[0]:g} to {reel.time_s[-1]:g} s) is near one "
                f"of {clock} ({first:g} to {last:g} s): nothing is seen together; check rate_hz, offset_s and times",
                f"camera[{[c.name for c in project.camera].index(name)}]",
            )  # fmt: skip
    _check_rates(project, own, reels, frames)
    return Timeline(frames, clock, tuple(remarks))


def _check_rates(project: DeformProject, own: Reel, reels: Mapping[str, Reel], frames: list[FrameImages]) -> None:
    """Refuse to interpolate between two pictures of one camera that were taken before and after all of another's.

    Rates in Hz and kHz, or periods in seconds and milliseconds, were mixed: nothing says what moved in between.
    """
    for i, camera in enumerate(project.camera):
        reel = reels[camera.name]
        span = float(np.ptp(own.time_s))
        if reel is own or not np.isfinite(reel.spacing_s) or not any(camera.name in f.shots for f in frames):
            continue
        if reel.spacing_s > span > 0:
            raise io.FileError(
                project.path, f"camera {camera.name} took a picture every {reel.spacing_s:g} s, camera {own.name} all "
                f"of its {len(own.key)} in {span:g} s (one every {own.spacing_s:g} s): between two pictures of "
                f"{camera.name} nothing says what moved; check the rates of both (rate_hz is in Hz, times in seconds)",
                f"camera[{i}]",
            )  # fmt: skip


def _reel(
    project: DeformProject, i: int, camera: CameraEntry, files: Mapping[str, io.PictureFile], recorded: Array | None,
    remarks: list[str],
) -> Reel:  # fmt: skip
    """A camera's pictures with their times, by the order of their frames, which must be that of the times."""
    keys = sorted(files, key=order)
    times = _times(project, i, camera, keys, recorded)
    known = np.isfinite(times)
    if not known.all():
        lost = [files[k].name for k, good in zip(keys, known, strict=True) if not good]
        remarks.append(f"{camera.name}: {len(lost)} pictures have no time and are left out: {', '.join(lost[:5])}")
    keys = [k for k, good in zip(keys, known, strict=True) if good]
    times = times[known] + camera.offset_s
    if not keys:
        raise io.FileError(
            camera.times or project.path, f"has no time of any picture of camera {camera.name}", f"camera[{i}].times"
        )
    back = np.flatnonzero(np.diff(times) <= 0)
    if len(back):
        a, b = back[0], back[0] + 1
        raise io.FileError(
            camera.times or project.path, f"camera {camera.name}: {files[keys[b]].name} at {times[b]:.9g} s is not "
            f"after {files[keys[a]].name} at {times[a]:.9g} s; expected times that increase with the frames",
            f"camera[{i}].times",
        )  # fmt: skip
    return Reel(camera.name, tuple(keys), times, tuple(files[k] for k in keys))


def _times(project: DeformProject, i: int, camera: CameraEntry, keys: list[str], recorded: Array | None) -> Array:
    """Seconds of each picture: from its table, its recording, or its rate; NaN where a table has none."""
    if camera.times not in (None, RECORDING):
        return _of_table(camera.times, keys)
    if recorded is not None:
        if np.shape(recorded) != (len(keys),):
            raise UsageError(f"recorded: expected {len(keys)} times of camera {camera.name}, got {np.shape(recorded)}")
        return np.asarray(recorded, dtype=float)
    rate = camera.rate_hz or project.sequence.rate_hz
    if rate is None:
        raise io.FileError(
            project.path, f"other cameras have clocks, but nothing says when {camera.name} took its pictures; expected "
            "rate_hz or times, or sequence.rate_hz", f"camera[{i}]",
        )  # fmt: skip
    if kind_of(keys) == "stamp" or any(is_number(k) and len(k) >= len(str(EXACT)) for k in keys):
        raise io.FileError(
            project.path, f"the numbers in the names of camera {camera.name} ({keys[0]}) are no frame numbers: a rate "
            'does not say when they were; expected times: a table, or "recording" for time stamps in the names',
            f"camera[{i}]",
        )  # fmt: skip
    numbered = all(map(is_number, keys))
    return np.array([float(k) for k in keys] if numbered else np.arange(len(keys), dtype=float)) / rate


def _of_table(path: Path, keys: list[str]) -> Array:
    """Times of a table ``image,time_s`` or ``frame,time_s``, in any order; rows without a picture are dropped ones."""
    table = io.read_table(path, required=("time_s",), known=("image", "frame", "time_s"))
    column = next((c for c in ("image", "frame") if c in table.columns), None)
    if column is None:
        raise io.FileError(path, "has no column image or frame; expected image,time_s or frame,time_s", "header")
    stems = table.text(column)
    values = table.numbers("time_s")
    known: dict[str, float] = {}
    for row, (text, value) in enumerate(zip(stems, values, strict=True)):
        key = key_of(Path(text).stem if column == "image" else text)
        if key in known:
            table.fail(row, f"{column} {text} is frame {key}, which is there before; expected every picture once")
        known[key] = float(value)
    return np.array([known.get(k, np.nan) for k in keys])


def _frame(own: Reel, n: int, reels: Mapping[str, Reel], max_lag_s: float | None) -> FrameImages:
    """The instant of picture n of the camera that is the clock."""
    time = float(own.time_s[n])
    images: dict[str, io.PictureFile] = {}
    shots: dict[str, tuple[Shot, ...]] = {}
    missing: dict[str, str] = {}
    for name, reel in reels.items():
        if reel is own:
            images[name] = own.path[n]
            continue
        seen = _round(reel, time, max_lag_s)
        if isinstance(seen, str):
            missing[name] = seen
            continue
        nearest = seen[int(np.argmin(np.abs(reel.time_s[seen] - time)))]
        images[name] = reel.path[nearest]
        if len(seen) > 1:
            shots[name] = tuple(Shot(float(reel.time_s[k]), reel.path[k]) for k in seen)
    return FrameImages(own.key[n], time, images, shots, missing, time)


def _round(reel: Reel, time: float, max_lag_s: float | None) -> list[int] | str:
    """Pictures of a camera round an instant, by time: one if it is of the instant; or why there are none."""
    nearest = int(np.argmin(np.abs(reel.time_s - time)))
    lag, usual = float(reel.time_s[nearest] - time), reel.spacing_s
    if abs(lag) <= (SAME * usual if np.isfinite(usual) else 1e-9):
        return [nearest]
    limit = MAX_LAG * usual if max_lag_s is None else max_lag_s
    if not abs(lag) <= limit or not np.isfinite(usual):
        return f"no image: the nearest is {abs(lag):.4g} s {'later' if lag > 0 else 'earlier'}"
    after = int(np.searchsorted(reel.time_s, time))
    if after in (0, len(reel.key)):
        side = "earlier" if after == 0 else "later"
        return f"no image: the nearest is {abs(lag):.4g} s away, and none is {side} to interpolate with"
    gap = max(GAP * usual, 2 * limit)
    if reel.time_s[after] - reel.time_s[after - 1] > gap:
        return f"no image: a gap of {reel.time_s[after] - reel.time_s[after - 1]:.4g} s"
    first = after - 1
    while first > 0 and after - first < BEFORE and reel.time_s[first] - reel.time_s[first - 1] <= gap:
        first -= 1
    return list(range(first, after + 1))
