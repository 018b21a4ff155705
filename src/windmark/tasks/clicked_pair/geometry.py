"""The geometry of two pictures from matched spots, with cameras or without."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from windmark.epipolar import match_known_pair
from windmark.geometry import Camera, Pose
from windmark.geometry.two_view import (
    ByOthers,
    Fundamental,
    TwoView,
    epipolar_distance,
    essential_from_poses,
    estimate_two_view,
    fundamental_by_others,
    fundamental_eight_point,
    fundamental_from_essential,
    pose_by_others,
    refine_fundamental,
    sampson_distance,
)  # fmt: skip
from windmark.scene import Detections
from windmark.scene.detections import middle_sigma

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

SIGMA_PX, MODEL_PX = 1.0, 0.1
"""1 sigma per coordinate of matches without a camera, for a lens that nothing describes; and what a camera's model
leaves beyond the spots' own."""
MANY, MOST, MOST_SIGMAS = 20, 0.8, 1.2816
"""Matches that tell what a camera's model leaves: the part of them that decides, and how many sigmas that is."""
BY_HAND = 7
"""Clicks of which two check the geometry that five fix."""
FEW = 40
"""Up to so many matches, every way to leave some out is tried."""
READING = 1.3
"""Of two readings of a plane the one that matches so many times more spots is taken."""


