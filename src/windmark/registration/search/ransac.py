"""The paper's search: random marker triplets against triplets of neighbouring spots (RANSAC).

AIAA 2005-5007 section III.C, steps 1 to 9, with these differences, each for a reason:

- The image triplets of step 2 are not all, but those among a spot's nearest neighbours, few first: three
  neighbouring markers are seen as three neighbouring spots, and their pose predicts the next neighbours well.
- Step 4 judges by likelihood, nearest markers first, and gives up or goes on early.
- Steps 7 to 9 do not stop at "all matched": on near-regular rows the mirrored or shifted labelling comes first
  as often as the right one. The best *distinct* solutions are kept, and `Search.rivals` looks for others on purpose.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.registration._kernels.growth import Gates, growth_kernel
from windmark.registration._kernels.growth import room_for as room_to_grow
from windmark.registration._kernels.hypothesis import Picture, Rules, hypotheses_kernel, room_for
from windmark.registration._kernels.match import GROWTH
from windmark.registration.budget import LINK, TRIPLET, Budget
from windmark.registration.search.plane import Plane
from windmark.registration.search.pool import Candidate, Pool
from windmark.registration.search.triplets import marker_triplets, spread_corners, turns_of

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

STAGES = ((4, 4), (4, 6), (6, 8), (8, 12), (14, 20), (24, 32))
"""Neighbours that a marker triplet and a spot triplet are taken from, stage by stage."""
RIVAL_CORNERS, OTHER_CORNERS, RIVAL_REACH = 6, 3, 10
"""Explained and other spot triplets that are relabelled, and the neighbourhood of the marker triplets for them."""
MOST_RIVALS = 20_000
"""Marker triplets tried for rivals; with more than some 440 markers a random part of them."""
FOCAL_SLACK = 1.3
"""How far beyond the starting values a growing solution may take the focal length."""
BATCH, LONGEST_BATCH = 2_000, 40_000
"""Links of the first batch and of the longest one."""
ROOM = 2_048
"""Hypotheses grown per batch; a batch with more comes from a picture that tells nothing apart."""
P_SEEN, REJECT_AT, GROW_AT, MIN_SCORE = 0.6, -4.0, 9.0, 8.0


@dataclass(frozen=True)
class _Batch:
    """Marker triplets and the spots to link them to."""

    picture: Picture
    triplets: Ints
    turns: NDArray[np.int8]
    anchors: Ints
    reach: int


class Search:
    """The state of one search: the kernels' view of the task, the pool, the number of links tried."""

    def __init__(self, plane: Plane, rng: np.random.Generator, budget: Budget | None = None) -> None:
        self.plane, self.task, self.model = plane, plane.task, plane.model
        self.pool = Pool()
        self.links, self._budget = 0, budget or Budget()
        self._rng = rng
        self._focals = plane.task.camera.focal_px * np.array(plane.task.focal_factors)
        self._rules, self._gates = make_rules(plane), make_gates(plane)
        self._hypotheses = room_for(ROOM)
        self._grown = room_to_grow(ROOM, len(plane.task.markers))

    @property
    def best(self) -> Candidate | None:
        """The best candidate, None if there is none."""
        return self.pool.best

    def top(self, count: int) -> list[Candidate]:
        """The best distinct candidates, best first."""
        return self.pool.items[:count]

    def batches(self) -> Iterator[int]:
        """Steps 1 to 6, batch by batch; yields the links tried so far, without those for rivals.

        The caller looks at the pool after each batch.
        """
        searched = 0
        for stage, lead in self._schedule():
            picture = self.plane.picture(lead, STAGES[-1][1])
            triplets = marker_triplets(self.model, stage[0])
            turns = turns_of(self.model, triplets)
            anchors = np.arange(lead, dtype=np.int32)
            reach = min(stage[1], picture.near.shape[1])
            order = self._rng.permutation(len(triplets))
            per_triplet = lead * reach * (reach - 1) * len(self._focals)
            start, size = 0, BATCH
            while start < len(order):
                chosen = order[start : start + max(1, size // per_triplet)]
                searched += self._try(_Batch(picture, triplets[chosen], turns[chosen], anchors, reach))
                yield searched
                start, size = start + len(chosen), min(2 * size, LONGEST_BATCH)

    def _schedule(self) -> list[tuple[tuple[int, int], int]]:
        """Stages and numbers of best spots, cheapest first; those that would only repeat another are left out."""
        markers = len(self.model.xyz)
        cost: dict[tuple[tuple[int, int], int], int] = {}
        for lead in self.plane.leads:
            for near_markers, near_spots in STAGES:
                cost[(near_markers, near_spots), lead] = near_markers**2 * near_spots**2 * lead
                if near_markers >= markers - 1 and near_spots >= lead - 1:
                    break
        return sorted(cost, key=lambda key: cost[key])

    def rivals(self, candidate: Candidate, over: Callable[[], bool]) -> bool:
        """Look for other solutions of the spots that a candidate explains.

        A shifted, turned or mirrored labelling uses mostly the same spots. So a few compact triplets of them,
        spread over the image, are linked to *all* compact marker triplets (all four poses of each): a better
        solution is found here even if the random search missed it, an equally good one shows the ambiguity.
        A solution that takes every n-th spot of a lattice leaves most of them, so some triplets are taken from
        the spots that the candidate does not explain. False if the time is ``over`` after it.
        """
        spots = candidate.match[candidate.match >= 0]
        picture = self.plane.picture(next(n for n in self.plane.leads if n > spots.max()))
        others = np.setdiff1d(np.arange(len(picture.p), dtype=np.int32), spots)
        corners = np.concatenate(
            [spread_corners(picture.p, spots, RIVAL_CORNERS), spread_corners(picture.p, others, OTHER_CORNERS)]
        )
        if not len(corners):
            return True
        near = np.zeros((len(picture.p), 2), dtype=np.int32)
        near[corners[:, 0]] = corners[:, 1:]
        triplets = marker_triplets(self.model, RIVAL_REACH, every_corner=True)
        if len(triplets) > MOST_RIVALS:
            triplets = triplets[self._rng.permutation(len(triplets))[:MOST_RIVALS]]
        anchors = np.ascontiguousarray(corners[:, 0])
        self._try(_Batch(picture._replace(near=near), triplets, turns_of(self.model, triplets), anchors, 2))
        return not over()

    def _try(self, batch: _Batch) -> int:
        """One batch: link, screen, grow, pool; the number of links."""
        found, links = hypotheses_kernel(
            self.model, batch.picture, self._rules, self._hypotheses,
            batch.triplets, batch.turns, batch.anchors, batch.reach, self._focals,
        )  # fmt: skip
        self.links += int(links)
        self._budget.spend(TRIPLET * links)
        self._grow(batch.picture, min(int(found), ROOM))
        return int(links)

    def _grow(self, picture: Picture, found: int) -> None:
        """Grow the first ``found`` hypotheses and pool what becomes of them."""
        grown = self._grown
        self._budget.spend(LINK * GROWTH * found * len(self.model.xyz))
        growth_kernel(self.model, picture, self._gates, self._hypotheses, found, grown)
        # Best first, so that the many copies of one solution meet the best of them in the pool.
        for n in np.argsort(-grown.score[:found], kind="stable"):
            if grown.score[n] == -np.inf:
                break
            pose = self.plane.frame.pose(grown.rotation[n].copy(), grown.translation[n].copy())
            focal = float(grown.focal[n])
            if self.task.allows(pose, focal):
                match = grown.match[n].copy()
                self.pool.add(Candidate(pose, focal, float(grown.score[n]), int(grown.matched[n]), match))


def make_rules(plane: Plane) -> Rules:
    """Constants of the search."""
    task, n = plane.task, len(plane.model.xyz)
    rotation, cosine, depth = np.zeros((3, 3)), -2.0, np.ones(n)
    if task.prior is not None:
        rotation, translation = plane.frame.unit(task.prior)
        cosine = float(np.cos(task.prior_max_angle_rad))
        depth = (plane.model.xyz @ rotation.T + translation)[:, 2] / task.camera.focal_px
    return Rules(
        task.tolerance_px, P_SEEN, REJECT_AT, GROW_AT,
        np.ascontiguousarray(rotation), cosine, np.ascontiguousarray(depth), task.prior_max_scale,
    )  # fmt: skip


def make_gates(plane: Plane) -> Gates:
    """Constants of growth."""
    task = plane.task
    sigma = max(task.typical_sigma_px, task.tolerance_px / 8)
    low, high = (
        task.camera.focal_px * f for f in (task.focal_factors[0] / FOCAL_SLACK, task.focal_factors[-1] * FOCAL_SLACK)
    )
    return Gates(task.tolerance_px, sigma, MIN_SCORE, low, high if task.free_focal else low)
