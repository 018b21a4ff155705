"""Where explanations come from: the searches of all cameras, and what their candidates settle to."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from windmark.registration.budget import SETTLE, SETTLE_PAIR, Budget, work_for
from windmark.registration.search.pool import Candidate
from windmark.registration.search.search import POOL, Search
from windmark.registration.settle.settling import settle
from windmark.registration.settle.solution import Solution
from windmark.registration.settle.views import AT_HOME, Views

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

CONFIRMED = 20.0
"""A camera of a rig with so much evidence (nats; two pairs or so) confirms a solution, however many markers it misses.
"""
SEES = 60.0
"""A camera of a rig with a candidate of so much search score (nats) sees the model: chance has not given more than 54.
"""
KEPT = 24
"""Distinct solutions of a rig that are kept."""


class Source:
    """The searches of C cameras; every candidate of one is carried to all of them and settled.

    Parameters
    ----------
    views : what was seen
    searches : of each camera, None where it has too few spots
    window : candidates whose search score (nats) is this much below the best of their camera are no rivals
    budget : of the whole registration
    """

    def __init__(self, views: Views, searches: Sequence[Search | None], window: float, budget: Budget) -> None:
        self.views, self._window, self._budget = views, window, budget
        self._searches = tuple(searches)
        self._running = {c: search.batches() for c, search in enumerate(searches) if search is not None}
        self._settled: dict[Candidate, Solution | None] = {}
        self._more: list[Solution] = []
        self._last: tuple[object, list[Solution]] = (None, [])  # what `solutions` was made of, and what it was

    @property
    def links(self) -> int:
        """Links of three markers to three spots that were tried."""
        return sum(search.links for search in self._searches if search is not None)

    @property
    def best(self) -> Candidate | None:
        """The best candidate of all searches by its search score."""
        return max((c for c in self.seen if c is not None), key=lambda c: c.score, default=None)

    @property
    def seen(self) -> list[Candidate | None]:
        """The best candidate of each search."""
        return [search.best if search is not None else None for search in self._searches]

    def worth_judging(self, least: float) -> Candidate | Solution | None:
        """What there is to judge, if that is worth so many nats: the best candidate, of a rig the best solution.

        One camera of a rig may find its candidates weak that all of them together are sure of.
        """
        if len(self._searches) == 1:
            best = self.best
            return best if best is not None and best.score > least else None
        found = self.solutions()
        return found[0] if found and found[0].score > least else None

    def batches(self) -> Iterator[int]:
        """Yields the links tried so far; the caller looks at the solutions after each batch of one camera."""
        while self._running:
            for c in range(len(self._searches)):
                if c in self._running:  # a search for rivals may have ended it meanwhile
                    if next(self._running[c], None) is None:
                        del self._running[c]
                    yield self.links

    def solutions(self, candidates: Sequence[tuple[int, Candidate]] | None = None) -> list[Solution]:
        """Distinct solutions, best first: of the given candidates (camera, candidate), or of all worth a look."""
        if candidates is not None:
            return distinct(self._settle(candidates))
        # A rig asks after every batch, and most bring nothing new: telling solutions apart is most of its work.
        chosen = self.candidates()
        made_of = ([candidate for _, candidate in chosen], list(self._more))
        if self._last[0] != made_of:
            self._last = made_of, distinct([*self._settle(chosen), *self._more])
        return list(self._last[1])

    def every(self) -> list[Solution]:
        """All of them, those too that count as the same as a better one."""
        return [*self._settle(self.candidates()), *self._more]

    def _settle(self, candidates: Sequence[tuple[int, Candidate]]) -> list[Solution]:
        return [s for c, candidate in candidates if (s := self._solution(c, candidate)) is not None]

    def candidates(self) -> list[tuple[int, Candidate]]:
        """Those worth a look, of every camera."""
        searches = ((c, search) for c, search in enumerate(self._searches) if search is not None)
        return [(c, candidate) for c, search in searches for candidate in search.top(POOL, self._window)]

    def cores(self, count: int) -> list[tuple[int, Candidate]]:
        """Candidates to begin a bent model from, of a rig those first that explain most in all its cameras."""
        found = self.candidates()
        if len(self._searches) > 1:
            worth = {f: s.evidence if (s := self._solution(*f)) is not None else -np.inf for f in found}
            found.sort(key=lambda f: -worth[f])
        return found[:count]

    def above(self, evidence: float) -> list[tuple[int, Candidate]]:
        """Candidates whose solutions have more evidence (nats) than so much."""
        found = []
        for c, candidate in self.candidates():
            solution = self._solution(c, candidate)
            if solution is not None and solution.evidence > evidence:
                found.append((c, candidate))
        return found

    def contradictions(self) -> list[Solution]:
        """Solutions that do not have the fixed labels, best first."""
        free = [
            (c, candidate) for c, search in enumerate(self._searches) if search and self.views.planes[c].task.fixed
            for candidate in search.contradictions(POOL)
        ]  # fmt: skip
        return [s for s in self.solutions(free) if not s.keeps_labels]

    def add(self, solution: Solution | None) -> None:
        """Keep a solution that did not come from the search."""
        if solution is not None:
            self._more.append(solution)

    def rivals(self, best: Solution, over: Callable[[], bool]) -> bool:
        """Look for other solutions on purpose: by near-symmetries, and by the spots of each camera.

        A camera that has nothing to do with the solution is searched by itself: it may see the model elsewhere.
        False if the work was ``over`` before all of this was done.
        """
        if len(self._searches) > 1:
            self._turn_about(best)
        for c, search in enumerate(self._searches):
            if search is None:
                continue
            if len(self._searches) > 1 and best.scores[c] <= CONFIRMED and not self._search_alone(c, search, over):
                return False
            if best.counts[c] == 0:
                continue
            if not search.rivals(self._as_candidate(best, c), over):
                return False
        return True

    def _search_alone(self, c: int, search: Search, over: Callable[[], bool]) -> bool:
        """Search one camera until it sees the model, or as long as one that is alone is; False if it was ``over``."""
        most = search.links + work_for(self.views.planes[c].task, "hash")
        while c in self._running and search.links < most and not (search.best and search.best.score > SEES):
            if over():
                return False
            if next(self._running[c], None) is None:
                del self._running[c]
        return True

    def copies(self, best: Solution, over: Callable[[], bool]) -> tuple[list[Solution], float]:
        """Solutions of mostly other spots than the best one explains, also weak ones, best first; and the part of a
        copy's markers that must be seen for it to be met for sure, see `Search.copies`.
        """  # fmt: skip
        found, part, taken = [], 0.0, []
        for c, search in enumerate(self._searches):
            used = np.zeros(len(self.views.planes[c].task.xy), dtype=bool)
            used[best.pairs(c)[0]] = True
            taken.append(used)
            if search is None or used.all():
                continue
            copies: list[Candidate] = []
            if isinstance(search, Search):
                copies, met = search.copies(self._as_candidate(best, c), over, float(best.misfit_px[c]))
                part = max(part, met)
            known = {copy.match.tobytes() for copy in copies}
            for candidate in [*copies, *(one for one in search.top(POOL) if one.match.tobytes() not in known)]:
                spots = candidate.match[candidate.match >= 0]
                if 2 * int(taken[c][spots].sum()) < len(spots):
                    found.append((c, candidate))
        if not found:
            return [], part
        # Beside the best one the others would take over its spots, where they are but some pixels away.
        rest = self.views.without(taken)
        return distinct([s for c, candidate in found if (s := self._settled_in(rest, c, candidate)) is not None]), part

    def _as_candidate(self, best: Solution, c: int) -> Candidate:
        match, focal = best.state.match[c].copy(), float(best.state.camera[c, 0])
        return Candidate(best.cam_from_model(c), focal, float(best.scores[c]), int(best.counts[c]), match)

    def _turn_about(self, best: Solution) -> None:
        """What the near-symmetries of the model make of a solution, in all cameras at once."""
        state = best.state
        labels = (plane.task.label_of(state.match[c]) for c, plane in enumerate(self.views.planes))
        label = next((label for label in labels if label is not None), None)
        for onto, turn, shift in zip(*self.views.layout.symmetries_with(label), strict=True):
            # The spot of marker m is taken for that of marker onto[m], so the rig sees the model moved back.
            match = np.full_like(state.match, -1)
            match[:, onto[onto >= 0]] = state.match[:, onto >= 0]
            rotation = state.rotation @ turn.T
            self.add(
                settle(self.views, rotation, state.translation - rotation @ shift, match, focal_px=state.camera[:, 0])
            )
        self._more = distinct(self._more)[:KEPT]

    def _solution(self, c: int, candidate: Candidate) -> Solution | None:
        if candidate not in self._settled:
            for known in self._settled.values() if len(self._searches) > 1 else ():
                if known is not None and candidate.is_like(
                    known.state.rotations[c], known.state.match[c], int(known.counts[c])
                ):
                    self._settled[candidate] = known  # what it would become
                    return known
            self._settled[candidate] = self._settled_in(self.views, c, candidate)
        return self._settled[candidate]

    def _settled_in(self, views: Views, c: int, candidate: Candidate) -> Solution | None:
        self._budget.spend(SETTLE + SETTLE_PAIR * candidate.count * len(self._searches))
        return settle(views, *start_of(views, c, candidate), focal_px=focal_of(views, c, candidate))


def start_of(views: Views, c: int, candidate: Candidate) -> tuple[Array, Array, Ints]:
    """Pose of the unit model in the rig and labels (C, N) to start from, of a candidate of camera c."""
    pose, place = candidate.cam_from_model, views.cam_from_rig[c]
    if place is not AT_HOME:
        pose = place.inverse() @ pose
    match = np.full((len(views.planes), len(candidate.match)), -1, np.int32)
    match[c] = candidate.match
    return (*views.layout.frame.unit(pose), match)


def focal_of(views: Views, c: int, candidate: Candidate) -> Array | None:
    """(C,) focal lengths to start from: the candidate's for its own camera, the given ones for the others; None where
    none is free.
    """  # fmt: skip
    if not any(plane.task.free_focal for plane in views.planes):
        return None
    focal = np.array([plane.task.camera.focal_px for plane in views.planes])
    focal[c] = candidate.focal_px
    return focal


def distinct(solutions: Sequence[Solution]) -> list[Solution]:
    """Solutions that are not the same as a better one, best first."""
    kept: list[Solution] = []
    for solution in sorted(solutions, key=lambda s: -s.evidence):
        if not any(solution.same_as(better) for better in kept):
            kept.append(solution)
    return kept
