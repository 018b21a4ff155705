"""The virtual campaign: `register` on seeded views from everywhere, and what came of each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Pose
from windmark.registration import NotRegistered, Registration, prepare, register
from windmark.registration.search.layout import Layout
from windmark.tasks.marker_check.settings import FEWEST_VIEWS, VIEWS_PER_DIRECTION
from windmark.tasks.marker_check.stage import Stage

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Ints = NDArray[np.int64]
Progress = Callable[[int, int], None]

OUTCOMES = {
    "right": "identified",
    "symmetric": "ambiguous: another labelling fits as well",
    "mirrored": "ambiguous: the mirrored pose fits as well",
    "few": "too few markers in view",
    "weak": "the evidence is too weak",
    "time": "not found in the time that register takes",
    "wrong": "a wrong pose was accepted",
}
"""What can come of a view, in words."""
FEWEST_LEFT = 8.0
"""Markers that should be left in view when some are hidden; with fewer an identification is not to be expected."""
FACING = 2.0 / 3.0
"""A direction counts, unless a region is asked for, if this share of the markers seen from the best one is in sight."""
WRONG_PX = 5.0
"""A pose that displaces a marker in view by more is wrong."""
MORE_VIEWS = 9
"""Further views of a direction from which the first ones were not all identified."""
CLEAR_VIEWS = 400
"""The first round goes on up to so many views while it is not clear on which side of `GOAL` the share is."""
HOPELESS = 0.5
"""If less than this share of the views is identified, no more are made: the verdict is clear."""
GOAL = 0.98
"""Share of the views that has to be identified."""
BAD_RATE = 0.8
"""A direction from which less is identified is bad."""


@dataclass(frozen=True, eq=False)
class Trial:
    """One virtual view and what `register` made of it.

    Parameters
    ----------
    direction : index of its direction
    pose : where the camera was
    seen : (N,) markers in sight, before some are hidden
    outcome : key of `OUTCOMES`
    rival : the pose that could not be told from it, or was taken for it
    """

    direction: int
    pose: Pose
    seen: Mask
    outcome: str
    rival: Pose | None = None


@dataclass(frozen=True, eq=False)
class Campaign:
    """What came of all views.

    Parameters
    ----------
    directions : (D, 3) unit vectors from the model to the camera
    in_sight : (D,) markers that can be seen from there
    counted : (D,) bool, directions of which an identification is expected
    least : markers in sight that make a direction count
    trials : all views, the first round first
    first_round : how many of them are the first round
    """

    directions: Array
    in_sight: Ints
    counted: Mask
    least: float = 0.0
    trials: list[Trial] = field(default_factory=list)
    first_round: int = 0

    @property
    def share(self) -> float:
        """Share of the first round's views that were identified; NaN without views.

        Later rounds look at bad directions only and would bias it.
        """
        first = self.trials[: self.first_round]
        return float(np.mean([t.outcome == "right" for t in first])) if first else float("nan")

    @property
    def sigma(self) -> float:
        """1 sigma of the share, as that of a binomial one with one success and one failure more."""
        n = self.first_round + 2
        p = (np.nan_to_num(self.share) * self.first_round + 1) / n
        return float(np.sqrt(p * (1 - p) / n))

    @property
    def unclear(self) -> bool:
        """Whether some views of the first round failed, but too few to tell on which side of `GOAL` the share is."""
        return bool(
            self.first_round < CLEAR_VIEWS and self.share < 1 and abs(self.share - GOAL) < 2 * max(self.sigma, 1e-9)
        )

    @property
    def wrong(self) -> int:
        """Wrong poses that were accepted, in all rounds."""
        return self.outcomes()["wrong"]

    def views(self) -> Ints:
        """(D,) views of each direction."""
        return np.bincount([t.direction for t in self.trials], minlength=len(self.directions))

    def rate(self) -> Array:
        """(D,) share of each direction's views that were identified; NaN where none was made."""
        right = [t.direction for t in self.trials if t.outcome == "right"]
        views = self.views()
        with np.errstate(invalid="ignore"):
            return np.asarray(np.bincount(right, minlength=len(views)) / np.where(views, views, np.nan))

    def bad(self) -> Mask:
        """(D,) directions from which too few views were identified."""
        return np.asarray(self.rate() < BAD_RATE)

    @property
    def passed(self) -> bool:
        """At least 98 % of the views identified, none wrongly, and no direction that is bad."""
        return bool(self.first_round and self.share >= GOAL and not self.wrong and not self.bad().any())

    def causes(self) -> list[str]:
        """Per direction the most frequent outcome that is not "right", "" where all are right or none was made."""
        found: list[Counter[str]] = [Counter() for _ in self.directions]
        for trial in self.trials:
            if trial.outcome != "right":
                found[trial.direction][trial.outcome] += 1
        return [count.most_common(1)[0][0] if count else "" for count in found]

    def outcomes(self) -> dict[str, int]:
        """How many views came out how, all rounds."""
        count = Counter(trial.outcome for trial in self.trials)
        return {name: count[name] for name in OUTCOMES}


