"""Which candidates may be discs after all, as their first fits say: only those are worth the dear fits.

Where markers are looked for, most of what touches something, and most of what does not look like the frame's noise, is
no disc: letters, corners, pieces of lines. To part it from what it touches, to try a line across it and to weigh its
pixels takes several times as long as all first fits together, and would not make a disc of it. What dirt, a line or a
neighbour does to a disc's first fit is limited: the disc still explains most of its window, or most of its edge is
there. The limits lie well below what decides about markers (`decide_fits`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.detection.template.fit import Fitted
from windmark.detection.template.request import Scene
from windmark.detection.template.result import Frame, columns
from windmark.detection.template.rim import rim_support

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

LEAST, ENOUGH = 0.5, 0.8  # correlation of disc and window: of any marker, and where the edge is not asked for
EDGE = 0.6  # of it must be there in most sectors, as of all markers
SIGMAS = 6.0  # of the matched filter; markers have at least 8


def may_be_discs(done: Fitted, expected: Array) -> Bools:
    """Fits (K,) whose disc explains a part of its window and rises from noise of the expected variances (K,)."""
    signal = done.column("signal")
    with np.errstate(divide="ignore", invalid="ignore"):
        explains = signal >= LEAST**2 * (signal + done.column("cost"))
        return np.asarray(explains & (done.params[:, 6] > 0.0) & ~(signal < SIGMAS**2 * expected))


def have_edges(scene: Scene, place: Array, done: Fitted, expected: Array, frame: Frame) -> Bools:
    """Fits (K,) at places (K, 2) with most of a disc's edge, or that explain most of their window anyway."""
    none, cov = np.zeros(len(place), dtype=np.int64), done.cov[:, :2, :2]
    fits = columns(
        scene, place, done, cov=cov, white=cov, chi2=np.full(len(place), np.nan), flags=none, crossed=none > 0,
        frame=frame,
    )  # fmt: skip
    good, unsure = fits.correlation >= ENOUGH, np.flatnonzero(~(fits.correlation >= ENOUGH))
    good[unsure] = rim_support(scene, fits.take(unsure), expected[unsure])[:, 1] >= EDGE
    return np.asarray(good)
