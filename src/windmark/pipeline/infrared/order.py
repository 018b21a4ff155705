"""Pictures that stand in each other's place: a history that goes to a later frame's temperatures and back."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from windmark.pipeline.infrared.jumps import ASKED
from windmark.pipeline.infrared.load import InfraredRun
from windmark.pipeline.infrared.store import Store

Array = NDArray[np.float64]

AWAY, HOME = 5.0, 2.0
"""Times the usual distance of a frame from those beside it that one is which does not belong there, and at most that of
one which does."""
MOST = 40
"""Frames that are tried in each other's place: of more it is no exchange."""


def exchanged(run: InfraredRun, store: Store, frames: Sequence[int]) -> str:
    """What is to be said where pictures of a camera are exchanged; "" where none are.

    Heat flux is made of changes of temperature: the first of two such pictures is a pulse of heat, the second one of
    cooling, and neither has a larger sigma.
    """
    if run.project.heat is None:
        return ""
    said = []
    for camera in store.cameras:
        pairs = exchanged_of([store.values(i, camera, ASKED) for i in frames])
        if pairs:
            keys = [[run.timeline.frames[frames[k]].key for k in pair] for pair in pairs]
            said.append(f"{camera}: " + ", ".join(f"{a} and {b}" for a, b in keys))
    if not said:
        return ""
    return (f"pictures stand in each other's place, each fits the frames beside the other: {'; '.join(said)}. "
            "Heat flux from the first of them on is wrong: name the files in the order they were taken in")  # fmt: skip


def exchanged_of(values: Sequence[Array | None]) -> list[tuple[int, int]]:
    """Pairs of frames that fit each other's place in a history of F frames and not their own.

    A frame fits where it lies between its neighbours, at whatever part of the way: so does one where the heating begins
    or goes on faster. A single hot frame, and histories that go up and down, fit no better elsewhere.

    Parameters
    ----------
    values : (N,) of each frame, NaN where unknown; None where the camera has no picture
    """
    own, out = list(values), []
    off = np.array([_beside(own, k) for k in range(len(own))])
    if not np.isfinite(off).any():
        return []
    usual = float(np.nanmedian(off))
    while 2 <= len(odd := np.flatnonzero(off > AWAY * usual).tolist()) <= MOST:
        better = {pair: gain for pair in combinations(odd, 2) if (gain := _gain(own, off, pair, usual)) > 0}
        if not better:
            break
        a, b = max(better, key=lambda pair: better[pair])
        own[a], own[b] = own[b], own[a]
        for k in {k for c in (a, b) for k in range(c - 1, c + 2) if 0 <= k < len(own)}:
            off[k] = _beside(own, k)
        out.append((a, b))
    return sorted(out)


def _gain(own: Sequence[Array | None], off: Array, pair: tuple[int, int], usual: float) -> float:
    """By how much frames lie nearer to their neighbours with two of them exchanged; 0 where these do not fit there."""
    there = list(own)
    a, b = pair
    there[a], there[b] = own[b], own[a]
    if not all(_beside(there, k) <= HOME * usual for k in pair):
        return 0.0
    near = sorted({k for c in pair for k in range(c - 1, c + 2) if 0 <= k < len(own)})
    return float(np.nansum(off[near]) - np.nansum([_beside(there, k) for k in near]))


def _beside(values: Sequence[Array | None], k: int) -> float:
    """Distance of frame k, of a typical node, from the straight line between the frames beside it; NaN without them."""
    three = [values[j] for j in (k - 1, k, k + 1) if 0 <= j < len(values)]
    if len(three) < 3 or any(v is None for v in three):
        return float("nan")
    before, now, after = np.array(three)
    on = np.isfinite(before) & np.isfinite(now) & np.isfinite(after)
    if not on.any():
        return float("nan")
    way, own = (after - before)[on], (now - before)[on]
    part = float(np.clip(own @ way / max(float(way @ way), 1e-300), 0.0, 1.0))
    return float(np.median(np.abs(own - part * way)))
