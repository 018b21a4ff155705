"""Known distances that nothing else in a network checks, and what their errors would do.

Where two scale bars differ in length but not in sigma the long one gives the scale, and its error is one of all
lengths: of the share of its weight that is left in its residual, 1 - s^2 / sigma^2 with s its sigma in the adjusted
network, hardly anything is (Baarda 1968, as in `reliability`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri, chndtrinc

from windmark.calibration.agreement import CHECKED, FALSE, joint
from windmark.calibration.datum import Fixed, Weighted
from windmark.calibration.hardly_checked import HardlyBar
from windmark.calibration.reliability import MATTERS, WELL
from windmark.calibration.setup import Job, bars_of
from windmark.calibration.solve import Solved
from windmark.calibration.view_changes import NOTICED

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def hardly_checked_bars(job: Job, solved: Solved, seen: Mask, sigma: Array) -> tuple[HardlyBar, ...]:
    """Known distances that the rest of an adjusted network hardly checks, the one whose error would do most first.

    ``seen`` (N,) are the markers that took part, and ``sigma`` (M, 3) those of the M of them in the adjusted network.
    Held markers hold the scale without any sigma; of a free network's only distance it is known that all lengths are in
    proportion to it.
    """
    bars = bars_of(job)
    count = len(job.distances) + int(isinstance(job.datum, Weighted))
    if isinstance(job.datum, Fixed) or not len(job.distances) or count < 2:
        return ()
    ends = np.unique(np.r_[bars.first, bars.second])
    every, xyz = np.flatnonzero(seen), solved.state.points
    cov = joint(solved, ends, every).reshape(len(every), 3, len(ends), 3)
    out = xyz[every] - xyz[every].mean(axis=0)
    smallest = chndtrinc(chdtri(1, FALSE / len(job.distances)), 1, 1 - NOTICED)
    found = []
    for n, d in enumerate(job.distances):
        a, b = bars.first[n], bars.second[n]
        if not (seen[a] and seen[b]):
            continue
        along = (xyz[a] - xyz[b]) / np.linalg.norm(xyz[a] - xyz[b])
        moved = (cov[:, :, np.searchsorted(ends, a)] - cov[:, :, np.searchsorted(ends, b)]) @ along
        at, to = np.searchsorted(every, [a, b])
        share = max(1.0 - float((moved[at] - moved[to]) @ along) / d.sigma**2, CHECKED)
        error = d.sigma * float(np.sqrt(smallest / share))
        scale = error / d.sigma**2 * float((moved * out).sum() / (out**2).sum())
        times = np.abs(scale * out) / np.where(sigma > 0, sigma, np.inf)
        if share < WELL and times.max() > MATTERS:
            found.append(HardlyBar(d.first, d.second, share, error, error / d.sigma, abs(scale)))
    return tuple(sorted(found, key=lambda h: -h.scale))
