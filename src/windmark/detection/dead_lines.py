"""Columns and rows of a sensor that do not measure: stuck at a level, or off by one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.detection.sharpest import sharpest_line, sharpest_pair

Pixels = NDArray[np.float32]

PIECE, MOST_SAMPLED, ENOUGH = 16, 512, 128
"""Pixels of a column of which a median is taken; of so many pixels a column, evenly spread over it; pixels of it that
tell whether it is the same as the next one.
"""
OFF, PIECES = 4.0, 4
"""Times the noise that a piece is off its neighbours; pieces one after another that make a line of it."""
LEAST_STEPS = 6.0
"""Steps of the grey levels that it is off at least: the light beside a line of paint is not rounded away."""
SIDES = 0.5
"""Part of that by which the two sides may differ."""
PART = 0.5
"""Of the least light beside a line that an optic has imaged: so many pixels are known that this costs nothing."""
AT_MOST = 0.5
"""Part of what a line is off that the columns beside may be of that, to be looked at: no blur allows more."""
MOST = 0.02
"""Part of the columns: more are how the picture was made."""


def dead_lines(
    g: Pixels, maybe: NDArray[np.int64], blur_px: float, step: float, ends: tuple[float, float]
) -> NDArray[np.int64]:
    """Columns of a picture g (H, W), alone or two together, that differ from their neighbours by more than noise while
    these do not differ from the next ones, as beside a line that an optic of ``blur_px`` has imaged they do.

    Less than `PART` of the least light beside such a line, by three sigma. The two outermost columns of each side are
    not looked at.

    Parameters
    ----------
    maybe : (K, 2) first columns of those that may be dead, and how many together, of `candidates`
    step : between grey levels
    ends : of the picture's levels
    """
    found = np.zeros(g.shape[1], bool)
    if not len(maybe) or not np.isfinite(blur_px):
        return np.flatnonzero(found)
    pieces, light = _pieces(g), {1: sharpest_line(blur_px), 2: sharpest_pair(blur_px)}
    for x, wide in maybe.tolist():
        part = pieces[:, :, x - 2 : x + wide + 2]
        if not found[x - 1 : x + wide + 1].any() and _is_dead(part, wide, step, light[wide], ends):
            found[x : x + wide] = True
    return np.flatnonzero(found) if found.sum() <= max(MOST * len(found), 2) else np.empty(0, np.int64)


def _pieces(g: Pixels) -> Pixels:
    """(P, `PIECE`, W) pixels of a picture's columns, one after another."""
    rows = g[:: max(1, -(-len(g) // MOST_SAMPLED))]
    return rows[: len(rows) // PIECE * PIECE].reshape(-1, PIECE, g.shape[1])


def repeated(g: Pixels) -> bool:
    """Whether pixels were repeated to enlarge a picture: columns are the same as the next ones, and no plain ones."""
    rows = g[:: max(1, -(-len(g) // ENOUGH))]
    plain = (rows[1:] == rows[:-1]).all(axis=0)[1:]
    return bool(((rows[:, 1:] == rows[:, :-1]).all(axis=0) & ~plain).sum() > MOST * g.shape[1])


def candidates(g: Pixels, step: float) -> NDArray[np.int64]:
    """(K, 2) first columns of those that may be dead, and how many together: means of pieces, which are soon made, are
    off those beside them, and these are not off the next ones by as much as half of that.
    """
    if g.shape[1] < 8 or len(pieces := _pieces(g)) < PIECES:
        return np.empty((0, 2), np.int64)
    mean = np.ascontiguousarray(pieces.mean(axis=1))
    out = []
    for wide in (1, 2):
        last = mean.shape[1] - 2 - wide
        left, right = mean[:, 1:last], mean[:, 2 + wide : last + wide + 1]
        excess = sum(mean[:, 2 + k : last + k + 1] for k in range(wide)) / wide - (left + right) / 2
        size = np.abs(excess)
        usual = np.maximum(np.median(size, axis=1, keepdims=True), step / PIECE)
        off = _run(size > OFF * usual)
        x = np.flatnonzero(off.any(axis=0))
        if len(x):
            at = np.where(off[:, x], excess[:, x], np.nan)
            far, near, other, away = (mean[:, x + k] for k in (0, 1, 2 + wide, 3 + wide))
            limits = ((near - far, AT_MOST), (other - away, AT_MOST), (other - near, SIDES))
            x = x[np.all([np.abs(_median(part / at)) < most for part, most in limits], axis=0)]
        out.append(np.stack([2 + x, np.full(len(x), wide)], axis=1))
    return np.concatenate(out)


def _median(a: Pixels) -> Pixels:
    """(W,) of the finite ones of (P, W): the middle of those in order, NaN come last."""
    count = np.isfinite(a).sum(axis=0)
    return np.asarray(np.sort(a, axis=0)[np.maximum(count - 1, 0) // 2, np.arange(a.shape[1])])


def _run(off: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Those (P, ...) of `PIECES` and more one after another."""
    out, last = np.zeros_like(off), len(off) - PIECES + 1
    if last < 1:
        return out
    runs = np.logical_and.reduce([off[k : k + last] for k in range(PIECES)])
    for k in range(PIECES):
        out[k : k + last] |= runs
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
