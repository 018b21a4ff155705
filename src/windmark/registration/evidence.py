"""How much a labelling is worth: a log-likelihood ratio and a false-alarm number.

Both compare "the spots are images of the markers" with "the spots are where they are by chance", with the *local*
density of spots, because dust and rivets come in clusters. Spots come best first, and a detector may add hundreds
of doubtful ones behind the good ones; the evidence is therefore the best over prefixes of the list, charged with
the number of prefixes.

The false-alarm number is that of a-contrario methods (Desolneux, Moisan and Morel; Moisan, Moulon and Monasse 2012).
A pose is fixed by s pairs (three; four with unknown focal length). Of all the ways to choose them, count those that
would by chance have k - s more spots within the k-th smallest probability; the scale is not given but taken where
this is smallest, for the price of having looked at every k.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.registration._kernels.evidence import likelihood_ratio, log10_nfa
from windmark.registration.search.plane import Plane

Array = NDArray[np.float64]
Ints = NDArray[np.integer]


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


def weigh(plane: Plane, detection: Ints, residual: Array, spread: Array, expected: int) -> Evidence:
    """Evidence of K pairs.

    Parameters
    ----------
    detection : (K,) the spots
    residual : (K, 2) projected - detected, pixels of the search plane
    spread : (K, 3) xx, xy, yy of its covariance if the labelling is right
    expected : markers that should be seen, matched ones included
    """
    fixed = 4 if plane.task.free_focal else 3
    log_share = float(np.log(plane.task.prior_share))
    score, nfa = -np.inf, np.inf
    for lead in plane.leads:
        used = np.flatnonzero(detection < lead)
        if len(used) < 3:
            continue
        r, density = residual[used], plane.picture(lead).density[detection[used]]
        score = max(score, likelihood_ratio(r, spread[used], density, expected))
        share = log_share + plane.task.log_label_share(lead, fixed)
        nfa = min(nfa, log10_nfa(r, density, expected, len(plane.task.markers), lead, fixed, share))
    return Evidence(score - float(np.log(len(plane.leads))), nfa + float(np.log10(len(plane.leads))))
