"""What the search of one camera tries: quads, the paper's triplets, those round a label, few spots in full."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.registration._kernels.growth import Gates
from windmark.registration._kernels.hypothesis import Picture, Rules
from windmark.registration._kernels.match import Links
from windmark.registration.budget import LINK, TRIPLET, Budget
from windmark.registration.search import links
from windmark.registration.search.layout import REACHES
from windmark.registration.search.plane import Plane
from windmark.registration.search.pool import Pool

Ints = NDArray[np.int32]

STAGES = ((REACHES[0], 0, 5), (REACHES[0], 5, 8), (REACHES[1], 0, 8), (REACHES[1], 8, 12))
"""Table, and the neighbours of a spot that its quads are taken from (not all of them among the first number)."""
FAR_STAGES = ((16, 0, 12), (16, 12, 16))
"""Where two of three markers are hidden, four neighbouring spots are far apart on the model (the second one: in all
cameras of a rig but one) ..."""
FAR_MARKERS = 80
"""... with more markers than this the table of such quads would be too large, and enough near ones are seen."""
CHECKS = (0.2, 0.5)
"""The anchor of a quad must lie within this part of the tolerance. With the first, all quads take half the time, and
hardly a right one is lost but on a deformed model or with a rough table: then all are tried with the second."""
TRIPLET_STAGES = ((4, 4), (4, 6), (6, 8), (8, 12), (14, 20), (24, 32))
"""Neighbours that a marker triplet and a spot triplet are taken from."""
HEADED_STAGE = (10, 14)
"""The same for triplets that are headed by a labelled marker."""
WORK = 20_000
"""Links after which the caller is asked whether to go on."""
PRIOR_SLACK = float(np.radians(5.0))
"""What starts so far beyond the prior's angle may grow into it."""


@dataclass(frozen=True, eq=False)
class Trial:
    """Links to be tried in a picture by some rules, what a link costs, and the pool for what they become."""

    picture: Picture
    links: Links
    rules: Rules
    gates: Gates
    price: float
    pool: Pool


class Trials:
    """What there is to try of a task.

    Parameters
    ----------
    plane : task and search plane
    method : see `register`
    wide : neighbourhoods may look weak, and quads may reach far: for a rig's cameras
    seed : of the order of the paper's triplets
    budget : of the whole registration
    free, bound : pools for what is found with any labels, and from the fixed ones
    """

    def __init__(
        self, plane: Plane, method: str, wide: bool, seed: int, budget: Budget, free: Pool, bound: Pool
    ) -> None:  # fmt: skip
        self.plane, self.free, self.bound = plane, free, bound
        self._method, self._wide, self._seed, self._budget = method, wide, seed, budget
        self.rules, self.gates = plane.rules(wide=wide), plane.gates()

    def all(self) -> Iterator[Trial]:
        """All there is to try, the most promising first."""
        if self.plane.task.least_explained:
            yield from self._in_full()
        last = max((spot for spot, _ in self.plane.task.fixed), default=0)
        for lead in (lead for lead in self.plane.leads if lead > last):
            for spot, marker in self.plane.task.fixed:
                yield self._headed(lead, spot, marker)
        yield from self._by_triplets() if self._method == "ransac" else self._by_quads()

    def of(
        self, picture: Picture, of: Links, *, price: float = 1.0, pool: Pool | None = None, rules: Rules | None = None,
        gates: Gates | None = None,
    ) -> Trial:  # fmt: skip
        """Of some links; by the usual rules and gates, into the pool of any labels, unless others are given."""
        return Trial(picture, of, rules or self.rules, gates or self.gates, price, pool or self.free)

    def _by_quads(self) -> Iterator[Trial]:
        """Quads: strictest check first, then cheapest stage and number of best spots."""
        far = FAR_STAGES[: 1 + self._wide] if len(self.plane.task.markers) <= FAR_MARKERS else ()
        cost = {
            (stage, lead): stage[0] ** 3 * stage[2] ** 3 * lead
            for lead in self.plane.leads
            for stage in (*STAGES, *far)
        }
        # A rig's cameras are searched to their end, so there would be no gain from a first round with strict checks.
        for part in CHECKS[self._wide :]:
            for (reach, low, high), lead in sorted(cost, key=lambda key: cost[key]):
                picture, table = self.plane.picture(lead), self.plane.layout.table(reach)
                self._budget.spend(LINK * lead * high**3 / 12)
                yield self.of(picture, links.quad_links(picture, table, low, high, self.check(part)))

    def check(self, part: float) -> float:
        """How far (px) an anchor may lie off."""
        return part * self.plane.task.tolerance_px

    def _by_triplets(self) -> Iterator[Trial]:
        """The paper's random marker triplets, stage by stage, cheapest first; nothing twice."""
        model, rng, cost = self.plane.model, np.random.default_rng(self._seed), {}
        for lead in self.plane.leads:
            for near_markers, near_spots in TRIPLET_STAGES:
                cost[near_markers, near_spots, lead] = near_markers**2 * near_spots**2 * lead
                if near_markers >= len(model.xyz) - 1 and near_spots >= lead - 1:
                    break
        for near_markers, near_spots, lead in sorted(cost, key=lambda key: cost[key]):
            picture = self.plane.picture(lead, TRIPLET_STAGES[-1][1])
            triplets = rng.permutation(links.marker_triplets(model, near_markers))
            some = max(1, WORK // (lead * near_spots * (near_spots - 1) * len(self.plane.task.focal_factors)))
            anchors = np.arange(lead, dtype=np.int32)
            for start in range(0, len(triplets), some):
                of = links.triplet_links(model, picture, triplets[start : start + some], anchors, near_spots)
                yield self.of(picture, of, price=TRIPLET)

    def _headed(self, lead: int, spot: int, marker: int) -> Trial:
        """Triplets of a labelled marker and two of its neighbours against its spot and two of its neighbours."""
        picture = self.plane.picture(lead)
        triplets = links.marker_triplets(self.plane.model, HEADED_STAGE[0], every_corner=True)
        triplets, anchor = triplets[triplets[:, 0] == marker], np.array([spot], dtype=np.int32)
        of = links.triplet_links(self.plane.model, picture, triplets, anchor, HEADED_STAGE[1])
        return self.of(picture, of, price=TRIPLET, pool=self.bound)

    def _in_full(self) -> Iterator[Trial]:
        """Few spots: as many triplets of them as one must have no false, against all triplets of markers.

        Where labels are fixed a solution may have or contradict them, so both kinds are looked for.
        """
        task = self.plane.task
        picture, least = self.plane.picture(len(task.xy)), task.least_explained
        rules, gates = self.rules._replace(least=least), self.gates._replace(least=least, least_part=0.0)
        if task.prior is not None:
            # Three spots alone may put the pose beyond it; what all of them say is checked later.
            rules = rules._replace(prior_cosine=np.cos(min(task.prior_max_angle_rad + PRIOR_SLACK, np.pi)))
        known = dict(task.fixed)
        corners = links.wide_triplets(picture.p, len(task.xy) - least + 1)
        bound = [np.array([known.get(int(spot), -1) for spot in three], dtype=np.int32) for three in corners]
        ways = [(corners[[n]], must, self.bound) for n, must in enumerate(bound)] if known else []
        for some, must, pool in (*ways, (corners, np.full(3, -1, np.int32), self.free)):
            of = links.full_links(self.plane.model, picture.p, some, must)
            yield self.of(picture, of, price=TRIPLET, pool=pool, rules=rules, gates=gates)
