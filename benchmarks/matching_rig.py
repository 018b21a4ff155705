"""One registration from a rig of one, two or three cameras: right, refused, never wrong; CPU time.

The cameras see the model from directions 20 to 60 degrees apart, each with its own lens (10 to 60 degrees), roll,
hidden markers and uniform false spots in random order; scenes A and B of `registration`. "right": the pose displaces
no visible marker by 5 px in any camera; "labels": all visible markers labelled in all cameras and no wrong label, up to
spots within three sigma of another marker's place; "false": cases with a wrong label. "z": root mean square of the
pose's error in sigma, over the six parameters; 1 if the covariance is true.

Where no pose is right every accepted one is wrong: uniform clutter in all cameras, clutter in heaps, the pictures of
another model and of another wing of the same design. With one camera turned by 0.3 to 10 degrees against what the rig
says, a pose is wrong if it is for any camera in which markers were matched.
The tables of the markers are prepared before (`prepare`).
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

import _matching_cases as cases
from _matching_cases import scenes
from windmark.geometry import Pose
from windmark.registration import RigRegistration, prepare, register_rig
from windmark.registration.search.trials import FAR_STAGES
from windmark.scene import Detections, MarkerSet

SEEDS = 1_900_000
CELLS = ((0.0, 0.0), (0.5, 1.0), (0.7, 1.0))


@dataclass(frozen=True)
class RigCase:
    """One call of `register_rig`, and what is right (None where no pose is)."""

    scene: scenes.RigScene
    markers: MarkerSet
    right: scenes.RigScene | None

    def outcome(self, found: RigRegistration) -> str:
        """Right, wrong, or silent: right, with no marker matched in a camera that the rig has at a wrong place."""
        if self.right is None:
            return "wrong"
        views = enumerate(self.right.views)
        far = [scenes.pose_error_px(found.cam_from_model(c), view) >= cases.WRONG_PX for c, view in views]
        if any(is_far and count for is_far, count in zip(far, found.counts, strict=True)):
            return "wrong"
        return "silent" if any(far) else "right"

    def labels(self, found: RigRegistration) -> tuple[int, int]:
        """Wrong labels and missing ones of all cameras (see `_matching_cases.Case.labels`)."""
        assert self.right is not None
        total = np.zeros(2, int)
        for view, matching in zip(self.right.views, found.matchings, strict=True):
            one = cases.Case(view.detections, self.markers, view.camera, view)
            total += one.labels(matching)
        return int(total[0]), int(total[1])


def plain(seed: int, kind: str, cameras: int, hidden: float, false: float) -> RigCase:
    """A rig as it should be."""
    scene = scenes.rig_scene(seed, kind, cameras, hidden=hidden, false=false)
    return RigCase(scene, scene.views[0].markers, scene)


def _mixed(seed: int) -> RigCase:
    return plain(seed, "AB"[seed % 2], 2 + seed // 2 % 2, *((0.0, 0.0), (0.5, 1.0), (0.7, 1.0))[seed // 4 % 3])


def clutter(seed: int, heaps: int = 0) -> RigCase:
    """Random spots only, in so many heaps if any."""
    case, rng = _mixed(seed), np.random.default_rng(seed)
    views = []
    for view in case.scene.views:
        size, count = np.array(view.camera.size_px), rng.integers(10, 120)
        spots = rng.uniform(0, 1, (count, 2)) * size
        if heaps:
            centres = rng.uniform(0, 1, (heaps, 2)) * size
            spots = np.clip(centres[rng.integers(0, heaps, count)] + rng.normal(0, 40, (count, 2)), 0, size - 1)
        views.append(replace(view, detections=Detections.make(spots, sigma_px=0.2)))
    return replace(case, scene=replace(case.scene, views=tuple(views)), right=None)


def other_model(seed: int) -> RigCase:
    """The pictures of one model with the table of the other kind."""
    return replace(_mixed(seed), markers=scenes.scene(seed + 5000, "BA"[seed % 2]).markers, right=None)


def other_wing(seed: int) -> RigCase:
    """The pictures of one wing with the table of another one of the same design (its rows differ by 4 %)."""
    case = plain(seed, "A", 2 + seed % 2, *CELLS[seed // 2 % 3])
    return replace(case, markers=scenes.scene(seed + 5000, "A").markers, right=None)


def turned(seed: int) -> RigCase:
    """The last camera turned by 0.3 to 10 degrees about its eye, which the rig does not know."""
    case, rng = _mixed(seed), np.random.default_rng(seed)
    axis = rng.normal(size=3)
    angle = np.radians(np.exp(rng.uniform(np.log(0.3), np.log(10.0))))
    turn = Pose.from_rotvec(angle * axis / np.linalg.norm(axis), np.zeros(3))
    poses = (*case.scene.cam_from_rig[:-1], turn @ case.scene.cam_from_rig[-1])
    return replace(case, scene=replace(case.scene, cam_from_rig=poses))


@dataclass
class Tally:
    """Outcomes and times of one row of the table."""

    outcomes: Counter[str] = field(default_factory=Counter)
    seconds: list[float] = field(default_factory=list)
    refused_seconds: list[float] = field(default_factory=list)
    squares: list[float] = field(default_factory=list)

    def run(self, case: RigCase) -> None:
        """Register one case and count."""
        spots, _, cameras, poses = case.scene.arguments()
        layout = prepare(case.markers).ready()
        layout.table(FAR_STAGES[0][0])
        start = time.thread_time()
        found = register_rig(spots, case.markers, cameras, poses, layout=layout)
        seconds = time.thread_time() - start
        if not isinstance(found, RigRegistration):
            self.outcomes[f"refused_{found.cause}"] += 1
            self.refused_seconds.append(seconds)
            return
        self.seconds.append(seconds)
        outcome = case.outcome(found)
        self.outcomes[outcome] += 1
        if case.right is None:
            return
        wrong, missing = case.labels(found)
        self.outcomes["labels"] += wrong == 0 and missing == 0
        self.outcomes["false"] += wrong > 0
        if outcome == "right":
            delta = (case.right.rig_from_model @ found.rig_from_model.inverse()).log()
            self.squares.append(float(delta @ np.linalg.solve(found.cov, delta)) / 6)

    def figures(self) -> dict[str, float]:
        """The row of the table."""
        n = len(self.seconds) + len(self.refused_seconds)
        ms, refused = 1e3 * np.array(self.seconds or [np.nan]), 1e3 * np.array(self.refused_seconds or [np.nan])
        return {
            "cases": n,
            "right_percent": 100 * self.outcomes["right"] / n,
            "wrong": self.outcomes["wrong"],
            "silent": self.outcomes["silent"],
            "labels_percent": 100 * self.outcomes["labels"] / n,
            "false_labels": self.outcomes["false"],
            "z": float(np.sqrt(np.mean(self.squares))) if self.squares else float("nan"),
            "median_ms": float(np.median(ms)),
            "p99_ms": float(np.percentile(ms, 99)),
            "refused_median_ms": float(np.median(refused)),
            "refused_max_ms": float(refused.max()),
            **{name: count for name, count in self.outcomes.items() if name.startswith("refused")},
        }


def row(name: str, case_of: Callable[[int], RigCase], seeds: range) -> dict[str, float]:
    """Measure one row and print it."""
    tally = Tally()
    for seed in seeds:
        tally.run(case_of(seed))
    r = tally.figures()
    why = ", ".join(f"{int(r[key])} {key[8:]}" for key in tally.outcomes if key.startswith("refused"))
    print(f"{name:34s} {r['cases']:5.0f} {r['right_percent']:6.1f}% {r['wrong']:5.0f} {r['labels_percent']:6.1f}%"
          f" {r['false_labels']:5.0f} {r['z']:6.3f} {r['median_ms']:7.1f} {r['p99_ms']:7.1f}"
          f" {r['refused_median_ms']:8.0f} {r['refused_max_ms']:6.0f}  {why}", flush=True)  # fmt: skip
    return r


def main(quick: bool = False, count: int = 500, first: int = SEEDS) -> dict[str, dict[str, float]]:
    """Measure, print one table, return its rows."""
    seeds = range(first, first + (12 if quick else count))
    Tally().run(plain(0, "A", 2, 0.0, 0.0))
    print(f"{'':34s} {'cases':>5s} {'right':>7s} {'wrong':>5s} {'labels':>7s} {'false':>5s} {'z':>6s}"
          f" {'median':>7s} {'99 %':>7s} {'refusal':>8s} {'most':>6s}  refused (times in ms)")  # fmt: skip
    made: dict[str, Callable[[int], RigCase]] = {}
    for kind in "AB":
        for hidden, false in CELLS:
            for cameras in (1, 2, 3):
                name = f"{kind} {hidden:.0%} hidden {false:.0%} false, {cameras} cameras"
                made[name] = partial(plain, kind=kind, cameras=cameras, hidden=hidden, false=false)
    made |= {
        "clutter": clutter, "clutter in heaps": partial(clutter, heaps=5), "another model": other_model,
        "another wing": other_wing, "one camera turned": turned,
    }  # fmt: skip
    return {name: row(name, case_of, seeds) for name, case_of in made.items()}


if __name__ == "__main__":
    main("--quick" in sys.argv, *(int(a) for a in sys.argv[1:] if a.isdigit()))
