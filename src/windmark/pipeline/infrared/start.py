"""Whether the heating began when it is said to: the wall must then be as warm within as its surface."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from windmark.errors import g3
from windmark.paint import Wall, before_start
from windmark.pipeline.infrared.load import InfraredRun
from windmark.pipeline.infrared.store import Store
from windmark.tasks.infrared import merged_temperature
from windmark.tasks.infrared.windows import size

Array = NDArray[np.float64]

EARLY = 0.02
"""Part of the whole rise that the temperature may have before the heating."""
THICK = (1.5, 2.1)
"""What the flux into a wall for a steady rise of its surface grows by in three times the time, sqrt(3) in a thick one:
in others steady heat makes a steady rise from the start on, which says nothing of what was before."""
GOES_ON, STRAIGHT = (0.7, 1.3), 0.1
"""A rise that goes on: the third step over the first one, and what the second one may differ from the middle of the two
by, as a part of the first one. Steady heat since n steps before the first one makes sqrt(n + 3) - sqrt(n + 2) over
sqrt(n + 1) - sqrt(n): 0.70 for n = 1.5. Heat that sets in within the first step makes 0.32 to 0.58 as long as its
second step is no larger than its first one, and heat that comes slowly makes steps that grow."""
SURE = 0.03
"""Part of the largest step that the middle of the nodes must be known to, 1 sigma."""
BY_CHANCE = 1e-3
"""Of films whose temperature stays before the heating so many are said to have one that rises."""
HEATED, GROUPS = 0.1, 4
"""Part of the largest rise from which a node is heated, and groups that these nodes are asked in."""


def odd_start(run: InfraredRun, store: Store, frames: Sequence[int]) -> str:
    """What is to be said where the model is heated already before the heating is said to begin; "" where it is not.

    The initial temperature, and what is below the surface, are then none of a wall at rest, and every heat flux is
    wrong by a part that no sigma has.
    """
    heat = run.project.heat
    if not frames or heat is None:
        return ""
    before = before_start(run.times[list(frames)], heat.start_s)
    if before.sum() > 1:
        return _risen_before(store, [i for i, b in zip(frames, before, strict=True) if b], frames[-1], run.times)
    times = run.times[list(frames)]
    for camera in store.cameras:
        values = [store.values(i, camera, len(run.mesh.vertices)) for i in frames]
        if (steps := goes_on(values, times, run.walls, run.wall_of)) is not None:
            first, later = (run.timeline.frames[frames[k]].key for k in (0, steps[0]))
            a, b, c = (g3(step) for step in steps[1])
            return (f"{camera}: only frame {first} is from before heat.start_s, and from it to frame {later} the "
                    f"temperature rises by {a} K (median), over the next two such times by {b} and {c} K: without the "
                    "break of a beginning. Either the heating began before the film did, and heat flux is too low, or "
                    "it grew at just that rate: give the frames from before the heating")  # fmt: skip
    return ""


def goes_on(
    values: Sequence[Array | None], times: Array, walls: Sequence[Wall], wall_of: NDArray[np.int64]
) -> tuple[int, list[float]] | None:
    """Where the temperature of heated nodes goes on straight through the start: frames of a step, and three of them.

    Of a wall at rest whose surface is heated from an instant on, the temperature rises with the root of the time since
    then. A rise that is steady from the only frame before the start on is one that was there before it.

    Parameters
    ----------
    values : (V,) of each of F frames, the first before the start, NaN where unknown; None without a picture
    times : (F,) seconds
    walls, wall_of : and (V,) the number of each node's
    """
    last = next((v for v in reversed(values) if v is not None), None)
    step = 1
    while 3 * step < len(values) and last is not None:
        four, at = [v for v in values[: 3 * step + 1 : step] if v is not None], times[: 3 * step + 1 : step]
        if len(four) < 4:
            return None
        taking = np.isin(wall_of, [k for k, wall in enumerate(walls) if thick(wall, at[1] - at[0])])
        steps = np.diff(np.array(four), axis=0) * (at[1] - at[0]) / np.diff(at)[:, None]
        rise = np.where(taking & np.isfinite(steps).all(axis=0), last - four[0], np.nan)
        sure = [found for group in _groups(rise) if (found := _middle(steps[:, group])) is not None]
        for first, second, third in sure:
            straight = abs(second - 0.5 * (first + third)) < STRAIGHT * abs(first)
            if straight and GOES_ON[0] * abs(first) < np.sign(first) * third < GOES_ON[1] * abs(first):
                return step, [first, second, third]
        if sure:
            return None
        step *= 2
    return None


def _groups(rise: Array) -> list[NDArray[np.intp]]:
    """Nodes that are heated by the end, by how much: where more heat comes later that hides what was before."""
    if not np.isfinite(rise).any():
        return []
    size = np.sign(np.nanmedian(rise)) * rise
    heated = np.flatnonzero(size > HEATED * np.nanquantile(size, 0.9))
    return np.array_split(heated[np.argsort(size[heated])], GROUPS)


def _middle(steps: Array) -> list[float] | None:
    """The middle of the nodes of three steps (3, N); None where it is not known well enough."""
    if not steps.size:
        return None
    middle = np.median(steps, axis=1)
    off = np.diff(steps - middle[:, None], axis=0) / np.sqrt(3)  # by noise: three times a step's, less of the heating
    known = 1.25 * size(off) / np.sqrt(steps.shape[1])
    return [float(m) for m in middle] if known < SURE * np.abs(middle).max() else None


def thick(wall: Wall, time: float) -> bool:
    """Whether so many seconds after it changed a surface's temperature is that of a wall that goes on below."""
    short, long = wall.ramp_response(np.array([time, 3 * time]))
    return bool(THICK[0] < long / short < THICK[1])


