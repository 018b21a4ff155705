"""How far a law goes on both sides of its start: where it ends, and where it jumps, within what is said of it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from windmark.deformation.law import LawError
from windmark.deformation.parameter import Parameter
from windmark.errors import g3

Array = NDArray[np.float64]
Place = Callable[[float], Array]

SAMPLES = 64
"""Values tried of a parameter on each side of its start."""
SIGMAS, FAR = 3.0, 5.0
"""Where no bound is stated a parameter is tried so far, by its sigma; and so many times the change that matters."""
SPIKE = 10.0
"""A second difference so many times the usual one is looked into; a smooth law has none, one that jumps has."""
LEAST = 1e-6
"""Of the points' extent: smaller steps do no harm."""
HALVINGS, LEFT = 24, 0.02
"""A step that a law takes unevenly is halved so many times. What is uneven then is less than this part of what was
where the law has a kink or rises like a root; where it jumps, it is the jump."""


def ends_and_jumps(place: Place, parameter: Parameter, change: float, extent: float) -> tuple[list[str], float | None]:
    """What is to be said of a law where one parameter goes from its start to both sides, the others at theirs.

    Parameters
    ----------
    place : value -> (N, 3) points; may raise `LawError`, or give no numbers
    parameter : the parameter, with its bounds and sigma
    change : of the parameter that moves the points by as much as matters
    extent : of the points

    Returns
    -------
    list of str
        Where it ends on a side, and why.
    float or None
        Where it jumps.
    """
    remarks = []
    for side in (1.0, -1.0):
        bound = parameter.upper if side > 0 else parameter.lower
        known = SIGMAS * parameter.sigma if np.isfinite(parameter.sigma) else 0.0
        room = abs(bound - parameter.start)
        reach = room if np.isfinite(room) else max(FAR * abs(change), known)
        if reach == 0:
            continue
        values = parameter.start + side * reach * np.linspace(0.0, 1.0, SAMPLES + 1)
        there, why = _until(place, values)
        if len(there) < len(values):
            end = _end(place, values[len(there) - 1], values[len(there)])
            remarks.append(f"has no place beyond {parameter.name} = {g3(end)} {parameter.unit}".rstrip() + f" ({why}): "
                           "frames there are lost; " + _advice(parameter, bound, side))  # fmt: skip
        if (jump := _jump(place, values, there, extent)) is not None:
            return remarks, jump
    return remarks, None


def uneven(values: Callable[[float], float]) -> tuple[float, bool]:
    """Where in 0..1 a number moves least evenly, and whether it jumps there.

    What the middle of an interval is off from the mean of its ends: half by half it is followed where it is largest,
    and becomes nothing at a kink or the foot of a root, not at a jump.
    """
    low, width, off = 0.0, 1.0, []
    five = [values(k / 4) for k in range(5)]
    for _ in range(HALVINGS):
        off.append(abs(five[0] - 2.0 * five[2] + five[4]))
        halves = five[:3], five[2:]
        one, two = (abs(a - 2.0 * b + c) for a, b, c in halves)
        low, width = low + (0.5 * width if two > one else 0.0), 0.5 * width
        first, middle, last = halves[two > one]
        five = [first, values(low + 0.25 * width), middle, values(low + 0.75 * width), last]
    return low, off[-1] > LEFT * max(off)


def _tried(place: Place, value: float) -> Array | str:
    """The points; or why there are none."""
    try:
        out = place(value)
    except LawError as error:
        return str(error)
    return out if np.isfinite(out).all() else "it gives no numbers there"


def _until(place: Place, values: Array) -> tuple[list[Array], str]:
    there: list[Array] = []
    for value in values.tolist():
        found = _tried(place, value)
        if isinstance(found, str):
            return there, found
        there.append(found)
    return there, ""


def _end(place: Place, good: float, bad: float) -> float:
    for _ in range(HALVINGS):
        middle = 0.5 * (good + bad)
        good, bad = (good, middle) if isinstance(_tried(place, middle), str) else (middle, bad)
    return good


def _jump(place: Place, values: Array, there: list[Array], extent: float) -> float | None:
    if len(there) < 4:
        return None
    second = np.abs(np.diff(there, 2, axis=0))
    largest = second.reshape(len(second), -1).max(axis=1)
    usual = max(float(np.median(largest)), LEAST * extent)
    for k in np.flatnonzero(largest > SPIKE * usual).tolist():
        at = np.unravel_index(int(second[k].argmax()), second[k].shape)
        low, width = float(values[k]), float(values[k + 2] - values[k])

        def moved(part: float, low: float = low, width: float = width, at: tuple[np.intp, ...] = at) -> float:
            return float(place(low + part * width)[at])

        part, jumps = uneven(moved)
        if jumps:
            return low + part * width
    return None


def _advice(parameter: Parameter, bound: float, side: float) -> str:
    name = "upper" if side > 0 else "lower"
    if np.isfinite(bound):
        return f"its stated bound is {name} = {g3(bound)}"
    return f"state a bound ({name}) where the model cannot go further"
