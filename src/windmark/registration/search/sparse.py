"""The exhaustive search for few spots (`_kernels.sparse`): which spots and markers are taken, and what is kept."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from windmark.registration._kernels.best import Best, room_for_best
from windmark.registration._kernels.growth import Gates
from windmark.registration._kernels.hypothesis import Rules
from windmark.registration._kernels.match import GROWTH
from windmark.registration._kernels.sparse import sparse_kernel
from windmark.registration.budget import LINK, SPARSE, Budget
from windmark.registration.search.plane import Plane
from windmark.registration.search.triplets import turns_of

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

PRIOR_SLACK = float(np.radians(5.0))
"""Three spots alone may put the pose so far beyond the prior's angle; what all of them say is checked later."""
KEPT = 12
"""Solutions kept: those that come near the best one are its rivals."""


def sparse(plane: Plane, rules: Rules, gates: Gates, focals: Array, budget: Budget) -> Iterator[tuple[Best, int]]:
    """The best solutions so far and the links of each round: of as many triplets of spots as one must have no false.

    Where labels are fixed a solution may have or contradict them, so both kinds are looked for.
    """
    task = plane.task
    picture, least = plane.picture(len(task.xy)), task.least_explained
    gates = gates._replace(least=least, least_part=0.0)
    if task.prior is not None:
        rules = rules._replace(prior_cosine=float(np.cos(min(task.prior_max_angle_rad + PRIOR_SLACK, np.pi))))
    triplets = np.array(list(combinations(range(len(task.markers)), 3)), dtype=np.int32)
    turns = turns_of(plane.model, triplets)
    free, bound = np.full(len(task.xy), -1, np.int32), np.full(len(task.xy), -1, np.int32)
    for spot, marker in task.fixed:
        bound[spot] = marker
    for corners in wide_triplets(picture.p, len(task.xy) - least + 1):
        for only in (bound, free) if task.fixed else (free,):
            found, price = room_for_best(KEPT, len(task.markers)), np.zeros(KEPT)
            links, grown = sparse_kernel(
                plane.model, picture, rules, gates, focals, corners, triplets, turns, only, found, price
            )
            budget.spend(SPARSE * links + LINK * GROWTH * grown * len(task.markers))
            # As an ordinary search score: the likelihood of the best, and behind it the others by how far they are.
            if found.score.max() > -np.inf:
                found.score[:] -= price[found.score.argmax()]
            yield found, int(links)


def wide_triplets(p: Array, count: int) -> Ints:
    """(count, 3) of the spots (M, 2), none in two of them, widest first."""
    triplets = np.array(list(combinations(range(len(p)), 3)), dtype=np.int32)
    one, two = p[triplets[:, 1]] - p[triplets[:, 0]], p[triplets[:, 2]] - p[triplets[:, 0]]
    area = np.abs(one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0])
    chosen: list[Ints] = []
    for n in np.argsort(-area, kind="stable"):
        if len(chosen) < count and not np.isin(triplets[n], chosen).any():
            chosen.append(triplets[n])
    return np.array(chosen, dtype=np.int32)
