"""Whether the cameras of a rig agree: one that is not where it is said, or that shows nothing where the others see.

A camera's place is six more unknowns. Where it is far off, its own labelling says where; so nothing is looked for: the
labels that are best for it are put beside those that are best for the others, and all settle together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtr

from windmark.errors import g2
from windmark.geometry import Pose
from windmark.registration import rules
from windmark.registration.cached import cached_property
from windmark.registration.judge.doubts import EXCHANGED, OtherCamera, fits_slightly
from windmark.registration.judge.exact import of_places
from windmark.registration.judge.first_order import FirstOrder
from windmark.registration.judge.own import is_loose
from windmark.registration.judge.rig_lengths import Lengths, other_lengths, sees_more
from windmark.registration.judge.source import CONFIRMED
from windmark.registration.result import Unchecked
from windmark.registration.search.pool import Candidate
from windmark.registration.settle._kernels.doubt import doubt_kernel
from windmark.registration.settle._kernels.state import EXPECTED
from windmark.registration.settle.settling import accepted, copied, settle, settle_state, with_freedom
from windmark.registration.settle.solution import Solution
from windmark.registration.settle.views import Views, doubted_camera, doubted_place
from windmark.registration.task import MIN_COUNT

Array = NDArray[np.float64]

ANYWHERE = 1.0
"""1 sigma of the place of a camera that is doubted: radians, and part of its distance."""
SMALL = 0.005
"""Part of that by which a camera may be off that was only touched: small, but more than rigs are uncertain by."""
UNLIKELY = 1e-3
"""A camera contradicts a solution where so few pairs are less likely than this by what the other cameras see, ..."""
SEEN_LEAST, SEEN_MOST = 0.25, 0.95
"""... at least and at most this part of the markers."""
SLIGHT = np.array([1e-5, 3e-5, 1e-4, 3e-4, 1e-3, 3e-3])
"""1 sigma of places that may be slightly off: radians, and parts of the distance."""
TOUCHED = 1e-3
"""Degrees, and percent of its distance, from which on a camera's motion is worth a word."""
PLACE = "place in the rig"


@dataclass(frozen=True, eq=False)
class Elsewhere:
    """A solution with camera ``c`` where its own labels put it, and the one that has the camera as given."""

    c: int
    solution: Solution
    base: Solution

    @property
    def what(self) -> str:
        """What of the camera is another one in it."""
        same = np.array_equal(self.solution.state.camera[self.c], self.base.state.camera[self.c])
        return PLACE if same else "focal length"

    @property
    def words(self) -> str:
        """How far it is off, and what it shows there."""
        c, found, base = self.c, self.solution, self.base
        shows = f"the misfit falls from {g2(base.misfit_px.max())} to {g2(found.misfit_px.max())} px"
        if base.counts[c] < found.counts[c]:
            of = int(found.state.numbers[c, EXPECTED])
            shows = f"it shows {found.counts[c]} of {of} markers, not {base.counts[c]}"
        if self.what != PLACE:
            return f"with a focal length of {found.camera(c).focal_px:.5g} px for {base.camera(c).focal_px:.5g} {shows}"
        given, place = base.views.cam_from_rig[c], found.cam_from_model(c) @ found.rig_from_model.inverse()
        middle = found.views.planes[c].task.markers.xyz.mean(axis=0)
        distance = float(np.linalg.norm(found.cam_from_model(c).apply(middle)))
        moved = float(np.linalg.norm(place.center - given.center)) / distance
        turned = np.degrees(place.angle_to(given))
        by = [f"turned by {g2(turned)} degrees"] if turned > TOUCHED else []
        by += [f"moved by {g2(100 * moved)} % of its distance"] if 100 * moved > TOUCHED else []
        return f"{' and '.join(by) or 'nearly there'} {shows}"


