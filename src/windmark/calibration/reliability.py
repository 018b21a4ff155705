"""How well the known markers of a network check each other, and what an error that goes unnoticed does.

With the covariance C of the adjusted network and the weights P = L^T L of what is known of its markers,
W = P - P C_kk P = L^T (1 - L C_kk L^T) L is the weight that is left in the residuals of the latter. An error d of one
known marker (a block b) gives the test of it (`agreement`) the non-centrality d^T W_bb d, and moves all markers by
C P_b d: internal and external reliability (Baarda 1968).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri, chndtrinc

from windmark.calibration.agreement import CHECKED, FALSE, Control, joint
from windmark.calibration.control import MOST, control_of
from windmark.calibration.datum import Weighted
from windmark.calibration.hardly_checked import Hardly
from windmark.calibration.setup import Job
from windmark.calibration.solve import Solved
from windmark.calibration.view_changes import NOTICED
from windmark.scene.marker_covariance import ROUNDING

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

WELL = 0.3
"""Share of the weight of an error that is left in residuals, from which it is called well checked (Foerstner 1979)."""
MATTERS = 6.0
"""Sigmas by which an error that goes unnoticed must besides move another marker to be said: none takes that for chance.
Of four in a square each has both, of six that are far apart none."""
LEAST = 4
"""Known markers from which this is asked; of three it is known what they do not check (`three_points`)."""


def hardly_checked(job: Job, solved: Solved, seen: Mask, sigma: Array) -> tuple[Hardly, ...]:
    """Known markers that the rest of an adjusted network hardly checks, the one whose error would do most first.

    ``seen`` (N,) are the markers that took part, and ``sigma`` (M, 3) those of the M of them in the adjusted network.
    Only what is known with sigmas (`Weighted`) is asked: markers that are held have none, and no weight to compare
    with. As many known markers as are not tested together are not asked either.
    """
    if not isinstance(job.datum, Weighted):
        return ()
    control = control_of(job, seen)
    if not LEAST <= len(control.point) <= MOST:
        return ()
    known = np.isfinite(control.sigma).ravel()
    white = _whitener(job, seen, control)
    every = np.flatnonzero(seen)
    own = (3 * np.searchsorted(every, control.point)[:, None] + np.arange(3)).ravel()
    slope = joint(solved, control.point, every) @ white.T
    # What a joint covariance says is exact (a survey's own datum) has no residual, but for rounding.
    sure = ((white * np.where(known, control.sigma.ravel(), 0.0)) ** 2).sum(axis=1) < 1 / (10 * ROUNDING)
    left = white[sure].T @ (np.eye(len(white)) - white @ slope[own])[np.ix_(sure, sure)] @ white[sure]
    moves = slope @ white
    found = []
    for b, point in enumerate(np.searchsorted(every, control.point).tolist()):
        rows = np.flatnonzero(known[3 * b : 3 * b + 3]) + 3 * b
        found.append(_of(point, rows, control, left, moves, sigma))
    poor = [h for h in found if h.share < WELL and h.times > MATTERS]
    return tuple(sorted(poor, key=lambda h: -h.times))


def _whitener(job: Job, seen: Mask, control: Control) -> Array:
    """(3K, 3K) whose square is the weights of what is known, zero of what is not."""
    out = np.diag(np.where(np.isfinite(control.sigma), 1 / control.sigma, 0.0).ravel())
    together = job.known_together(seen)
    if together is not None:
        own = (3 * np.searchsorted(control.point, together[0])[:, None] + np.arange(3)).ravel()
        out[np.ix_(own, own)] = together[1].whitener()
    return out


def _of(point: int, rows: Ints, control: Control, left: Array, moves: Array, sigma: Array) -> Hardly:
    """What the test of one known marker notices of its error along the direction in which the others check it least."""
    cov = control.cov[np.ix_(rows, rows)]
    root = np.linalg.cholesky(cov + ROUNDING * np.diag(cov.diagonal()))
    share, axes = np.linalg.eigh(root.T @ left[np.ix_(rows, rows)] @ root)
    least = max(float(share[0]), CHECKED)
    count = max(int((share > CHECKED).sum()), 1)
    smallest = chndtrinc(chdtri(count, FALSE / len(control)), count, 1 - NOTICED)
    error = root @ axes[:, 0] * np.sqrt(smallest / least)
    shift = np.abs(moves[:, rows] @ error).reshape(-1, 3)
    times = np.where(sigma > 0, shift / np.where(sigma > 0, sigma, 1.0), 0.0)
    times[point] = 0.0  # that a wrong place is wrong is no news: what matters is what it does to others
    marker, along = np.unravel_index(int(times.argmax()), times.shape)
    return Hardly(
        point, int(marker), "xyz"[int(rows[np.abs(error).argmax()]) % 3], least, float(np.linalg.norm(error)),
        float(np.linalg.norm(error / control.sigma.ravel()[rows])), float(shift[marker, along]),
        float(times[marker, along]),
    )  # fmt: skip
