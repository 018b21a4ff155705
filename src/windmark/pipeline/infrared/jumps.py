"""Temperatures that jump from one frame to the next: a camera's shutter (NUC), frames that are lost, and no heating."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from windmark.errors import g3
from windmark.paint import before_start
from windmark.pipeline.infrared.load import InfraredRun
from windmark.pipeline.infrared.start import thick
from windmark.pipeline.infrared.store import Store, every
from windmark.tasks.infrared.breaks import Break, breaks_of, unlike_heat
from windmark.tasks.infrared.windows import frames_round, spread

Array = NDArray[np.float64]

ASKED = 2000
"""Nodes that are asked."""
EVEN = 5.0
"""Times the nodes' spread (a robust sigma, with noise) that a change of all is: heating differs over a model."""
SUDDEN = 3.0
"""Times the changes before and after it that a jump is."""


def jumps(run: InfraredRun, store: Store, frames: Sequence[int]) -> list[str]:
    """What is to be said where temperatures break off from one frame to the next; nothing where none do.

    Heat flux is made of changes of temperature: a step of the camera, or of time, is a pulse of heat, and a wrong flux
    for long after. What heats a model heats it unevenly, and goes on; where the heating begins it may do the one or the
    other alone, and only what is surely no heat is said.
    """
    heat = run.project.heat
    if heat is None or len(frames) < 4:
        return []
    times = run.times[list(frames)]
    began = int(before_start(times, heat.start_s).sum()) - 1
    levels: dict[str, list[tuple[int, float]]] = {}
    lost: dict[int, dict[str, Break]] = {}
    patterns: dict[int, dict[str, Break]] = {}
    for camera in store.cameras:
        values = [store.values(i, camera, ASKED) for i in frames]
        taking = _on_thick(run, values)
        breaks = [b for b in breaks_of(taking, times) if abs(b.after - began) > 1
                  or (b.lost is None and unlike_heat(taking, b.after, level=False))]  # fmt: skip
        for b in breaks:
            (patterns if b.lost is None else lost).setdefault(b.after, {})[camera] = b
        known = {b.after for b in breaks}
        found = [(k, step) for k, step in jumps_of(values, times) if k not in known
                 and (abs(k - began) > 1 or unlike_heat(values, k, level=True))]  # fmt: skip
        if found:
            levels[camera] = found
    keys = [run.timeline.frames[i].key for i in frames]
    return [*_lost_words(lost, keys), *_level_words(levels, keys, began), *_pattern_words(patterns, keys)]


def _on_thick(run: InfraredRun, values: Sequence[Array | None]) -> list[Array | None]:
    """The values of nodes on walls that take heat in; a thin sheet's temperature may well go up and stay there."""
    spacing = float(np.median(np.diff(run.times)))
    thick_ones = [k for k, wall in enumerate(run.walls) if thick(wall, spacing)]
    on = np.isin(run.wall_of[:: every(len(run.wall_of), ASKED)], thick_ones)
    return [None if v is None else v[on] for v in values]


def _lost_words(lost: Mapping[int, Mapping[str, Break]], keys: Sequence[str]) -> list[str]:
    out = []
    for k, cameras in sorted(lost.items()):
        ranges = [b.lost for b in cameras.values() if b.lost is not None]
        low, high = sorted((max(r[0] for r in ranges), min(r[1] for r in ranges)))
        many = f"{low} to {high} frames" if low < high else f"{low} frame{'s' * (low > 1)}"
        out.append(f"{', '.join(cameras)}: between frames {keys[k]} and {keys[k + 1]} every node's temperature goes on "
                   f"by several of its own steps at once, as where {many} are lost: times from there on are too early, "
                   "and heat flux is wrong. Give the frames their true times, or keep their true numbers")  # fmt: skip
    return out


def _level_words(levels: Mapping[str, list[tuple[int, float]]], keys: Sequence[str], began: int) -> list[str]:
    said, places = [], []
    for camera, found in levels.items():
        k, step = max(found, key=lambda one: abs(one[1]))
        places.append(k)
        more = f" (and {len(found) - 1} more such jumps)" if len(found) > 1 else ""
        said.append(f"{camera}: its temperatures jump by {g3(step)} K at all nodes between frames "
                    f"{keys[k]} and {keys[k + 1]}{more}")  # fmt: skip
    if not said:
        return []
    # Of a wall that is at rest yet, lost frames make no jump.
    at_once = len(places) > 1 and len(set(places)) == 1 and abs(places[0] - began) > 1
    cause = "frames that are lost there, or a" if at_once else "its"
    return [f"{'; '.join(said)}: {cause} shutter (NUC) or another range, no heating; heat flux from there on is wrong. "
            "Record without corrections meanwhile, or end the run before them"]  # fmt: skip


def _pattern_words(patterns: Mapping[int, Mapping[str, Break]], keys: Sequence[str]) -> list[str]:
    if not patterns:
        return []
    k = max(patterns, key=lambda k: max(b.kelvin for b in patterns[k].values()))
    cameras = patterns[k]
    more = f" (and {len(patterns) - 1} more such places)" if len(patterns) > 1 else ""
    return [f"{', '.join(cameras)}: between frames {keys[k]} and {keys[k + 1]} the nodes' temperatures go apart by "
            f"{g3(max(b.kelvin for b in cameras.values()))} K (1 sigma over the nodes) and stay so{more}: a correction "
            "of the camera's pixels (NUC) or a reflection that changed, no heating; heat flux from there on is off by "
            "more than its sigma. Record without corrections meanwhile, or end the run before them"]  # fmt: skip


def jumps_of(values: Sequence[Array | None], times: Array) -> list[tuple[int, float]]:
    """Jumps of a history of F frames: after which frame, and by how many kelvin.

    Parameters
    ----------
    values : (N,) of each frame, NaN where unknown; None where the camera has no picture
    times : (F,) seconds; what lies beside a pause is not asked
    """
    out = []
    for k, four in frames_round(values, times, 1, 2):
        steps = np.diff(four, axis=0)
        beyond = steps[1] - 0.5 * (steps[0] + steps[2])
        jump = float(np.median(beyond))
        before, now, after = np.abs(np.median(steps, axis=1))
        if abs(jump) > EVEN * spread(beyond) and now > SUDDEN * max(before, after):
            out.append((k, jump))
    return out
