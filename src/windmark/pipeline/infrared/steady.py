"""The mean of all frames of a run without heating: a steady temperature, with what the frames scatter.

A mean of frames in which the model warms up is a number as well, but the temperature of some instant. Noise is new in
every frame, and less in their mean; a course is not: it is told, and is in the sigma as a whole.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark.errors import g3
from windmark.paint import NodeField, NotFitted, average_frames
from windmark.pipeline.infrared.store import Store
from windmark.tasks.infrared import merged_temperature

Array = NDArray[np.float64]

TIMES = 3.0
"""Times the noise that frames of one state may scatter."""
TURNS = 1.0
"""Mean square of the steps from frame to frame over that of the scatter, below which it is a course: of noise it is 2,
of four frames on a straight line 0.6, of more frames less."""
COURSE = "course"


@dataclass(frozen=True)
class Course:
    """Temperatures that change over the frames.

    Parameters
    ----------
    kelvin, times : rms of a typical node, and that over its noise
    in_all : kelvin, the last frame less the first one
    """

    kelvin: float
    times: float
    in_all: float

    @property
    def words(self) -> str:
        """One sentence, and what to do."""
        return (f"the mean of the frames is of temperatures that are not steady: they differ by {g3(self.kelvin)} K "
                f"(rms of a typical node, {g3(self.times)} times their noise), the last frame's from the first one's "
                f"by {g3(self.in_all)} K. Take steady frames alone; of a model that is heated give [heat] and "
                "[[wall]]")  # fmt: skip


@dataclass(frozen=True, eq=False)
class SteadyMap:
    """Mean temperature.

    Parameters
    ----------
    field : (V) kelvin; causes that last over the run are modes, noise falls with the number of frames
    count : (V,) frames that show each node
    left_out : index of a frame -> why it does not count
    excess : by which the frames scatter more than their noise says, as a factor; in the noise where it is above 1
    course : None where the temperatures are steady, to within what the mean is known to; else a mode of ``field``
    """

    field: NodeField
    count: NDArray[np.int64]
    left_out: dict[int, str]
    excess: float
    course: Course | None = None


def steady_map(store: Store, indices: Sequence[int], uneven: float) -> SteadyMap | str:
    """The mean over frames; or why there is none. Frames that contradict the others do not count.

    ``uneven``: part of a pixel's variance that even pictures leave, in all frames alike where the model stands still.
    """
    values, noise = [], []
    for index in indices:
        field = _merged(store, index)
        own = sum((field.modes[:, k] ** 2 for k in _new(field)), np.zeros(len(field)))
        values.append(field.value)
        noise.append(field.white + own)
    done = average_frames(np.array(values), np.array(noise), free_light=False)
    if isinstance(done, NotFitted):
        return f"the frames contradict each other: {done.reason}"
    used = [i for i, u in zip(indices, done.used, strict=True) if u]
    names = tuple(dict.fromkeys(n for i in used for n in _lasting(_merged(store, i))))
    modes, count = np.zeros((len(done.value), len(names))), np.maximum(done.count, 1)
    for index in used:
        field = _merged(store, index)
        for name in _lasting(field):
            on = field.known
            modes[on, names.index(name)] += field.modes[on, field.names.index(name)] / count[on]
    known = done.count > 0
    single = done.variance * count
    variance = done.variance + uneven * np.maximum(single - done.variance, 0.0)
    out = NodeField(done.value, np.where(known, variance, 0.0), modes, names, "K")
    plain = np.sqrt(out.sigma**2 - out.white * (1 - 1 / max(done.excess, 1.0) ** 2))
    off = np.array(values)[done.used] - done.value
    course = _course(off, plain, done.excess) if done.excess > TIMES else None
    if course is not None:
        out = out.with_mode(COURSE, np.sqrt((np.nan_to_num(off) ** 2).sum(axis=0) / count))
    left = {i: why for i, why, u in zip(indices, done.reasons, done.used, strict=True) if not u}
    return SteadyMap(out, done.count, left, done.excess, course)


def _course(off: Array, sigma: Array, excess: float) -> Course | None:
    """Of frames less their mean (F, N); None where it is within the mean's sigma (N,), or no course.

    What goes up and down from frame to frame, a camera's level, is less in a mean: a course is not.
    """
    on = np.isfinite(off).all(axis=0)
    if not on.any():
        return None
    own = off[:, on]
    square = float((own**2).mean())
    size = float(np.median(np.sqrt((own**2).mean(axis=0))))
    if size <= float(np.median(sigma[on])):
        return None
    if len(own) > 3 and float((np.diff(own, axis=0) ** 2).sum()) > TURNS * len(own) * square * own.shape[1]:
        return None
    return Course(size, excess, float(np.median(own[-1] - own[0])))


def _merged(store: Store, index: int) -> NodeField:
    merged, _ = merged_temperature(store.temperatures(index))
    assert merged is not None
    field = merged.field
    return replace(field, value=np.where(field.known, field.value, np.nan))


def _new(field: NodeField) -> list[int]:
    return [k for k, n in enumerate(field.names) if n.startswith("registration")]


def _lasting(field: NodeField) -> list[str]:
    return [n for n in field.names if not n.startswith("registration")]
