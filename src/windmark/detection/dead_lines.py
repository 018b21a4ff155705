"""Columns and rows of a sensor that do not measure: stuck at a level, or off by one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.detection.sharpest import sharpest_line, sharpest_pair

Pixels = NDArray[np.float32]

PIECE, MOST_SAMPLED = 16, 512
"""Pixels of a column of which a median is taken; of so many pixels a column, evenly spread over it."""
OFF, PIECES = 4.0, 4
"""Times the noise that a piece is off its neighbours; pieces one after another that make a line of it."""
LEAST_STEPS = 6.0
"""Steps of the grey levels that it is off at least: the light beside a line of paint is not rounded away."""
SIDES = 0.5
"""Part of that by which the two sides may differ."""
PART = 0.5
"""Of the least light beside a line that an optic has imaged: so many pixels are known that this costs nothing."""
MOST = 0.02
"""Part of the columns: more are how the picture was made."""


def dead_lines(g: Pixels, blur_px: float, step: float) -> NDArray[np.bool_]:
    """(W,) columns of a picture g (H, W), alone or two together, that differ from their neighbours by more than noise
    while these do not differ from the next ones, as beside a line that an optic of ``blur_px`` has imaged they do.

    ``step``: between grey levels. Less than `PART` of the least light beside such a line, by three sigma. The two
    outermost columns of each side are not looked at.
    """
    rows = g[:: max(1, -(-len(g) // MOST_SAMPLED))]
    found = np.zeros(g.shape[1], bool)
    if len(rows) < PIECES * PIECE or g.shape[1] < 8 or not np.isfinite(blur_px):
        return found
    pieces = rows[: len(rows) // PIECE * PIECE].reshape(-1, PIECE, g.shape[1])
    ends = float(np.fmin.reduce(g, axis=None)), float(np.fmax.reduce(g, axis=None))
    for wide, light in ((1, sharpest_line(blur_px)), (2, sharpest_pair(blur_px))):
        for x in _candidates(pieces, wide, step):
            part = pieces[:, :, x - 2 : x + wide + 2]
            if not found[x - 1 : x + wide + 1].any() and _is_dead(part, wide, step, light, ends):
                found[x : x + wide] = True
    return found if found.sum() <= max(MOST * len(found), 2) else np.zeros_like(found)


def _candidates(pieces: Pixels, wide: int, step: float) -> NDArray[np.int64]:
    """First columns of those, ``wide`` together, that may be off, by means of which some are soon made."""
    mean = pieces.mean(axis=1)
    last = mean.shape[1] - 2 - wide
    mine = sum(mean[:, 2 + k : last + k + 1] for k in range(wide)) / wide
    excess = np.abs(mine - (mean[:, 1:last] + mean[:, 2 + wide : last + wide + 1]) / 2)
    usual = np.maximum(np.median(excess, axis=1, keepdims=True), step / PIECE)
    return 2 + np.flatnonzero(_run(excess > OFF * usual).any(axis=0))


def _run(off: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Those (P, ...) of `PIECES` and more one after another."""
    out = np.zeros_like(off)
    for first in range(len(off) - PIECES + 1):
        out[first : first + PIECES] |= off[first : first + PIECES].all(axis=0)
    return out


def _is_dead(part: Pixels, wide: int, step: float, light: float, ends: tuple[float, float]) -> bool:
    """Whether columns in the middle of a part (P, `PIECE`, wide + 4) are off, and those beside them are not; of these,
    what is at the ``ends`` of the picture's levels says nothing.
    """
    far, left, right, away = (part[..., k].astype(float) for k in (0, 1, wide + 2, wide + 3))
    excess = part[..., 2 : 2 + wide].mean(axis=-1) - (left + right) / 2
    size = np.median(excess, axis=1, keepdims=True)
    scatter = np.median(np.abs(excess - size), axis=1, keepdims=True) / 0.6745
    off = _run(np.abs(size) > np.maximum(OFF * scatter, LEAST_STEPS * step))[:, 0]
    if not off.any():
        return False
    size = size[off]
    if abs(np.median((right - left)[off] / size)) > SIDES:  # a step of light; or it is the next ones that are dead
        return False
    tells = ((np.minimum(left, right) > ends[0]) & (np.maximum(left, right) < ends[1]))[off]
    if tells.sum() < PIECE:
        return False
    for beside in (left - far, right - away):  # each side by itself: of two lines that are near, one may hide the other
        share = (beside[off] / size)[tells]
        middle = float(np.median(share))
        sigma = 1.25 * float(np.median(np.abs(share - middle))) / 0.6745 / np.sqrt(len(share))
        if not abs(middle) + 3 * sigma < PART * light:
            return False
    return True