@dataclass(frozen=True)
class Geometry:
    """F on pixels without lens distortion, which of the given matches agree, and what else a way to it gives."""

    matrix: Array
    used: Mask
    sigma0: float
    pose: Pose | None = None
    pose_cov: Array | None = None
    estimate: Fundamental | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Job:
    """Two pictures, with cameras or without.

    ``model_px``: what a camera's model leaves beyond the spots' own sigma, as far as the matches have told it.
    """

    a: Detections
    b: Detections
    cameras: tuple[Camera, Camera] | None
    sigma_px: float | None
    seed: int
    model_px: float = MODEL_PX

    def geometry(self, i: Ints, j: Ints, *, by_hand: bool = False) -> Geometry | str:
        """The geometry of matched spots; or why there is none.

        Of those made ``by_hand`` all are taken where there is a geometry with which they all agree. Of rows along the
        epipolar lines the wrong partners agree, too, and nothing but the hand says that these do not by chance.
        """
        if self.cameras is None:
            return self._fundamental(i, j)
        if len(i) < 6:  # six of them agree by chance once in ten
            return f"{len(i)} matches; with a camera seven are needed (five fix the geometry, others check it)"
        view = self._two_view(i, j)
        if by_hand and len(i) >= BY_HAND and not (view and view.inliers.all()):
            every = self._two_view(i, j, right=True)
            view = every if every and every.inliers.all() else view
        if not view:
            return f"the matches give no geometry: {view.reason}"
        if view.b_from_a is None:
            return f"no baseline shows: {view.reason}; the pictures must be taken from different places"
        if int(view.inliers.sum()) - 5 < 1:
            return f"{int(view.inliers.sum())} matches agree: five fix the geometry, and nothing checks it; add matches"
        pose, note = self._reading(view, i[view.inliers], j[view.inliers])
        if pose is None:
            return note
        matrix = fundamental_from_essential(essential_from_poses(pose), *self.cameras)
        return Geometry(matrix / np.linalg.norm(matrix), view.inliers, view.sigma0, pose, view.cov, None,
                         (note,) if note else ())  # fmt: skip

    def _two_view(self, i: Ints, j: Ints, *, right: bool = False) -> TwoView:
        """Of matches that are known to be ``right``, or of which some may be wrong."""
        assert self.cameras is not None
        estimate = partial(estimate_two_view, max_log10_nfa=np.inf) if right else estimate_two_view
        return estimate(
            self.a.xy[i], self.b.xy[j], *self.cameras, cov_a=self.a.cov[i] + self._extra,
            cov_b=self.b.cov[j] + self._extra, seed=self.seed,
        )  # fmt: skip

    def _reading(self, view: TwoView, i: Ints, j: Ints) -> tuple[Pose | None, str]:
        """The pose; of several that explain the matches the one along whose lines far more spots match."""
        assert view.b_from_a is not None
        if not view.alternatives:
            return view.b_from_a, ""
        every = (view.b_from_a, *view.alternatives)
        counts = [len(self._known(pose, view.cov, i, j)[0]) for pose in every]
        order = np.argsort(counts)[::-1]
        if counts[order[0]] < READING * counts[order[1]]:
            return None, (
                f"{view.reason or 'two poses explain the matches'}, and the other spots do not decide "
                f"({counts[order[0]]} and {counts[order[1]]} match); add matches off the plane"
            )
        return every[order[0]], f"{view.reason}: the one along whose lines more spots match was taken"

    def _fundamental(self, i: Ints, j: Ints) -> Geometry | str:
        sigma = self.sigma_px or SIGMA_PX
        a, b = self.a.xy[i], self.b.xy[j]
        if len(i) <= FEW:
            done = refine_fundamental(a, b, sigma_px=sigma)
            return Geometry(done.matrix, done.used, done.sigma0, estimate=done) if done else done.reason
        use = np.arange(len(i))
        while True:  # many: the worst one leaves until the rest agree
            done = refine_fundamental(a[use], b[use], sigma_px=sigma, most_wrong=0)
            if done or done.suspects or len(use) < 0.8 * len(i) or "homography" in done.reason:
                break
            off = np.abs(sampson_distance(fundamental_eight_point(a[use], b[use]), a[use], b[use]))
            use = np.delete(use, int(off.argmax()))
        if not done:
            return done.reason
        used = np.zeros(len(i), bool)
        used[use] = True
        return Geometry(done.matrix, used, done.sigma0, estimate=done)

    def learned(self, geometry: Geometry, i: Ints, j: Ints) -> Job:
        """The same with the error that these matches show, where that is less than is taken beforehand.

        A wrong match a few tenths of a pixel off its line is no chance where the others are on theirs to a hundredth.
        What a camera leaves need not be the same all over the picture: most of the matches decide, not their middle.
        """
        if self.cameras is None or self.sigma_px is not None or len(i) < MANY:
            return self
        own = self.own_px(i, j)
        seen = float(np.quantile(np.abs(self.distance(geometry, i, j)), MOST)) / MOST_SIGMAS
        seen *= np.sqrt(len(i) / (len(i) - 5))
        return replace(self, model_px=min(MODEL_PX, max(float(np.sqrt(max(seen**2 - own**2, 0.0))), own)))

    def own_px(self, i: Ints, j: Ints) -> float:
        """1 sigma per coordinate of the matched spots, of the middle one."""
        return middle_sigma(np.concatenate([self.a.cov[i], self.b.cov[j]]))

    def distance(self, geometry: Geometry, i: Ints, j: Ints) -> Array:
        """Signed distance of matches from their lines, px."""
        if self.cameras is None or geometry.pose is None:
            return sampson_distance(geometry.matrix, self.a.xy[i], self.b.xy[j])
        return epipolar_distance(self.a.xy[i], self.b.xy[j], *self.cameras, geometry.pose).sampson_px

    def matched(
        self, geometry: Geometry, clicks: tuple[Ints, Ints], found: tuple[Ints, Ints]
    ) -> tuple[Ints, Ints, Mask]:
        """All matches along the lines of cameras: clicks, unless their neighbours' depths contradict them, what was
        found before, and what is found now; and which clicks are contradicted.
        """  # fmt: skip
        assert geometry.pose is not None
        i, j, contradicted = self._known(geometry.pose, geometry.pose_cov, *clicks)
        count = int((~contradicted).sum())
        free = ~(np.isin(found[0], i[:count]) | np.isin(found[1], j[:count]))
        before = np.concatenate([i[:count], found[0][free]]), np.concatenate([j[:count], found[1][free]])
        rest = ~(np.isin(i, before[0]) | np.isin(j, before[1]))
        return np.concatenate([before[0], i[rest]]), np.concatenate([before[1], j[rest]]), contradicted

    def _known(self, pose: Pose, cov: Array | None, i: Ints, j: Ints) -> tuple[Ints, Ints, Mask]:
        assert self.cameras is not None
        model = self.sigma_px or self.model_px
        pair = match_known_pair(
            self.a, self.b, *self.cameras, pose, pose_cov=cov, model_px=model, given=np.column_stack([i, j])
        )
        i, j = i[~pair.contradicted], j[~pair.contradicted]
        rest = ~(np.isin(pair.spot_a, i) | np.isin(pair.spot_b, j))
        return np.concatenate([i, pair.spot_a[rest]]), np.concatenate([j, pair.spot_b[rest]]), pair.contradicted

    def by_others(self, geometry: Geometry, i: Ints, j: Ints, which: Ints) -> ByOthers:
        """What all other matches say of some of them."""
        a, b = self.a.xy[i], self.b.xy[j]
        if self.cameras is None or geometry.pose is None:
            said = fundamental_by_others(a, b, geometry.matrix, sigma_px=self.sigma_px or SIGMA_PX)
            return ByOthers(said.distance_px[which], said.sigma_px[which], said.own_px[which])
        return pose_by_others(
            a, b, *self.cameras, geometry.pose, cov_a=self.a.cov[i] + self._extra, cov_b=self.b.cov[j] + self._extra,
            which=which,
        )  # fmt: skip

    @property
    def _extra(self) -> Array:
        """(2, 2) what the spots' covariances do not hold."""
        return np.asarray((self.sigma_px or self.model_px) ** 2 * np.eye(2))
