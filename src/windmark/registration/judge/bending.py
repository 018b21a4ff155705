"""Bent explanations: the rigid core of a candidate, grown with a smooth deformation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from windmark.registration import rules
from windmark.registration.budget import BEND, BEND_PAIR, Budget
from windmark.registration.cached import cached_property
from windmark.registration.judge.first_order import PRIOR
from windmark.registration.judge.source import distinct, focal_of, start_of
from windmark.registration.search.pool import Candidate
from windmark.registration.settle.settling import copied, settle, settle_state, with_freedom
from windmark.registration.settle.solution import Solution
from windmark.registration.settle.views import Views

Array = NDArray[np.float64]

DOUBTED = 0.05
"""Largest displacement that is asked about where less is allowed, as part of the model's size."""
CORE_ANGLE = float(np.radians(10.0))
"""A candidate within this angle of a solution that has most of its pairs is a core of it."""


class Bender:
    """Grows candidates into solutions of a model that may be bent; what was grown is kept.

    ``bend`` is 1 sigma of the deformation's prior, in sizes of the unit model; 0 where it cannot bend.

    Parameters
    ----------
    views : what was seen, rigid
    most : largest displacement of a marker, as part of the model's size; 0: the model is rigid
    budget : of the whole registration
    """

    def __init__(self, views: Views, most: float, budget: Budget) -> None:
        self._budget = budget
        self._rigid, self._most = views, most
        self.bend = PRIOR * most * views.layout.size if most > 0 and len(views.layout.modes) else 0.0
        self._grown: dict[Candidate, Solution | None] = {}

    @cached_property
    def _views(self) -> Views:
        """What was seen of a model that is stiff along its wide axes."""
        return self._rigid.bent(self.bend * self._rigid.layout.modes)

    @cached_property
    def _bows(self) -> Views:
        """And of one that is supple."""
        return self._rigid.bent(self.bend * self._rigid.layout.bows)

    def solutions(self, candidates: Sequence[tuple[int, Candidate]]) -> list[Solution]:
        """Distinct bent solutions, best first; a core of one that is known already is not grown again."""
        found: list[Solution] = []
        for c, candidate in candidates if self.bend > 0.0 else ():
            if any(_core_of(c, candidate, known) for known in found):
                continue
            if candidate not in self._grown:
                self._budget.spend(BEND + BEND_PAIR * candidate.count)
                start = start_of(self._views, c, candidate)
                self._grown[candidate] = self._settled(start, focal_of(self._views, c, candidate))
            solution = self._grown[candidate]
            if solution is not None and solution.keeps_labels:
                found.append(solution)
        return distinct(found)

    @property
    def most_evidence(self) -> float:
        """Of the best that was grown (nats)."""
        return max((s.evidence for s in self._grown.values() if s is not None), default=-np.inf)

    def _settled(self, start: tuple[Array, Array, NDArray[np.int32]], focal_px: Array | None) -> Solution | None:
        """Grown as a stiff model is bent; or then as a supple one is, if that is the better explanation."""
        stiff = settle(self._views, *start, focal_px=focal_px)
        if stiff is not None:
            start = stiff.state.rotation, stiff.state.translation, stiff.state.match
        bow = settle(self._bows, *start, focal_px=focal_px)
        return max((s for s in (stiff, bow) if s is not None), key=lambda s: s.evidence, default=None)

    def as_one(self, best: Solution, other: Solution) -> Solution | None:
        """The bent model of which two rigid solutions are parts; None where two models are the likelier explanation."""
        state = copied(self._doubted, best.state)
        np.copyto(state.match, other.state.match, where=state.match < 0)
        bent = settle_state(self._doubted, state)
        return bent if bent is not None and bent.evidence > best.evidence + other.evidence else None

    def doubted(self, best: Solution) -> Solution | None:
        """What becomes of a rigid solution if the model is bent though it is said to be rigid; None where it may be."""
        return None if best.is_bent or self.bend > 0.0 else with_freedom(self._doubted, best)

    @cached_property
    def _doubted(self) -> Views:
        layout = self._rigid.layout
        return self._rigid.bent(PRIOR * max(self._most, DOUBTED) * layout.size * layout.modes)

    def allows(self, solution: Solution) -> bool:
        """Whether a solution is bent by no more than the model may be."""
        return solution.largest <= self._most


def _core_of(c: int, candidate: Candidate, known: Solution) -> bool:
    """Whether a candidate has mostly the pairs and nearly the pose of a bent solution."""
    shared = (candidate.match == known.state.match[c]) & (candidate.match >= 0)
    alike = candidate.cam_from_model.angle_to(known.cam_from_model(c)) < CORE_ANGLE
    return bool(alike and shared.sum() > rules.SAME_SHARE * candidate.count)