def _risen_before(store: Store, before: Sequence[int], end: int, times: Array) -> str:
    """The same where several frames are from before the start: their own rise, and what it comes to if it goes on.

    ``times``: (F,) of all frames. A rise of the first of them to the last one counts where it is a part of the whole
    one by itself, or where it is one by the end, at the rate of a straight line that is sure from its own scatter.
    """
    merged = [merged_temperature(store.temperatures(i))[0] for i in (*before, end)]
    kept = [(i, m.field) for i, m in zip((*before, end), merged, strict=True) if m is not None]
    fields = [field for _, field in kept]
    on = np.isfinite([of.value - fields[0].value for of in fields]).all(axis=0)
    if not on.any() or len(fields) < 3:
        return ""
    middle = np.array([float(np.median((of.value - fields[0].value)[on])) for of in fields])
    rise, total = middle[-2], middle[-1]
    by_chance = 1.25 * float(np.sqrt(np.median((fields[0].white + fields[-2].white)[on]) / on.sum()))
    since = times[[i for i, _ in kept]] - times[kept[0][0]]
    rate, rate_sigma = _line(since[:-1], middle[:-1], by_chance)
    by_end = rate * float(since[-1])
    at_once = abs(rise) >= max(EARLY * abs(total), 3 * by_chance)
    in_the_end = abs(rate) > rate_sigma and abs(by_end) >= EARLY * abs(total)
    if not at_once and not in_the_end:
        return ""
    return (f"the temperature rises by {g3(rise)} K (median) before heat.start_s, {g3(total)} K in all: the heating "
            f"began earlier, or a camera drifts. At that rate it is {g3(by_end)} K by the last frame, and heat flux "
            "may be wrong by such a part of it")  # fmt: skip


def _line(time: Array, value: Array, noise: float) -> tuple[float, float]:
    """Slope of a straight line, and what it would not pass by chance; inf where two points leave no scatter."""
    from scipy.stats import t

    apart = time - time.mean()
    slope = float(apart @ value / (apart @ apart))
    free = len(time) - 2
    if free < 1:
        return slope, float("inf")
    left = value - value.mean() - slope * apart
    scatter = max(float(np.sqrt(left @ left / free)), noise)
    return slope, float(t.isf(BY_CHANCE / 2, free)) * scatter / float(np.sqrt(apart @ apart))
