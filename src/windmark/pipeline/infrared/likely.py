"""The unit of a camera's temperatures, by what it looks at: model and surroundings, before anything is heated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from windmark.io import FileError
from windmark.pipeline.deform.pictures import read
from windmark.pipeline.infrared.load import InfraredRun
from windmark.pipeline.psp.stream import TEMPERATURE

FAR_K, NEAR = 100.0, 0.1
"""A picture whose middle is so far from the surroundings' temperature is in another unit if it is nearer by such a part
in that: kelvin and degrees Celsius are 273 K apart, and few models that a run heats are so far from their tunnel."""


@dataclass(frozen=True)
class OddUnit:
    """A camera whose numbers, in the ``unit`` that is said, are ``kelvin``, and in the ``other`` one ``other_K``."""

    camera: str
    unit: str
    kelvin: float
    other: str
    other_K: float


def likely_unit_of(number: float, unit: str, surroundings_K: float) -> tuple[float, str, float] | None:
    """Kelvin of a number in its unit, another unit and kelvin in that; None where the unit may be true."""
    there = {u: factor * number + offset for u, (factor, offset) in TEMPERATURE.items()}
    off = abs(there[unit] - surroundings_K)
    other = min(there, key=lambda u: abs(there[u] - surroundings_K))
    if off < FAR_K or abs(there[other] - surroundings_K) > NEAR * off:
        return None
    return there[unit], other, there[other]


def odd_units(run: InfraredRun) -> list[OddUnit]:
    """Cameras whose temperatures are rather in another unit, by the middle of their first picture that can be read."""
    out = []
    for entry in run.project.camera:
        if entry.quantity != "temperature":
            continue
        station = run.deforming.test.station(entry.name)
        for frame in run.timeline.frames:
            if entry.name not in frame.images:
                continue
            try:
                picture = read(frame.images[entry.name], station)
            except FileError:
                continue
            number = entry.offset + entry.scale * float(np.nanmedian(np.asarray(picture, dtype=float)))
            if (found := likely_unit_of(number, entry.unit, run.project.surface.surroundings_K)) is not None:
                out.append(OddUnit(entry.name, entry.unit, *found))
            break
    return out
