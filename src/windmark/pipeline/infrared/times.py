"""When the frames of an infrared run were: checked before any picture is read, for heat flux is made of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.errors import g3
from windmark.paint import Wall, before_start
from windmark.pipeline.deform.frames import FrameTable
from windmark.pipeline.deform.timeline import Timeline
from windmark.pipeline.infrared.project import InfraredProject
from windmark.tasks.infrared.histories import LATE_FOURIER

Array = NDArray[np.float64]

ODD = 1.5
"""A table's usual spacing and that of a rate may differ by this factor: else one of them is in another unit."""


def frame_times(project: InfraredProject, timeline: Timeline, table: FrameTable) -> tuple[Array, list[str]]:
    """(F,) seconds of the frames, by the cameras' clocks, the table, time stamps or the rate; and what is odd.

    Raises
    ------
    FileError
        Where table, rate and the recordings' own times contradict each other; where heat flux is wanted and a frame has
        no time, times do not increase, the heating did not begin between the frames, or a wall is too thin for all.
    """
    rate, where = project.sequence.rate_hz, project.sequence.frames or project.path
    by_table = np.array([
        table.time_s[row] if (row := table.row(f.key)) is not None else np.nan for f in timeline.frames
    ])  # fmt: skip
    own = np.array([f.time_s for f in timeline.frames])
    by_rate = np.array([f.instant / rate if rate else np.nan for f in timeline.frames])
    times = np.where(np.isfinite(own), own, by_rate) if not np.isfinite(by_table).any() or timeline.clock else by_table
    if rate and np.isfinite(by_table).sum() > 1 and not timeline.clock:
        usual = float(np.nanmedian(np.diff(by_table)))
        if not 1 / ODD < usual * rate < ODD:
            raise io.FileError(
                where, f"time_s says {usual:.4g} s from frame to frame, sequence.rate_hz {1 / rate:.4g} s: one of them "
                "is wrong, or time_s is not in seconds", "time_s",
            )  # fmt: skip
    _check_recorded(project, timeline, times)
    if project.heat is None:
        return times, []
    lost = [f.key for f, t in zip(timeline.frames, times, strict=True) if not np.isfinite(t)]
    if lost:
        raise io.FileError(
            where, f"nothing says when frame {lost[0]} was taken ({len(lost)} frames have no time); expected time_s in "
            "the table sequence.frames, sequence.rate_hz, or times of a camera", "sequence",
        )  # fmt: skip
    back = np.flatnonzero(np.diff(times) <= 0)
    if len(back):
        k = int(back[0])
        a, b = timeline.frames[k].key, timeline.frames[k + 1].key
        raise io.FileError(
            where, f"frame {b} at {times[k + 1]:g} s is not after frame {a} at {times[k]:g} s; expected times that "
            "increase with the frames", "time_s",
        )  # fmt: skip
    start = project.heat.start_s
    before = before_start(times, start)
    if not before.any() or before.all():
        raise io.FileError(
            project.path, f"is {start:g}, the frames are from {times[0]:g} to {times[-1]:g} s; expected a time with at "
            "least one frame before it, for the initial temperature, and one after it", "heat.start_s",
        )  # fmt: skip
    _check_walls(project, times[~before] - start, [w.wall for w in project.wall])
    return times, _gaps(times)


def _check_recorded(project: InfraredProject, timeline: Timeline, times: Array) -> None:
    """See that the time from frame to frame is what recordings and names with stamps say, where they say it.

    A film's stamps are those of showing it, which may be slower than it was taken.
    """
    for camera in dict.fromkeys(name for frame in timeline.frames for name in frame.images):
        items = [frame.images.get(camera) for frame in timeline.frames]
        own = np.array([
            item.time_s if isinstance(item, io.Frame) and not item.frames.kind.startswith("film") else frame.time_s
            for item, frame in zip(items, timeline.frames, strict=True)
        ])  # fmt: skip
        on = np.isfinite(own) & np.isfinite(times)
        there, here = np.diff(own[on]), np.diff(times[on])
        if on.sum() > 1 and (there > 0).all() and (here > 0).all():
            usual = float(np.median(here / there))
            if not 1 / ODD < usual < ODD:
                raise io.FileError(
                    project.sequence.frames or project.path,
                    f"says {g3(float(np.median(here)))} s from frame to frame, the pictures of {camera} hold time "
                    f"stamps {g3(float(np.median(there)))} s apart: one of them is wrong, or times are not in seconds",
                    "time_s",
                )  # fmt: skip


def _check_walls(project: InfraredProject, since: Array, walls: list[Wall]) -> None:
    """A wall that is too thin from the first frame on is none that a semi-infinite one may stand for."""
    for k, wall in enumerate(walls):
        fourier = wall.fourier_number(since)
        if (fourier > LATE_FOURIER).all():
            thin = float(since[0] * LATE_FOURIER / fourier[0])
            raise io.FileError(
                project.path, f"the back of this semi-infinite wall is felt from {g3(thin)} s after the start (Fourier "
                f'number {LATE_FOURIER:g}), the first frame is {g3(since[0])} s after it; expected back = "adiabatic" '
                'or "isothermal", a thicker wall, earlier frames, or times in seconds', f"wall[{k}].back",
            )  # fmt: skip


def _gaps(times: Array) -> list[str]:
    """Pauses between frames."""
    spacing = np.diff(times)
    usual = float(np.median(spacing))
    long = np.flatnonzero(spacing > 3 * usual)
    if not len(long):
        return []
    k = int(long[np.argmax(spacing[long])])
    return [
        f"{len(long)} pauses between frames are longer than 3 times the usual {g3(usual)} s, the longest "
        f"{g3(spacing[k])} s before {times[k + 1]:g} s: the temperature is taken as straight across them"
    ]
