"""The search of one camera: links of spots to markers are tried, and the best distinct solutions are kept.

It goes on after a good solution as long as the caller asks: "stop at the first good pose" is the trap of regular
layouts. `Search.rivals` looks for others on purpose. What is tried, in which order, is in `search.trials`.

``method="ransac"`` is the search of AIAA 2005-5007, section III.C, steps 1 to 9, with these differences:

- The image triplets of step 2 are not all, but those among a spot's nearest neighbours, few first: three
  neighbouring markers are seen as three neighbouring spots, and their pose predicts the next neighbours well.
- Step 4 judges by likelihood, nearest markers first, and gives up or goes on early.
- Steps 7 to 9 do not stop at "all matched": on near-regular rows the mirrored or shifted labelling comes first
  as often as the right one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.options.registration import METHOD
from windmark.registration._kernels.growth import grow
from windmark.registration._kernels.hypothesis import Picture
from windmark.registration._kernels.match import search_kernel
from windmark.registration._kernels.rival import made_kernel, rivals_kernel
from windmark.registration.budget import LINK, Budget
from windmark.registration.labelled import poses_of
from windmark.registration.search import links
from windmark.registration.search.layout import REACHES
from windmark.registration.search.plane import Plane
from windmark.registration.search.pool import Candidate, Pool, is_rival
from windmark.registration.search.trials import CHECKS, PRIOR_SLACK, STAGES, WORK, Trial, Trials
from windmark.registration.task import with_focal

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

Made = tuple[Array, Array, float, Ints]
"""Poses (S, 3, 3), (S, 3), a focal length and labels (S, N) that solutions may be grown from."""

LABEL_POSES, LABEL_TRIPLETS = 4, 4
"""Poses taken from labels, as three of them leave so many, and the triplets of labels that they come from."""
POOL = 12
"""Solutions kept."""
RIVAL_TURNS = 3
"""After so many times this work no more rivals are looked for; the near-symmetries have made the likely ones before."""
RIVAL_NEAR, RIVAL_QUADS = 6, 24
"""Neighbours and number of the quads that rivals are looked for with."""
LEAST_SPOTS = 5
"""So many spots at least make a solution."""
COPIES = 4
"""Solutions kept of those among the spots that one leaves."""
COPY_WORK = 40_000
"""Links tried for them at least; or as many as all quads of the nearest spots have (`attacks`: copies)."""
COPY_CHECK = 4.0
"""The anchor of their quads must lie within so many times the misfit of the solution they are looked for beside."""
COPY_HALF = 0.5
"""Part of a copy's markers that must be seen for it to be met by the nearest spots' quads (see `Search.copies`)."""


class Search:
    """The state of one search: the kernels' view of the task, the best solutions, the number of links tried.

    Parameters
    ----------
    plane : task and search plane
    stop_at : search score (nats) from which a solution is shown to the caller at once
    method : see `register`
    wide : neighbourhoods may look weak, and quads may reach far: for a rig's cameras
    seed : of the order of the paper's triplets
    """

    def __init__(
        self, plane: Plane, stop_at: float, *, method: str = METHOD.default, wide: bool = False, seed: int = 0,
        budget: Budget | None = None,
    ) -> None:  # fmt: skip
        self.plane, self.task, self.links, self._work, self._budget = plane, plane.task, 0, 0.0, budget or Budget()
        self._stop_at = stop_at
        self._focals = plane.task.camera.focal_px * np.array(plane.task.focal_factors)
        self._free, self._bound = (Pool(plane.frame, POOL, len(plane.task.markers)) for _ in range(2))
        self._trials = Trials(plane, method, wide, seed, self._budget, self._free, self._bound)
        self._gates = self._trials.gates
        self._moved: Candidate | None = None

    # --- candidates ----------------------------------------------------------------------
    @property
    def best(self) -> Candidate | None:
        """The best candidate that has the labels; without one, the best that has not."""
        return next(iter(self.top(1) or self.contradictions(1)), None)

    def top(self, count: int, within: float = np.inf) -> list[Candidate]:
        """The best distinct candidates that have the labels, best first, see `Pool.top`."""
        if not self.task.fixed:
            return self._free.top(count, within)
        distinct: list[Candidate] = []
        for new in self._all():
            if self.task.keeps(new.match) and not any(
                new.is_like(old.cam_from_model.rotation, old.match, old.count) for old in distinct
            ):
                distinct.append(new)
        best = distinct[0] if distinct else None
        return [c for c in distinct[:count] if best and is_rival(c.score, c.count, best.score - within, best.count)]

    def contradictions(self, count: int) -> list[Candidate]:
        """The best candidates that do not have all labels."""
        return [c for c in self._all() if not self.task.keeps(c.match)][:count]

    def _all(self) -> list[Candidate]:
        return sorted([*self._bound.top(), *self._free.top()], key=lambda c: -c.score)

    # --- the search ----------------------------------------------------------------------
    def batches(self) -> Iterator[int]:
        """Yields the links tried so far; the caller looks at the candidates after each batch."""
        if len(self.task.fixed) >= 3:
            self._by_labels()
            yield self.links
        for trial in self._trials.all():
            start = 0
            while start < len(trial.links.spots):
                start = self._try(trial, start)
                if self.task.fixed:
                    self._move_to_labels()
                yield self.links

    def _try(
        self, trial: Trial, start: int, *, work: float = WORK, stop_at: float | None = None, known: Ints | None = None
    ) -> int:  # fmt: skip
        """Try links from these spots on; the spots to go on with. Pairs of ``known`` solutions are left out."""
        best = trial.pool.best
        start, tried, done = search_kernel(
            self.plane.model, trial.picture, trial.rules, trial.gates, trial.links, self._focals, start,
            max(int(work / trial.price), 1), self._stop_at if stop_at is None else stop_at, best,
            best.match if known is None else known,
        )  # fmt: skip
        work = LINK * (done + (trial.price - 1) * tried)
        self.links, self._work = self.links + int(tried), self._work + work
        self._budget.spend(work)
        return int(start)

    def _by_labels(self) -> None:
        """Poses from three labels or more: solutions worth a verdict by themselves, grown."""
        task, (spots, markers) = self.task, np.array(self.task.fixed, dtype=np.int32).T
        match = np.full(len(self.plane.model.xyz), -1, dtype=np.int32)
        match[markers] = spots
        cameras = [with_focal(task.camera, focal) for focal in self._focals]
        picture, count = self.plane.picture(len(task.xy)), len(spots)
        poses = poses_of(task.xy[spots], task.markers.xyz[markers], cameras, triplets=LABEL_TRIPLETS)
        near = [(c, pose) for off, c, pose in poses if off < task.tolerance_px and task.allows(pose, c.focal_px)]
        for camera, pose in near[:LABEL_POSES]:
            (r, t), new = (part.copy() for part in self.plane.frame.unit(pose)), match.copy()
            score, focal, _ = grow(self.plane.model, picture, self._gates, new, r, t, camera.focal_px, count)
            if score > -np.inf and task.keeps(new):
                self._bound.add(r, t, focal, score, new)
        if near and count > 3:
            # Growth gives up where most markers are missing, but so many labels check each other.
            camera, pose = near[0]
            self._bound.add(*self.plane.frame.unit(pose), camera.focal_px, self._stop_at + 1.0, match)

    # --- other solutions on purpose ------------------------------------------------------
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
        made, keeps = self._made_of(candidate)
        # Those that have the labels have places of their own: a regular layout has many shifts that lack them.
        places = ((self._bound, keeps), (self._free, ~keeps)) if self.task.fixed else ((self._free, keeps),)
        if any(self._grown(picture, made, these, pool) for pool, these in places):
            return True
        others = _without(len(picture.p), spots)
        table, check = self.plane.layout.table(REACHES[1]), self._trials.check(CHECKS[-1])
        # The candidate itself may have grown from a bad start: it is grown again from its quads.
        same = (self._free.best.match == candidate.match).all(axis=1)
        known = np.where(same[:, None], np.int32(-1), self._free.best.match)
        for some, most in ((spots, RIVAL_QUADS), (others, RIVAL_QUADS // 2)):
            if len(some) < 4:
                continue
            trial = self._trials.of(picture, links.compact_links(picture, some, RIVAL_NEAR, most, table, check))
            start = 0
            for _ in range(RIVAL_TURNS):
                if over():
                    return False
                start = self._try(trial, start, stop_at=np.inf, known=known)
                if start == len(trial.links.spots):
                    break
        if self.task.fixed:
            self._move_to_labels()
        return True

    def _move_to_labels(self) -> None:
        """What contradicts the labels, or some of them, may be brought to them by a near-symmetry of the model."""
        best = next(iter(self.contradictions(1)), None)
        if best is None or best is self._moved or best.score < self._stop_at:
            return
        self._moved, (made, keeps) = best, self._made_of(best)
        self._grown(self.plane.picture(len(self.task.xy)), made, keeps, self._bound)

    def _grown(self, picture: Picture, made: Made, these: NDArray[np.bool_], pool: Pool) -> bool:
        """Grow some (S,) of what is made of a candidate into a pool; whether one beats it by far."""
        r, t, focal, match = made
        these = np.concatenate([[True], these[1:]])  # the first one is its own
        work, beaten = rivals_kernel(
            self.plane.model, picture, self._gates, pool.best, r[these], t[these], focal, match[these]
        )
        self._budget.spend(LINK * work)
        return bool(beaten)

    def _made_of(self, candidate: Candidate) -> tuple[Made, NDArray[np.bool_]]:
        """Poses and labels that start from a candidate: its own, what the near-symmetries make of it, and the other
        pose that sees nearly flat markers almost the same, mirrored in their plane and across the line of sight; and
        which of them have the labels, as far as they go.

        With a prior only those that lead to a pose it allows: a regular grid has many, and the others would take all
        the places that are kept for rivals.
        """  # fmt: skip
        task, (rotation, translation) = self.task, self.plane.frame.unit(candidate.cam_from_model)
        onto, turn, shift = self.plane.layout.symmetries_with(task.label_of(candidate.match))
        if task.prior is not None:
            cosine = (np.einsum("ik,sjk,ij->s", rotation, turn, task.prior.rotation) - 1) / 2
            allowed = cosine > np.cos(min(task.prior_max_angle_rad + PRIOR_SLACK, np.pi)) - 1e-9
            onto, turn, shift = onto[allowed], turn[allowed], shift[allowed]
        poses, places, match = made_kernel(
            self.plane.model.xyz, rotation, translation, candidate.match, onto, turn, shift
        )  # fmt: skip
        keeps = np.array([task.may_keep(one) for one in match]) if task.fixed else np.ones(len(match), dtype=bool)
        return (poses, places, candidate.focal_px, match), keeps

    def copies(self, candidate: Candidate, over: Callable[[], bool], misfit_px: float = 0.0
    ) -> tuple[list[Candidate], float]:  # fmt: skip
        """Look for another solution among the spots that a candidate does not explain: a second copy of the model.

        A reflection, a ghost of a double exposure or a second model leaves spots of its own, which neighbour each other
        when the explained ones are taken away. Every spot in turn is the anchor of a quad, those whose key fewest quads
        of markers share first, checked as sharply as the candidate fits, until one grows to a solution of most of these
        spots that is worth a verdict; what four of few spots grow to by chance is not. It is grown among them alone, or
        the copy beside it would take it over, and however few of its markers it has: the rest may be hidden in one
        piece. The work is that of all quads of the nearest spots: with them and the first of the others a half-hidden
        copy among as many false spots is met in 92 of 100 pictures, one in one piece in 98.

        Returns
        -------
        What was found, though the candidate's own rivals may be worth more than it; and the part of a copy's markers in
        view that must be seen for it to be met: 0 where all quads were tried or one was met, 1 where the work was
        ``over`` before.
        """
        spots = _without(len(self.task.xy), candidate.match[candidate.match >= 0])
        if len(spots) < LEAST_SPOTS:
            return [], 0.0
        picture, found = self.plane.part(spots), Pool(self.plane.frame, COPIES, len(candidate.match))
        best, table = found.best, self.plane.layout.table(REACHES[0])
        check = np.clip(COPY_CHECK * misfit_px, self._trials.check(CHECKS[0]), self._trials.check(CHECKS[1]))
        near, far = (links.quad_links(picture, table, low, high, check) for _, low, high in STAGES[:2])
        self._budget.spend(LINK * len(spots) * STAGES[1][2] ** 3 / 12)
        gates = self._gates._replace(least_part=0.0)
        trial = self._trials.of(picture, links.in_turn(near, far), pool=found, gates=gates)
        start, most, met = 0, self._work + LINK * max(COPY_WORK, int((near.last - near.first).sum())), False
        while start < len(trial.links.spots) and self._work < most and not met:
            if over():
                return [], 1.0
            start = self._try(trial, start, work=most - self._work)
            met = bool((2 * best.matched[best.score > self._stop_at] >= len(spots)).any())
        copies = []  # labels say which one is meant
        for one in found.top():
            match = np.where(one.match >= 0, spots[one.match], -1).astype(np.int32)
            self._free.add(*self.plane.frame.unit(one.cam_from_model), one.focal_px, one.score, match)
            if self.task.keeps(match):
                copies.append(replace(one, match=match))
        return copies, 0.0 if met or start == len(trial.links.spots) else COPY_HALF


def _without(count: int, some: Ints) -> Ints:
    """Numbers below ``count`` but some, each of them once."""
    if len(some) == count:
        return np.zeros(0, np.int32)
    free = np.ones(count, dtype=bool)
    free[some] = False
    return free.nonzero()[0].astype(np.int32)
