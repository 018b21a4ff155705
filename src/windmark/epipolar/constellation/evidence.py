"""How much a matching of two pictures is worth against chance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.adjust import log_tail
from windmark.epipolar.constellation.patches import GROW_TOLERANCE, NOISE_PX, Neighbours

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

FREE = 8
"""Pairs that say nothing: three fix the affine map that a matching grows from, five the epipolar geometry."""
MISSING = 0.15
"""Part of the spots that have no partner though the model is right: hidden, or not found, or false."""
LEAST_CHANCE, MOST_CHANCE = 1e-6, 0.5


@dataclass(frozen=True)
class Evidence:
    """Worth of a matching: `log10_nfa` and `score` of `PairMatching`; which spots (A,) of a had a partner to expect."""

    log10_nfa: float
    score: float
    expected: Mask


def weigh(near: Neighbours, match: Ints, width_px: float, inside: Callable[[Array], Mask], tried: int) -> Evidence:
    """Evidence of a matching from the spots of a whose neighbours say where they should be in b.

    Parameters
    ----------
    near : the spots (ideal pixels)
    match : (A,) spot of b or -1
    width_px : how far from its epipolar line a spot may lie; inf where no line is known
    inside : which places (N, 2) of b's ideal pixels are in its picture
    tried : matchings that were compared
    """
    from windmark.epipolar.constellation import _kernels as kernels

    place = kernels.expectations(near.a, near.na, near.b, near.nb, match, GROW_TOLERANCE, NOISE_PX)
    expected = np.isfinite(place[:, 0])
    expected[expected] = inside(place[expected, :2])
    hit = expected & (match >= 0)
    trials, hits = int(expected.sum()), int(hit.sum())
    if hits <= FREE:
        return Evidence(float("inf"), 0.0, expected)
    reach = place[expected, 2]
    area = np.where(reach < width_px, np.pi * reach**2, np.minimum(4 * width_px * reach, np.pi * reach**2))
    chance = np.clip(area * _density(near), LEAST_CHANCE, MOST_CHANCE)
    tail = log_tail(hits - FREE, max(trials - FREE, 1), float(chance.mean()))
    nfa = (np.log(max(tried, 1)) + tail) / np.log(10)
    gain = np.where(hit[expected], np.log((1 - MISSING) / chance), np.log(MISSING / (1 - chance)))
    return Evidence(float(nfa), float(gain.sum()), expected)


def _density(near: Neighbours) -> float:
    """Spots of b per square pixel of ground where there are spots: median over the neighbourhoods."""
    far = np.linalg.norm(near.b[near.nb[:, -1]] - near.b, axis=1)
    return float(np.median(near.nb.shape[1] / (np.pi * np.maximum(far, 1e-9) ** 2)))
