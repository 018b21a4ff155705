"""The mean of all frames of a run without heating: a steady temperature, with what the frames scatter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark.paint import NodeField, NotFitted, average_frames
from windmark.pipeline.infrared.store import Store
from windmark.tasks.infrared import merged_temperature

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SteadyMap:
    """Mean temperature.

    Parameters
    ----------
    field : (V) kelvin; causes that last over the run are modes, noise falls with the number of frames
    count : (V,) frames that show each node
    left_out : index of a frame -> why it does not count
    excess : by which the frames scatter more than their noise says, as a factor; in the noise where it is above 1
    """

    field: NodeField
    count: NDArray[np.int64]
    left_out: dict[int, str]
    excess: float


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
    left = {i: why for i, why, u in zip(indices, done.reasons, done.used, strict=True) if not u}
    return SteadyMap(out, done.count, left, done.excess)


def _merged(store: Store, index: int) -> NodeField:
    merged, _ = merged_temperature(store.temperatures(index))
    assert merged is not None
    field = merged.field
    return replace(field, value=np.where(field.known, field.value, np.nan))


def _new(field: NodeField) -> list[int]:
    return [k for k, n in enumerate(field.names) if n.startswith("registration")]


def _lasting(field: NodeField) -> list[str]:
    return [n for n in field.names if not n.startswith("registration")]
