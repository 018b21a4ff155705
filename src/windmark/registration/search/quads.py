"""The fast search: local quads of spots meet the quads of markers that look like them (`_kernels.quad`).

Quads of near spots come first, and among them those whose key few quads of markers share. The search goes on after
a good solution as long as the caller asks: "stop at the first good pose" is the trap of regular layouts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from windmark.registration._kernels.best import Best, room_for_best
from windmark.registration._kernels.hypothesis import Picture, Rules
from windmark.registration._kernels.match import search_kernel
from windmark.registration._kernels.quad import Table, first_of_each_kernel, spot_quads_kernel
from windmark.registration._kernels.rival import rivals_kernel
from windmark.registration.budget import LINK, Budget
from windmark.registration.search.layout import REACHES
from windmark.registration.search.near import nearest
from windmark.registration.search.plane import Plane
from windmark.registration.search.pool import Candidate
from windmark.registration.search.ransac import make_gates, make_rules
from windmark.registration.search.sparse import sparse

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

STAGES = ((REACHES[0], 0, 5), (REACHES[0], 5, 8), (REACHES[1], 0, 8), (REACHES[1], 8, 12))
"""Table, and the neighbours of a spot that its quads are taken from (not all of them among the first number)."""
FAR_STAGES = ((16, 0, 12), (16, 12, 16))
"""Where two of three markers are hidden, four neighbouring spots are far apart on the model ..."""
FAR_MARKERS = 80
"""... with more markers than this the table of such quads would be too large, and enough near ones are seen."""
CHECKS = (0.2, 0.5)
"""The anchor of a quad must lie within this part of the tolerance. With the first, all quads take half the time, and
hardly a right one is lost but on a deformed model or with a rough table: then all are tried with the second."""
POOL = 12
WORK = 20_000
"""Links after which the caller is asked whether to go on."""
RIVAL_TURNS = 3
"""After so many times this work no more rivals are looked for; the near-symmetries have made the likely ones before."""
PRIOR_SLACK = float(np.radians(5.0))
"""Rivals that start so far beyond the prior's angle may grow into it."""
RIVAL_NEAR, RIVAL_QUADS, AGAIN = 6, 24, 8
"""Neighbours and number of the quads that rivals are looked for with; from so many the candidate is grown again."""

LEAST_SPOTS = 5
"""So many spots at least make a solution."""
COPIES, COPY_NEAR, COPY_WORK, COPY_EFFORT = 4, 7, 20_000, 10
"""Solutions kept of those among the spots that one does not explain, the neighbours that their quads are taken from,
and the work (links; 2 ms) spent on them, or so many times what the search has taken: of a copy that is half hidden one
quad in eight is whole."""


