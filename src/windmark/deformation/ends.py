"""Where laws end: parameters for which they have no place for a marker, as they raise or give no numbers there.

A search may step beyond such an end and come back, so it is no error of the step; where the search ends there, the
state lies beyond, and what the law said is the reason.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from windmark.deformation.law import LawError
from windmark.deformation.volumes import Placed
from windmark.errors import g3

NO_PLACE = "a law has no place for this state"
"""Stands in every refusal for that reason."""

Array = NDArray[np.float64]
Evaluated = TypeVar("Evaluated", Array, tuple[Array, Array])


def tried(placed: Placed, q: Array, evaluate: Callable[[Array], Evaluated]) -> Evaluated | None:
    """What ``placed.place`` or ``placed.linearise`` gives; None where there is no place, which ``placed`` keeps."""
    try:
        out = evaluate(q)
    except LawError:
        out = None
    if out is not None and np.isfinite(out[0] if isinstance(out, tuple) else out).all():
        return out
    placed.beyond[:] = [q.copy()]
    return None


def end_words(placed: Placed) -> str:
    """What the laws said where they had no place last; "" where they always had one."""
    for q in placed.beyond:
        for index, chain in placed.groups:
            name, why = str(placed.names[index[0]]), ""
            try:
                there = chain.place(q)
            except LawError as error:
                why = str(error)
            else:
                lost = ~np.isfinite(there).all(axis=1)
                if lost.any():
                    why = f"law of {name} gives no numbers for {int(lost.sum())} of its {lost.size} markers"
            if why:
                columns = sorted({k for s in chain.columns for k in range(*s.indices(len(q)))})
                values = ", ".join(f"{placed.volumes.names[k]} = {_value(placed, k, q[k])}" for k in columns)
                return f"{why} at {values}"
    return ""


def _value(placed: Placed, k: int, value: float) -> str:
    return f"{g3(value)} {placed.volumes.parameters[k].unit}".rstrip()
