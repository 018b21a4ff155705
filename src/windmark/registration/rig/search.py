"""The search with a rig: each camera proposes poses by its own spots, all of them judge every one."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from windmark.registration.budget import SETTLE, SETTLE_PAIR, Budget
from windmark.registration.register import MIN_COUNT
from windmark.registration.rig.joint import Cameras, Joint
from windmark.registration.search.plane import Plane
from windmark.registration.search.pool import Candidate
from windmark.registration.search.quads import CHECKS, FAR_STAGES, POOL, QuadSearch
from windmark.registration.search.ransac import make_rules

Ints = NDArray[np.int32]

WORTH_CARRYING = 25.0
"""Search score (nats) of one camera's candidate from which the other cameras are asked at once."""
P_SEEN, REJECT_AT, GROW_AT = 0.35, -8.0, 3.0
"""Neighbourhoods may look weak, since the other cameras will judge: most markers may be hidden in one camera."""
CONFIRMED = 20.0
"""A camera with so much evidence (nats; two pairs or so) confirms a solution, however many markers it misses."""
KEPT = 8
"""Distinct joint solutions that are kept."""


class RigSearch:
    """The state of a search: one `QuadSearch` per camera with enough spots, and the best distinct joint solutions."""

    def __init__(self, cameras: Cameras, budget: Budget | None = None) -> None:
        self.cameras, self._budget = cameras, budget or Budget()
        self.solutions: list[Joint] = []
        self._searches = [_search(plane, self._budget) for plane in cameras.planes]
        self._running = {c: search.batches() for c, search in enumerate(self._searches) if search is not None}
        self._tried: set[Candidate] = set()

    @property
    def links(self) -> int:
        """Links of three markers to three spots that were tried."""
        return sum(search.links for search in self._searches if search is not None)

    def batches(self) -> Iterator[int]:
        """Yields the links tried so far; the caller looks at the solutions after each batch of one camera."""
        while self._running:
            for c in range(len(self._searches)):
                if c in self._running:  # a search for rivals may have ended it meanwhile
                    self._go_on(c)
                    yield self.links

    def rivals(self, joint: Joint, over: Callable[[], bool]) -> bool:
        """Look for other solutions on purpose: by near-symmetries in all cameras, then by the spots of each of them.

        A camera that has nothing to do with the solution is searched to the end: it may see the model elsewhere.
        False if the time was ``over`` before all of this was done.
        """
        self._turn_about(joint)
        for c, (search, view) in enumerate(zip(self._searches, joint.views, strict=True)):
            if search is None:
                continue
            if joint.scores[c] <= CONFIRMED:
                while c in self._running:
                    if over():
                        return False
                    self._go_on(c)
            if view.count == 0:
                continue
            seen = Candidate(view.cam_from_model, view.focal_px, joint.scores[c], view.count, view.state.match)
            if not search.rivals(seen, over):
                return False
            self._carry(c)
        return True

    def _go_on(self, c: int) -> None:
        """One more batch of a camera's own search."""
        if next(self._running[c], None) is None:
            del self._running[c]
        self._carry(c)

    def _turn_about(self, joint: Joint) -> None:
        """What the near-symmetries of the model make of a solution."""
        state = joint.state
        for onto, turn, shift in zip(*self.cameras.layout.symmetries, strict=True):
            # The spot of marker m is taken for that of marker onto[m], so the rig sees the model moved back.
            match = np.full_like(state.match, -1)
            match[:, onto[onto >= 0]] = state.match[:, onto >= 0]
            rotation = state.rotation @ turn.T
            self._add(self.cameras.settle(rotation, state.translation - rotation @ shift, match))

    def _carry(self, c: int) -> None:
        """Take new candidates of one camera to all of them."""
        search = self._searches[c]
        assert search is not None
        for candidate in search.top(POOL):
            if candidate in self._tried:
                continue
            self._tried.add(candidate)
            if not any(_explained(candidate, known, c) for known in self.solutions):
                pose = self.cameras.cam_from_rig[c].inverse() @ candidate.cam_from_model
                match = np.full((len(self._searches), len(candidate.match)), -1, np.int32)
                match[c] = candidate.match
                self._add(self.cameras.settle(*self.cameras.layout.frame.unit(pose), match))

    def _add(self, new: Joint | None) -> None:
        """Keep a solution that was settled, unless one like it is as good."""
        self._budget.spend(SETTLE + SETTLE_PAIR * len(self.cameras.planes) * len(self.cameras.layout.markers))
        if new is None:
            return
        alike = [old for old in self.solutions if new.same_as(old)]
        if any(old.evidence.score >= new.evidence.score for old in alike):
            return
        kept = [*(old for old in self.solutions if old not in alike), new]
        self.solutions = sorted(kept, key=lambda s: -s.evidence.score)[:KEPT]


def _search(plane: Plane, budget: Budget) -> QuadSearch | None:
    if len(plane.task.xy) < MIN_COUNT:
        return None
    rules = make_rules(plane)._replace(p_seen=P_SEEN, reject_at=REJECT_AT, grow_at=GROW_AT)
    # Cameras are searched to their end, so there would be no gain from a first round with strict checks.
    return QuadSearch(plane, WORTH_CARRYING, rules, len(FAR_STAGES), CHECKS[-1:], budget)


def _explained(candidate: Candidate, known: Joint, c: int) -> bool:
    """Whether a known solution is what the candidate would become."""
    rotation, match = known.state.rotations[c], known.state.match[c]
    return candidate.is_like(rotation, match, int((match >= 0).sum()))