class QuadSearch:
    """The state of one search: the kernels' view of the task, the best solutions, the number of links tried."""

    def __init__(
        self, plane: Plane, stop_at: float, rules: Rules | None = None, far_stages: int = 1,
        checks: Sequence[float] = CHECKS, budget: Budget | None = None,
    ) -> None:  # fmt: skip
        task = plane.task
        self.plane, self.links, self._budget = plane, 0, budget or Budget()
        far = FAR_STAGES[:far_stages] if len(task.markers) <= FAR_MARKERS else ()
        self._stop_at, self._stages, self._checks = stop_at, (*STAGES, *far), checks
        self._focals = task.camera.focal_px * np.array(task.focal_factors)
        self._rules, self._gates = rules or make_rules(plane), make_gates(plane)
        self._best = room_for_best(POOL, len(task.markers))
        self._candidates: dict[int, Candidate] = {}

    @property
    def best(self) -> Candidate | None:
        """The best candidate, None if there is none."""
        n = int(self._best.score.argmax())
        return self._candidate(n) if self._best.score[n] > -np.inf else None

    def top(self, count: int) -> list[Candidate]:
        """The best distinct candidates, best first."""
        score = self._best.score
        return [self._candidate(n) for n in np.argsort(-score, kind="stable")[:count].tolist() if score[n] > -np.inf]

    def batches(self) -> Iterator[int]:
        """Yields the links tried so far; the caller looks at the candidates after each batch."""
        if self.plane.task.least_explained:
            for found, links in sparse(self.plane, self._rules, self._gates, self._focals, self._budget):
                for n in np.flatnonzero(found.score > -np.inf).tolist():
                    self._keep(found, n, found.match[n])
                self.links += links
                yield self.links
        for check, (reach, low, high), lead in self._schedule():
            picture = self.plane.picture(lead)
            high = min(high, picture.near.shape[1])
            table = self.plane.layout.table(reach)
            quads, cells = spot_quads_kernel(picture.p, picture.near, low, high, table.first)
            self._budget.spend(LINK * lead * high**3 / 12)
            start = 0
            while start < len(quads):
                start, links, work = search_kernel(
                    self.plane.model, picture, self._rules, self._gates, table, self._focals, check,
                    quads, cells, start, WORK, self._stop_at, self._best, self._best.match,
                )  # fmt: skip
                self.links += int(links)
                self._budget.spend(LINK * work)
                yield self.links

    def _check(self, part: float) -> float:
        """How far (px) an anchor may lie off."""
        return part * self.plane.task.tolerance_px

    def _schedule(self) -> list[tuple[float, tuple[int, int, int], int]]:
        """How far an anchor may lie off, stages and numbers of best spots: strictest first, then cheapest."""
        cost = {
            (stage, lead): stage[0] ** 3 * stage[2] ** 3 * lead for lead in self.plane.leads for stage in self._stages
        }
        order = sorted(cost, key=lambda key: cost[key])
        return [(self._check(part), *key) for part in self._checks for key in order]

    def rivals(self, candidate: Candidate, over: Callable[[], bool]) -> bool:
        """Look for other solutions: of the spots that a candidate explains, and of those that it does not.

        A shifted, turned or mirrored labelling uses mostly the same spots, so it has a quad among the explained ones,
        where no false spot and hardly a hidden marker disturbs. One that takes every n-th spot of a lattice leaves most
        of the spots, so quads of the others are tried, too. What the near-symmetries of the model make of the candidate
        is tried in any case; if that is better by far, the candidate is no answer and nothing else is tried. False if
        the time was ``over`` before all of this was done.
        """
        spots = candidate.match[candidate.match >= 0]
        picture = self.plane.picture(next(n for n in self.plane.leads if n > spots.max()))
        free = np.ones(len(picture.p), dtype=bool)
        free[spots] = False
        others = np.flatnonzero(free).astype(np.int32)
        table = self.plane.layout.table(REACHES[1])
        rotation, translation = self.plane.frame.unit(candidate.cam_from_model)
        work, beaten = rivals_kernel(
            self.plane.model, picture, self._gates, self._best, self._symmetries(rotation),
            rotation, translation, candidate.focal_px, candidate.match,
        )  # fmt: skip
        self._budget.spend(LINK * work)
        if beaten:
            return True
        check = self._check(CHECKS[-1])
        others_known = np.where((self._best.match == candidate.match).all(axis=1)[:, None], -1, self._best.match)
        for some, most in ((spots, RIVAL_QUADS), (others, RIVAL_QUADS // 2)):
            if len(some) < 4:
                continue
            quads, cells = self._compact_quads(picture, some, most, table)
            # The candidate itself may have grown from a bad start: it is grown again from some of its quads.
            for known, part in ((others_known, np.s_[:AGAIN]), (self._best.match, np.s_[AGAIN:])):
                start = 0
                for _ in range(RIVAL_TURNS):
                    if over():
                        return False
                    start, links, work = search_kernel(
                        self.plane.model, picture, self._rules, self._gates, table, self._focals, check,
                        quads[part], cells[part], start, WORK, np.inf, self._best, known,
                    )  # fmt: skip
                    self.links += int(links)
                    self._budget.spend(LINK * work)
                    if start == len(quads[part]):
                        break
        return True

    def copies(self, candidate: Candidate, over: Callable[[], bool]) -> bool:
        """Look for another solution among the spots that a candidate does not explain: a second copy of the model.

        A reflection, a ghost of a double exposure or a second model leaves spots of its own, which neighbour each other
        when the explained ones are taken away. Quads of near ones are tried, those whose key fewest quads of markers
        share first, as much as `COPY_WORK` says, until one grows to a solution, among these spots alone: or the copy
        beside it would take it over. False if the time was ``over`` before all of this was done.
        """
        free = np.ones(len(self.plane.task.xy), dtype=bool)
        free[candidate.match[candidate.match >= 0]] = False
        spots = np.flatnonzero(free).astype(np.int32)
        if len(spots) < LEAST_SPOTS:
            return True
        picture, found = self.plane.part(spots), room_for_best(COPIES, len(candidate.match))
        table, done, start = self.plane.layout.table(REACHES[0]), 0, 0
        most = max(COPY_WORK, COPY_EFFORT * self.links)
        near = min(COPY_NEAR, picture.near.shape[1])
        quads, cells = spot_quads_kernel(picture.p, picture.near, 0, near, table.first)
        self._budget.spend(LINK * len(spots) * near**3 / 12)
        while start < len(quads) and done < most and not (found.score > self._stop_at).any():
            if over():
                return False
            start, links, work = search_kernel(
                self.plane.model, picture, self._rules, self._gates, table, self._focals, self._check(CHECKS[-1]),
                quads, cells, start, most - done, self._stop_at, found, found.match,
            )  # fmt: skip
            self.links, done = self.links + int(links), done + int(work)
            self._budget.spend(LINK * work)
        for n in np.argsort(-found.score).tolist():
            if found.score[n] > -np.inf:
                self._keep(found, n, np.where(found.match[n] >= 0, spots[found.match[n]], -1))
        return True

    def _keep(self, found: Best, n: int, match: Ints) -> None:
        """Keep solution n of others, with this match, as `_kernels.best.keep` does; compiled it would cost a second."""
        best, alike = self._best, []
        for k in np.flatnonzero(best.score > -np.inf).tolist():
            if self._candidate(k).is_like(found.rotation[n], match, int(found.matched[n])):
                alike.append(k)
        place = int(best.score.argmin())
        if max([best.score[place], *best.score[alike]]) >= found.score[n]:
            return
        best.score[alike], best.match[alike] = -np.inf, -1
        best.rotation[place], best.translation[place] = found.rotation[n], found.translation[n]
        best.focal[place], best.score[place] = found.focal[n], found.score[n]
        best.matched[place], best.match[place] = found.matched[n], match
        best.serial[POOL] += 1
        best.serial[place] = best.serial[POOL]

    def _symmetries(self, rotation: Array) -> tuple[Ints, Array, Array]:
        """The model's near-symmetries; with a prior only those that lead to a pose it allows.

        A regular grid has many, and the others would take all the places that are kept for rivals.
        """
        onto, turn, shift = self.plane.layout.symmetries
        task = self.plane.task
        if task.prior is None:
            return onto, turn, shift
        # Of R turn^T against the prior's rotation; growth may change it a little.
        cosine = (np.einsum("ij,skj,ik->s", rotation, turn, task.prior.rotation) - 1) / 2
        allowed = cosine > np.cos(min(task.prior_max_angle_rad + PRIOR_SLACK, np.pi)) - 1e-9
        return onto[allowed], turn[allowed], shift[allowed]

    @staticmethod
    def _compact_quads(picture: Picture, spots: Ints, most: int, table: Table) -> tuple[Ints, Ints]:
        """Quads among some spots, and their cells: for each anchor the one with the rarest key."""
        p = picture.p[spots]
        near = nearest(p, min(RIVAL_NEAR, len(p) - 1))[0]
        quads, cells = spot_quads_kernel(p, near, 0, near.shape[1], table.first)
        chosen = first_of_each_kernel(quads, len(p), most)
        return spots[quads[chosen]], cells[chosen]

    def _candidate(self, n: int) -> Candidate:
        """One object for each solution kept."""
        best = self._best
        serial = int(best.serial[n])
        if serial not in self._candidates:
            pose = self.plane.frame.pose(best.rotation[n].copy(), best.translation[n].copy())
            self._candidates[serial] = Candidate(
                pose, float(best.focal[n]), float(best.score[n]), int(best.matched[n]), best.match[n].copy()
            )
        return self._candidates[serial]
