"""How much a labelling is worth: a log-likelihood ratio and a false-alarm number.

Both compare "the spots are images of the markers" with "the spots are where they are by chance", with the *local*
density of spots, because dust and rivets come in clusters. Spots come best first, and a detector may add hundreds
of doubtful ones behind the good ones; the evidence is therefore the best over prefixes of the list, charged with
the number of prefixes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import gammaln

from windmark.registration._plane import lead_sizes, local_density
from windmark.registration.task import Task

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

MIN_RADIUS_PX = 0.1
"""Residuals below this are luck, not evidence."""


@dataclass(frozen=True)
class Evidence:
    """Worth of a labelling.

    Parameters
    ----------
    score : log-likelihood ratio in nats: matched spots against chance, missing markers against the labelling
    log10_nfa : decimal logarithm of the expected number of labellings as good as this one by chance
    """

    score: float
    log10_nfa: float


def weigh(task: Task, detection: Ints, residuals: Array, cov: Array, expected: int) -> Evidence:
    """Evidence of K pairs.

    Parameters
    ----------
    detection : (K,) the spots
    residuals : (K, 2) projected - detected, pixels
    cov : (K, 2, 2) covariance of the residuals if the labelling is right
    expected : markers that should be seen, matched ones included
    """
    leads = lead_sizes(len(task.xy), len(task.markers))
    best = [_weigh_prefix(task, n, detection, residuals, cov, expected) for n in leads]
    return Evidence(
        max(score for score, _ in best) - float(np.log(len(leads))),
        min(nfa for _, nfa in best) + float(np.log10(len(leads))),
    )


def _weigh_prefix(
    task: Task, lead: int, detection: Ints, residuals: Array, cov: Array, expected: int
) -> tuple[float, float]:
    used = detection < lead
    if used.sum() < 3:
        return -np.inf, np.inf
    density = local_density(task.xy[:lead], task.camera)[detection[used]]
    r = residuals[used]
    score = _log_likelihood_ratio(r, cov[used], density, expected)
    return score, _log10_nfa(task, lead, np.linalg.norm(r, axis=1), density, expected)


def _log_likelihood_ratio(r: Array, cov: Array, density: Array, expected: int) -> float:
    """Gaussian misfit against local density, and the missing markers; the chance to see one is the solution's own."""
    count = len(r)
    p_seen = min(0.95, max(0.25, (count + 1.0) / (expected + 2.0)))
    distance2 = np.einsum("ki,ki->k", r, np.linalg.solve(cov, r[..., None])[..., 0])
    matched = np.log(p_seen / (2 * np.pi * np.sqrt(np.linalg.det(cov)) * density)) - 0.5 * distance2
    return float(matched.sum() + (expected - count) * np.log(1 - p_seen))


def _log10_nfa(task: Task, lead: int, distance: Array, density: Array, expected: int) -> float:
    """A-contrario false-alarm number (Desolneux, Moisan and Morel; Moisan, Moulon and Monasse 2012), base 10.

    A pose is fixed by s pairs (three; four with unknown focal length). Of all the ways to choose them, count those
    that would by chance have k - s more spots within the k-th smallest probability; the scale is not given but
    taken where this is smallest, for the price of having looked at every k.
    """
    s = 4 if task.free_focal else 3
    n = len(task.markers)
    if len(distance) <= s or lead < s:
        return np.inf
    chance = np.minimum(1.0, np.pi * np.maximum(distance, MIN_RADIUS_PX) ** 2 * density)
    log_chance = np.log(np.sort(chance))[s:]
    k = np.arange(s + 1, len(distance) + 1)
    tests = np.log(4.0) + _log_choose(n, s) + gammaln(lead + 1) - gammaln(lead - s + 1) + np.log(task.prior_share)
    nfa = tests + np.log(expected) + _log_choose(expected - s, k - s) + (k - s) * log_chance
    return float(nfa.min() / np.log(10))


def _log_choose(n: ArrayLike, k: ArrayLike) -> Array:
    return gammaln(np.add(n, 1)) - gammaln(np.add(k, 1)) - gammaln(np.subtract(n, k) + 1)
