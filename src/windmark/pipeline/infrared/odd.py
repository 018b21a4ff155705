"""Single pictures whose temperatures are none of their instant: a flash, a shutter's flag, a torn file."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from windmark.errors import g3
from windmark.paint import before_start
from windmark.pipeline.infrared.jumps import ASKED
from windmark.pipeline.infrared.load import InfraredRun
from windmark.pipeline.infrared.store import Store
from windmark.tasks.infrared.breaks import PART, SUDDEN, USUAL
from windmark.tasks.infrared.windows import NORMAL, frames_round, size

Array = NDArray[np.float64]

SHOWN = 3
"""Frames of a camera that are named."""


def odd_frames(run: InfraredRun, store: Store, frames: Sequence[int]) -> str:
    """What is to be said of pictures that fit neither the one before nor the one behind; "" where there are none.

    Heat flux is made of changes of temperature: such a picture is a pulse of heat and one of cooling, and what straight
    lines between samples leave is large for all later frames.
    """
    heat = run.project.heat
    if heat is None or not frames:
        return ""
    times, said = run.times[list(frames)], []
    first = int(before_start(times, heat.start_s).sum())  # a flash that heats is there, and off again by the next frame
    for camera in store.cameras:
        values = [store.values(i, camera, ASKED) for i in frames]
        found = [(k, kelvin) for k, kelvin in odd_of(values, times) if k != first]
        shown = [f"frame {run.timeline.frames[frames[k]].key} by {g3(kelvin)} K" for k, kelvin in found[:SHOWN]]
        more = f" and {len(found) - SHOWN} more" if len(found) > SHOWN else ""
        if found:
            said.append(f"{camera}: {', '.join(shown)}{more}")
    if not said:
        return ""
    return (f"temperatures that go off for one frame and come back: {'; '.join(said)} (typical node): a flash, a "
            "shutter, or a damaged file. They are wrong there, and heat flux from there on is worse: take the picture "
            "out")  # fmt: skip


def odd_of(values: Sequence[Array | None], times: Array) -> list[tuple[int, float]]:
    """Frames that are off the course of those beside them, and by how many kelvin, of a history of F frames.

    Parameters
    ----------
    values : (N,) of each frame, NaN where unknown; None where the camera has no picture
    times : (F,) seconds; what lies beside a pause is not asked
    """
    looks = {}
    for k, t in frames_round(values, times, 2, 2):
        before, over, behind = t[1] - t[0], 0.5 * (t[3] - t[1]), t[4] - t[3]
        off = size(t[2] - 0.5 * (t[1] + t[3]))
        looks[k] = off, [size(over - before), size(behind - over), size(behind - before)], size(over)
    if not looks:
        return []
    noise = float(np.median([off for off, _, _ in looks.values()]))
    change = float(np.median([c for _, changes, _ in looks.values() for c in changes]))
    return [
        (k, off / NORMAL) for k, (off, changes, step) in looks.items()
        if off > max(USUAL * noise, SUDDEN * np.sqrt(max(max(changes) ** 2 - change**2, 0.0)), PART * step)
    ]  # fmt: skip
