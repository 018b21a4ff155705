"""Whether a homography explains pairs, all or but a few: points on a plane give no fundamental matrix."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from windmark.geometry.two_view.homography import fit_homography, transfer

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Ints = NDArray[np.int64]

LEVEL = 1e-3
"""Probability that a true plane is not seen as one."""
SMALL = 14
"""Up to so many pairs, every way to leave some off a plane is tried."""
OFF_PLANE = 3
"""Two points off a plane give the epipole of its homography, whatever they are; a third one checks it."""


def off_plane(a: Array, b: Array, kept: Mask, sigma: float) -> list[int] | None:
    """Pairs off a plane that holds all others, fewer than `OFF_PLANE`; None where there is no such plane."""
    rows = np.flatnonzero(kept)
    for count in range(OFF_PLANE):
        for out in combinations(range(len(rows)), count) if len(rows) <= SMALL else _worst(a, b, rows, count):
            if len(rows) - count >= 5 and _on_plane(a, b, np.delete(rows, out), sigma):
                return [int(k) for k in rows[list(out)]]
    return None


def _worst(a: Array, b: Array, rows: Ints, count: int) -> list[tuple[int, ...]]:
    """The pairs that homographies of the others say least of, taken out one after the other."""
    out: list[int] = []
    for _ in range(count):
        rest = [k for k in range(len(rows)) if k not in out]
        h = fit_homography(a[rows[rest]], b[rows[rest]])
        if h is None:
            return []
        off = ((transfer(h, a[rows[rest]]) - b[rows[rest]]) ** 2).sum(axis=1)
        out.append(rest[int(off.argmax())])
    return [tuple(out)]


def _on_plane(a: Array, b: Array, on: Ints, sigma: float) -> bool:
    h, back = fit_homography(a[on], b[on]), fit_homography(b[on], a[on])
    if h is None or back is None:
        return False
    ahead, behind = ((transfer(m, x) - y) ** 2 for m, x, y in ((h, a[on], b[on]), (back, b[on], a[on])))
    square = np.minimum(ahead.sum(axis=1), behind.sum(axis=1)) / (2 * sigma**2)  # noise of both pictures
    limit = chdtri(2, LEVEL / len(on))
    return bool(square.sum() <= chdtri(2 * len(on) - 8, LEVEL) and (square <= limit).all())


def on_line(p: Array, sigma: float) -> bool:
    """Whether points (N, 2) of a picture are on a line, to their noise."""
    return bool(np.linalg.svd(p - p.mean(axis=0), compute_uv=False)[1] <= 3 * sigma * np.sqrt(len(p)))