def run_campaign(
    stage: Stage, *, seed: int = 0, like: Campaign | None = None, only: Ints | None = None, views: int = 0,
    progress: Progress | None = None,
) -> Campaign:  # fmt: skip
    """Register virtual views from all directions.

    Parameters
    ----------
    stage : markers, camera, model, assumptions
    seed : of this campaign; the same one gives the same views
    like : a campaign of a similar layout: its directions count here too, so that both can be compared
    only : look from these directions only, twice each, and do not refine what was found
    views : of the first round at least, unless it is hopeless
    progress : called with the views made and those planned
    """
    campaign = _planned(stage) if like is None else replace(like, trials=[], first_round=0)
    if len(stage.markers) < 2:
        return campaign
    layout, trials, show = prepare(stage.markers).ready(), campaign.trials, progress or (lambda done, total: None)

    def look(directions: Ints, rounds: range, planned: int) -> None:
        for k in rounds:
            for d in directions.tolist():
                show(len(trials), planned)
                rng = np.random.default_rng([seed, d, k])
                trials.append(_trial(stage, layout, campaign.directions[d], d, campaign.least, rng))

    if only is not None:
        look(only, range(2), 2 * len(only))
        return replace(campaign, first_round=len(trials))
    counted = np.flatnonzero(campaign.counted)
    if not len(counted):
        return campaign
    rounds = max(VIEWS_PER_DIRECTION, -(-views // len(counted)))
    look(counted, range(1), rounds * len(counted))
    if len(trials) < FEWEST_VIEWS or replace(campaign, first_round=len(trials)).share >= HOPELESS:
        look(counted, range(1, rounds), rounds * len(counted))
    campaign = replace(campaign, first_round=len(trials))
    while campaign.unclear:
        look(counted, range(rounds, rounds + 1), len(trials) + len(counted))
        rounds, campaign = rounds + 1, replace(campaign, first_round=len(trials))
    if campaign.share >= HOPELESS:
        again = np.flatnonzero(campaign.rate() < 1)
        look(again, range(rounds, rounds + MORE_VIEWS), len(trials) + MORE_VIEWS * len(again))
    return campaign


def _planned(stage: Stage) -> Campaign:
    """The directions, and which of them count: all of a region that was asked for, or those that show the markers."""
    directions = stage.settings.directions()
    in_sight = np.array([_nominal_count(stage, d) for d in directions])
    least = 0.0
    if stage.settings.everywhere:
        least = max(FEWEST_LEFT / (1 - stage.settings.hidden_percent / 100), FACING * in_sight.max())
    return Campaign(directions, in_sight, in_sight >= least, least)


def _nominal_count(stage: Stage, direction: Array) -> int:
    return int(stage.seen(stage.pose(direction, 0.0, float(np.mean(stage.settings.fill))))[1].sum())


def _trial(stage: Stage, layout: Layout, direction: Array, index: int, least: float, rng: np.random.Generator) -> Trial:
    """One view, at any roll, its direction anywhere in its cell unless fewer markers than ``least`` are seen there."""
    towards = direction + rng.normal(0, stage.settings.cell_rad, 3)
    roll, fill = rng.uniform(0, 2 * np.pi), rng.uniform(*stage.settings.fill)
    pose = stage.pose(towards / np.linalg.norm(towards), roll, fill)
    xy, seen = stage.seen(pose)
    if seen.sum() < least:
        pose = stage.pose(direction, roll, fill)
        xy, seen = stage.seen(pose)
    spots, label = stage.spots(rng, xy, seen)
    left = int((label >= 0).sum())
    if left < 4:
        return Trial(index, pose, seen, "few")
    answer = register(spots, stage.markers, stage.camera, visible=stage.visible, layout=layout)
    outcome, rival = _judged(answer, stage, pose, seen, left)
    return Trial(index, pose, seen, outcome, rival)


def _judged(
    answer: Registration | NotRegistered, stage: Stage, pose: Pose, seen: Mask, left: int
) -> tuple[str, Pose | None]:
    """Outcome, and the pose that stands against the true one."""
    if isinstance(answer, Registration):
        wrong = displacement_px(answer.cam_from_model, stage, pose, seen) > WRONG_PX
        return ("wrong", answer.cam_from_model) if wrong else ("right", None)
    if answer.cause == "ambiguous" and answer.runner_up is not None:
        poses = [p for p in (answer.best_candidate, answer.runner_up.cam_from_model) if p is not None]
        rival = max(poses, key=lambda p: displacement_px(p, stage, pose, seen))
        return "mirrored" if answer.runner_up.same_labels else "symmetric", rival
    if answer.cause == "time":
        return "time", None
    return ("few" if left < FEWEST_LEFT else "weak"), None


def displacement_px(found: Pose, stage: Stage, pose: Pose, seen: Mask) -> float:
    """Largest distance in the image between the markers in sight as they are and as another pose has them."""
    points = stage.markers.xyz[seen]
    off = stage.camera.project(found.apply(points))[0] - stage.camera.project(pose.apply(points))[0]
    return float(np.where(np.isfinite(off), np.hypot(*off.T)[:, None], np.inf).max(initial=0.0))
