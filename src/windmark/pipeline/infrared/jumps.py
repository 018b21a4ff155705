"""A camera's level that jumps for all nodes from one frame to the next: its shutter (NUC), and no heating."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from windmark.errors import g3
from windmark.paint import before_start
from windmark.pipeline.infrared.load import InfraredRun
from windmark.pipeline.infrared.store import Store

Array = NDArray[np.float64]

ASKED = 2000
"""Nodes that are asked."""
EVEN = 5.0
"""Times the nodes' spread (a robust sigma, with noise) that a change of all is: heating differs over a model."""
SUDDEN = 3.0
"""Times the changes before and after it that a jump is."""


def jumps(run: InfraredRun, store: Store, frames: Sequence[int]) -> str:
    """What is to be said where a camera's level jumps; "" where none does.

    Heat flux is made of changes of temperature: a step of the camera is a pulse of heat, and a wrong flux for
    long after. What heats a model heats it unevenly, and goes on; where the heating begins it may do neither.
    """
    heat = run.project.heat
    if heat is None or len(frames) < 4:
        return ""
    times = run.times[list(frames)]
    began = int(before_start(times, heat.start_s).sum()) - 1
    said = []
    for camera in store.cameras:
        found = [(k, step) for k, step in jumps_of([store.values(i, camera, ASKED) for i in frames], times)
                 if abs(k - began) > 1]  # fmt: skip
        if found:
            k, step = max(found, key=lambda one: abs(one[1]))
            keys = (run.timeline.frames[frames[at]].key for at in (k, k + 1))
            more = f" (and {len(found) - 1} more such jumps)" if len(found) > 1 else ""
            said.append(f"{camera}: its temperatures jump by {g3(step)} K at all nodes between frames "
                        f"{' and '.join(keys)}{more}")  # fmt: skip
    if not said:
        return ""
    return (f"{'; '.join(said)}: its shutter (NUC) or another range, no heating; heat flux from there on is wrong. "
            "Record without corrections meanwhile, or end the run before them")  # fmt: skip


def jumps_of(values: Sequence[Array | None], times: Array) -> list[tuple[int, float]]:
    """Jumps of a history of F frames: after which frame, and by how many kelvin.

    Parameters
    ----------
    values : (N,) of each frame, NaN where unknown; None where the camera has no picture
    times : (F,) seconds; what lies beside a pause is not asked
    """
    out = []
    spacing = np.diff(times)
    usual = 1.5 * float(np.median(spacing))
    for k in range(1, len(values) - 2):
        four = [v for v in values[k - 1 : k + 3] if v is not None]
        if len(four) < 4 or (spacing[k - 1 : k + 2] > usual).any():
            continue
        steps = np.diff(np.array(four), axis=0)
        steps = steps[:, np.isfinite(steps).all(axis=0)]
        if not steps.size:
            continue
        beyond = steps[1] - 0.5 * (steps[0] + steps[2])
        jump = float(np.median(beyond))
        spread = 1.4826 * float(np.median(np.abs(beyond - jump)))
        before, now, after = np.abs(np.median(steps, axis=1))
        if abs(jump) > EVEN * spread and now > SUDDEN * max(before, after):
            out.append((k, jump))
    return out