@dataclass(frozen=True, eq=False)
class Places:
    """What a solution of a rig leaves to doubt of its cameras' places.

    Parameters
    ----------
    best : the solution
    margin : lead (nats) that counts as one
    """

    best: Solution
    margin: float

    @cached_property
    def _first(self) -> FirstOrder:
        views, columns = self._opened(ANYWHERE), self.best.views.loose.shape[2]
        normal, side = doubt_kernel(views.sights, copied(views, self.best.state))
        asked = [6 + c * (columns + 6) + columns + k for c in range(len(views.planes)) for k in range(6)]
        return FirstOrder(normal, side, np.array(asked))

    @property
    def _distances(self) -> Array:
        """(C,) of the model from the cameras, in its sizes."""
        return np.asarray(np.linalg.norm(self.best.state.translations, axis=1))

    @property
    def _given_places(self) -> list[tuple[Array, float]]:
        """Of each camera its place in the rig, in sizes of the model, and its distance from the model."""
        return list(zip(self.best.views.sights.translation, self._distances.tolist(), strict=True))

    def _opened(self, sigma: float) -> Views:
        """The views with the places of all cameras known to so many radians and parts of their distance."""
        return self.best.views.opened([doubted_place(sigma, sigma * d) for d in self._distances])

    @cached_property
    def _is_loose(self) -> bool:
        """Whether the residuals are so large that what they say to first order is lost in their excess."""
        return any(is_loose(self.best, c) for c in range(len(self.best.counts)))

    def displaced(self, solutions: Sequence[Solution], seen: Sequence[Candidate | None]) -> OtherCamera | None:
        """A camera that is elsewhere, if with it there the spots are explained better by the margin than by this one.

        Where it may as well be another one, as of two cameras always, both are named; where two are in each other's
        place, that. ``solutions`` are others of the rig, ``seen`` what each camera by itself sees best.
        """
        found = [
            other for c in range(len(self.best.counts))
            if (other := self._elsewhere([self.best, *solutions], seen[c], c)) is not None
            and other.solution.evidence > self.best.evidence + self.margin
        ]  # fmt: skip
        lengths = self._lengths(seen)
        if not found and lengths is None:
            return None
        most = max((e.solution.evidence for e in found), default=-np.inf)
        if lengths is not None and lengths.evidence > most - self.margin:
            return OtherCamera(PLACE, lengths.words, lengths.solution, fits_slightly(self.best))
        exchanged = [of for pair in combinations(range(len(seen)), 2) if (of := self._exchanged(seen, *pair))]
        if exchanged:
            words, solution = max(exchanged, key=lambda of: of[1].evidence)
            if solution.evidence > most - self.margin:
                return OtherCamera(EXCHANGED, words, solution, is_slight=False)
        if len(self.best.counts) > 2:
            found = [e for e in found if e.solution.evidence > most - self.margin]
        shown = all(e.base.scores[e.c] > CONFIRMED for e in found)
        best = max(found, key=lambda e: e.solution.evidence)
        return OtherCamera(best.what, _named(found), best.solution, shown and fits_slightly(self.best))

    def _lengths(self, seen: Sequence[Candidate | None]) -> Lengths | None:
        """Other lengths of the rig, if with them the spots are explained better by the margin."""
        by_all = np.concatenate([np.r_[np.zeros(3), t / d] for t, d in self._given_places])
        step, told = self._first.along(by_all)
        promised = self._is_loose or 0.5 * (told * step**2 - np.log1p(told)) > rules.DOUBT
        if not promised and not sees_more(self.best, seen):
            return None
        found = other_lengths(self.best, seen)
        return found if found is not None and found.evidence > self.best.evidence + self.margin else None

    def _elsewhere(self, solutions: Sequence[Solution], seen: Candidate | None, c: int) -> Elsewhere | None:
        """What explains most in the other cameras, with camera c where the labels that are best for it put it."""
        base = max(solutions, key=lambda s: s.score - s.scores[c])
        own = max(solutions, key=lambda s: s.scores[c])
        match, there, nuisance = own.state.match[c], own.cam_from_model(c), own.state.nuisance[c]
        at = own.state.rotations[c], match, int(own.counts[c])
        if seen is not None and seen.score > own.scores[c] + self.margin and not seen.is_like(*at):
            match, there, task = seen.match, seen.cam_from_model, base.views.planes[c].task
            nuisance = np.zeros_like(nuisance)
            if task.free_focal:
                nuisance[0] = np.log(seen.focal_px / task.camera.focal_px) / task.focal_sigma
        elif own is base and not (self._is_loose or self._first.gain(6 * c, 6 * c + 6) > rules.DOUBT):
            return None
        if (match >= 0).sum() < MIN_COUNT or base.count == base.counts[c]:
            return None
        given, place = base.views.cam_from_rig[c], there @ base.rig_from_model.inverse()
        turned = Pose(place.rotation, -place.rotation @ given.center)
        shifted = Pose(given.rotation, -given.rotation @ place.center)
        turn, shift = np.split(doubted_place(ANYWHERE, ANYWHERE * self._distances[c]), 2, axis=1)
        focal = doubted_camera(base.views.planes[c].task.camera)[:, :1]
        found = []
        far = ((place, np.hstack([turn, shift])), (turned, turn), (shifted, shift), (given, focal))
        for pose, column in (*far, (given, SMALL * turn), (given, SMALL * shift)):
            columns = [column[:, : column.shape[1] * (k == c)] for k in range(len(base.counts))]
            views = base.views.with_place(c, pose).opened(columns)
            state = copied(views, base.state)
            state.match[c], state.nuisance[c, : len(nuisance)] = match, nuisance
            if (solution := settle_state(views, state)) is not None:
                found.append(Elsewhere(c, solution, base))
        return max(found, key=lambda e: e.solution.evidence, default=None)

    def _exchanged(self, seen: Sequence[Candidate | None], a: int, b: int) -> tuple[str, Solution] | None:
        """What all see where cameras a and b are in each other's place; None where that does not hold together."""
        views = self.best.views
        own, other = seen[a], seen[b]
        if own is None or other is None:
            return None
        # Places are never known so well that the exchange could vie with a place that is free.
        places = self._opened(SLIGHT[-1]).with_place(a, views.cam_from_rig[b]).with_place(b, views.cam_from_rig[a])
        start = views.layout.frame.unit(places.cam_from_rig[a].inverse() @ own.cam_from_model)
        match = np.stack([m if s is None else s.match for m, s in zip(self.best.state.match, seen, strict=True)])
        solution = settle(places, *start, match, anywhere=True)
        if solution is None:
            return None
        shows = " and ".join(f"{solution.counts[c]} of {int(solution.state.numbers[c, EXPECTED])}" for c in (a, b))
        words = (
            f"camera {views.names[a]} and camera {views.names[b]} are exchanged: where cam_from_rig has the other, "
            f"they show {shows} markers"
        )
        return words, solution

    def slightly_off(self) -> tuple[Solution | None, list[Unchecked]]:
        """A solution with places that are as uncertain as the residuals say, and what that is; where they fit none, and
        what places would do that are not exact though they fit.
        """
        if not self._is_loose and self._first.gains(SLIGHT).max() < rules.DOUBT:
            return None, self._exact()
        found = [
            (other.evidence, float(sigma), other) for sigma in SLIGHT
            if (other := with_freedom(self._opened(sigma), self.best)) is not None
        ]  # fmt: skip
        evidence, sigma, beside = max(found, key=lambda f: f[0], default=(-np.inf, 0.0, self.best))
        if evidence < self.best.evidence + rules.DOUBT:
            return None, self._exact()
        most = self.best.views.names[int((beside.state.nuisance[:, -6:] ** 2).sum(axis=1).argmax())]
        words = (
            f"the cameras seem to be off their places by {g2(np.degrees(sigma))} degrees and {g2(100 * sigma)} % of "
            f"their distance (1 sigma), this one most; the sigma of the pose has what that would change"
        )
        return beside, [Unchecked(PLACE, words, most)]

    def _exact(self) -> list[Unchecked]:
        """What is to be said of places that are taken as exact."""
        best = accepted(self.best)
        return of_places(best, Places(best, self.margin)._first, PLACE)

    def unchecked(self) -> list[Unchecked]:
        """Cameras of which these pictures would not show that they are elsewhere."""
        views, found = self.best.views, []
        for c in np.flatnonzero([len(plane.task.xy) > 0 for plane in views.planes]).tolist():
            turn = max(self._first.shown(6 * c + k, self.margin) for k in range(3))
            if turn * ANYWHERE > rules.CHECKED[PLACE]:
                words = f"whether it is where cam_from_rig says ({self.best.counts[c]} of its spots are markers)"
                found.append(Unchecked(PLACE, words, views.names[c]))
        return found


