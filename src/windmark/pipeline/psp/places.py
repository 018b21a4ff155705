"""Results of a paint test at listed places on the model: Cp, pressure, temperature and ratio, each with its sigma."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from windmark.pipeline.points import PointSet, places, without_value
from windmark.scene import Mesh
from windmark.tasks.psp import EITHER_SIDE, OFF_GRID, UNSEEN, ReducedPoint, field_at

NO_PLACE = "its place is not given"
FILLED = "filled from its surroundings"
"""Why a place has no value; and what is to be said of one."""
FIELDS = {"cp": "", "pressure": "_Pa", "temperature": "_K", "ratio": ""}
"""Of `ReducedPoint`, with the ending of their columns."""


def without_places(sets: Sequence[PointSet], rest: Mesh, reduced: ReducedPoint) -> list[str]:
    """What is to be said of lists that have no Cp at any of their places, by what most of them lack."""
    out = []
    for of in sets:
        columns = place_columns(of, rest, reduced)
        if not of.far.all() and not np.isfinite(columns["cp"]).any():
            words, count = np.unique(columns["remark"], return_counts=True)
            out.append(without_value(of, f"{words[count.argmax()]}"))
    return out


def place_columns(of: PointSet, rest: Mesh, reduced: ReducedPoint) -> dict[str, NDArray]:
    """Columns of a point's file: places as asked for and on the grid at rest, values, and what is to be said of each.

    A place counts where all nodes of its triangle have a value, and its sigma holds by how much the field bends
    between them, as at taps (see `tasks.psp.field_at`).
    """
    surface = of.surface
    off = surface.triangle < 0
    nodes, weights = surface.corners(rest)
    seen = ~off & ~surface.either_side & reduced.cp.known[nodes].all(axis=1)
    out = places(of)
    for name, ending in FIELDS.items():
        field = getattr(reduced, name)
        there = field_at(rest, field, reduced.filled, of.asked[seen], (nodes[seen], weights[seen]))
        for what, values in ((f"{name}{ending}", there.value), (f"sigma_{name}{ending}", there.sigma)):
            out[what] = np.full(len(off), np.nan)
            out[what][seen] = values
    filled = seen & ((weights > 0) & reduced.filled[nodes]).any(axis=1)
    lost = ~np.isfinite(of.asked).all(axis=1)
    masks = [lost, off, surface.either_side, ~seen, filled]
    said = np.select(masks, [NO_PLACE, OFF_GRID, EITHER_SIDE, UNSEEN, FILLED], default="")
    return {**out, "remark": np.asarray(said, dtype=np.str_)}
