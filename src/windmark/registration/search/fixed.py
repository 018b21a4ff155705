"""The search where the user has said of some spots which markers they are.

Three labels fix the pose up to four solutions of P3P, more of them check each other, and the labelling grows from
there. One or two labels head the triplets of the paper's search: the marker is linked to its own spot and to no
other. After that the fast search goes on as without labels; what it finds decides whether the labels can be true.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Pose, p3p
from windmark.registration._kernels.hypothesis import PAIRS
from windmark.registration.budget import Budget
from windmark.registration.search.plane import Plane
from windmark.registration.search.pool import Candidate
from windmark.registration.search.quads import QuadSearch
from windmark.registration.search.ransac import ROOM, Search, _Batch
from windmark.registration.search.triplets import interior_angles, marker_triplets, turns_of

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

STAGES = ((6, 8), (10, 14))
"""Neighbours of a labelled marker and of its spot that the triplets are taken from."""
TRIPLETS = 40
"""Triplets of labels tried, the widest on the model first."""


class FixedSearch(Search):
    """A search for solutions that contain the task's fixed pairs; `contradictions` are the best ones that do not."""

    def __init__(
        self, plane: Plane, rng: np.random.Generator, stop_at: float, budget: Budget | None = None
    ) -> None:  # fmt: skip
        super().__init__(plane, rng, budget)
        self._free, self._stop_at = QuadSearch(plane, stop_at, budget=budget), stop_at
        self._spots = np.array([spot for spot, _ in self.task.fixed], dtype=np.int32)
        self._markers = np.array([marker for _, marker in self.task.fixed], dtype=np.int32)
        self._leads = [n for n in plane.leads if n > self._spots.max()]

    @property
    def best(self) -> Candidate | None:
        """The best candidate that has the labels; without one, the best that has not."""
        return next(iter([*self.top(1), *self.contradictions(1)]), None)

    def top(self, count: int) -> list[Candidate]:
        """The best distinct candidates that have the labels, best first."""
        kept = [c for c in self._all() if self.task.keeps(c.match)]
        distinct: list[Candidate] = []
        for candidate in kept:
            if not any(candidate.like(better) for better in distinct):
                distinct.append(candidate)
        return distinct[:count]

    def contradictions(self, count: int) -> list[Candidate]:
        """The best candidates that do not have all labels."""
        return [c for c in self._all() if not self.task.keeps(c.match)][:count]

    def batches(self) -> Iterator[int]:
        """Poses from the labels, triplets headed by a label, then the search without them."""
        for lead in self._leads:
            if len(self._spots) >= 3:
                self._from_labels(lead)
                yield self._tried
            for stage in STAGES:
                for spot, marker in self.task.fixed:
                    self._headed(lead, stage, spot, marker)
                    yield self._tried
        for _ in self._free.batches():
            yield self._tried

    def rivals(self, candidate: Candidate, over: Callable[[], bool]) -> bool:
        """See `QuadSearch.rivals`: also those that contradict the labels."""
        return self._free.rivals(candidate, over)

    @property
    def _tried(self) -> int:
        return self.links + self._free.links

    def _all(self) -> list[Candidate]:
        return sorted([*self.pool.items, *self._free.top(self.pool.size)], key=lambda c: -c.score)

    def _from_labels(self, lead: int) -> None:
        """P3P on triplets of labels; every pose starts with all of them."""
        picture = self.plane.picture(lead)
        triplets = np.array(list(combinations(range(len(self._spots)), 3)), dtype=np.int64)
        xyz = self.model.xyz[self._markers]
        width = interior_angles(xyz[triplets]).min(axis=1) * np.linalg.norm(np.ptp(xyz[triplets], axis=1), axis=1)
        triplets = triplets[np.argsort(-width, kind="stable")[:TRIPLETS]]
        found, pairs, h = 0, min(len(self._spots), PAIRS), self._hypotheses
        nearest, start = np.inf, None
        for focal in self._focals:
            p = picture.p[self._spots]
            rays = np.concatenate([p / focal, np.ones((len(p), 1))], axis=1)
            solutions = p3p(rays[triplets], xyz[triplets])
            for pose in (pose for n in range(len(triplets)) for pose in solutions.poses(n)):
                if found == ROOM:
                    break
                h.rotation[found], h.translation[found], h.focal[found] = pose.rotation, pose.translation, focal
                h.marker[found, :pairs], h.spot[found, :pairs] = self._markers[:pairs], self._spots[:pairs]
                h.pairs[found] = pairs
                found += 1
                seen = pose.apply(xyz)
                off = float(np.median(np.linalg.norm(focal * seen[:, :2] / seen[:, 2:] - p, axis=1)))
                if off < nearest:
                    nearest, start = off, (pose, float(focal))
        self.links += found
        self._grow(picture, found)
        if len(self._spots) > 3 and start is not None and nearest < self.task.tolerance_px and not self.top(1):
            self._take(*start)

    def _take(self, pose: Pose, focal: float) -> None:
        """The labels alone as a candidate worth a verdict: growth gives up where most markers are missing."""
        match = np.full(len(self.model.xyz), -1, dtype=np.int32)
        match[self._markers] = self._spots
        whole = self.plane.frame.pose(pose.rotation, pose.translation)
        if self.task.allows(whole, focal):
            self.pool.add(Candidate(whole, focal, self._stop_at + 1.0, len(self._spots), match))

    def _headed(self, lead: int, stage: tuple[int, int], spot: int, marker: int) -> None:
        """Triplets of a labelled marker and two of its neighbours against its spot and two of its neighbours."""
        picture = self.plane.picture(lead)
        triplets = marker_triplets(self.model, stage[0], every_corner=True)
        triplets = np.ascontiguousarray(triplets[triplets[:, 0] == marker])
        if not len(triplets):
            return
        reach = min(stage[1], picture.near.shape[1])
        self._try(_Batch(picture, triplets, turns_of(self.model, triplets), np.array([spot], dtype=np.int32), reach))