def _named(displaced: Sequence[Elsewhere]) -> str:
    """Which camera is another one, in words: of two it may always be the other one."""
    names = displaced[0].base.views.names
    either = [f"camera {name}" for c, name in enumerate(names) if len(names) == 2 or c in [e.c for e in displaced]]
    which = ", but which of them cannot be told" if len(either) > 1 else ""
    wrong = sorted({"where cam_from_rig says" if e.what == PLACE else "the one that is given" for e in displaced})
    each = "; or ".join(f"camera {names[e.c]} {e.words}" for e in displaced)
    return f"{' or '.join(either)} is not {' or '.join(wrong)}{which}: {each}"


def blocked(best: Solution, c: int) -> str:
    """Why camera c cannot have seen the model where the others see it; empty if it can."""
    spots = len(best.views.planes[c].task.xy)
    if spots < MIN_COUNT or best.scores[c] > CONFIRMED:
        return ""
    counts, expected = best.counts, best.state.numbers[:, EXPECTED]
    could = min(int(expected[c]), spots)
    rest, of = best.count - int(counts[c]), best.expected - int(expected[c])
    share = min(SEEN_MOST, max(SEEN_LEAST, (rest + 1) / (of + 2)))
    if could == 0 or of == 0 or bdtr(int(counts[c]), could, share) > UNLIKELY:
        return ""
    return (
        f"shows {counts[c]} of {expected[c]:.0f} markers among its {spots} spots where the others see {rest} of {of}: "
        "its cam_from_rig or focal length is wrong, or its view is blocked; leave it out if so"
    )
