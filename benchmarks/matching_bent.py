"""Bent wings with the straight model's table: labels of the rigid matcher, and of the one that solves for the bending.

Scenes A and B of `registration`; the tips move by 1, 2 and 4 % of the span (of B from tip to tip), up or down, like s^2
or like a beam with a uniform load, every other one twisted by 1 degree, of B both wings or one. "rivets" are two rows
of false spots beside rows of markers. All visible markers of all images count, those of refused ones as not right; a
spot within three sigma of where the marker really is counts as its own. "off" is ``max_deformation=0``.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark.registration import NotRegistered, Registration, prepare, register

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "registration"))
import bent_scenes
import registration_scenes as scenes

TIPS = (0.01, 0.02, 0.04)
CONDITIONS = ((0.0, 0.0, False), (0.25, 0.5, False), (0.5, 1.0, False), (0.25, 0.5, True))
"""Hidden markers, false spots, rivets."""
MODES = {"off": {"max_deformation": 0.0}, "on": {}}


@dataclass
class Tally:
    """Outcomes of one cell."""

    seconds: list[float] = field(default_factory=list)
    refused: Counter[str] = field(default_factory=Counter)
    visible: int = 0
    right: int = 0
    wrong: int = 0
    whole: int = 0

    def add(self, scene: scenes.Scene, xyz: NDArray[np.float64], answer: Registration | NotRegistered) -> None:
        """Count one answer; xyz (N, 3) is where the markers are."""
        visible = int((scene.label >= 0).sum())
        self.visible += visible
        if not isinstance(answer, Registration):
            self.refused[answer.cause] += 1
            return
        match = answer.matching
        seen = scene.camera.project(scene.cam_from_model.apply(xyz[match.marker]))[0]
        sigma = np.sqrt(scene.detections.cov[match.detection, 0, 0])
        near = np.linalg.norm(scene.detections.xy[match.detection] - seen, axis=1) < 3 * sigma
        right = (scene.label[match.detection] == match.marker) | near
        self.right += min(int(right.sum()), visible)
        self.wrong += int((~right).sum())
        self.whole += bool(right.all()) and int(right.sum()) >= visible

    def figures(self) -> dict[str, float]:
        """The cell in numbers."""
        n = len(self.seconds)
        return {
            "images": n,
            "whole_percent": 100 * self.whole / n,
            "right_percent": 100 * self.right / self.visible,
            "wrong_percent": 100 * self.wrong / self.visible,
            "refused_percent": 100 * sum(self.refused.values()) / n,
            "median_ms": 1e3 * float(np.median(self.seconds)),
        }


def bend_of(seed: int, tip: float) -> bent_scenes.Bend:
    """A random bend with this displacement of the tip."""
    rng = np.random.default_rng([seed, 1])
    shape = bent_scenes.SHAPES[rng.integers(2)]
    return bent_scenes.Bend(
        tip * rng.choice([-1, 1]), shape, float(rng.integers(2)), str(rng.choice(["both", "right"]))
    )


def main(quick: bool = False, count: int = 500, first: int = 2_900_000) -> dict[str, dict[str, float]]:
    """Measure, print one table, return its rows."""
    count = 8 if quick else count
    figures: dict[str, dict[str, float]] = {}
    print(f"{'':32s} {'':3s} {'images':>6s} {'whole':>7s} {'right':>7s} {'wrong':>7s} {'refused':>8s} {'median':>8s}")
    for kind in "AB":
        tallies = {(tip, c, mode): Tally() for tip in TIPS for c in CONDITIONS for mode in MODES}
        for seed in range(first, first + count):
            _one(kind, seed, tallies)
        for (tip, (hidden, false, rivets), mode), tally in tallies.items():
            name = f"{kind} {tip:.0%} {hidden:.0%} hidden {false:.0%} false{' rivets' if rivets else ''}"
            r = figures[f"{name}, {mode}"] = tally.figures()
            why = ", ".join(f"{n} {cause}" for cause, n in tally.refused.most_common())
            print(f"{name:32s} {mode:3s} {r['images']:6.0f} {r['whole_percent']:6.1f}% {r['right_percent']:6.1f}%"
                  f" {r['wrong_percent']:6.2f}% {r['refused_percent']:7.1f}% {r['median_ms']:6.1f} ms  {why}",
                  flush=True)  # fmt: skip
    return figures


def _one(kind: str, seed: int, tallies: dict[tuple[float, tuple[float, float, bool], str], Tally]) -> None:
    """All cells with the model of one seed."""
    layout = None
    for tip in TIPS:
        for condition in CONDITIONS:
            hidden, false, rivets = condition
            scene, xyz = bent_scenes.scene(
                seed, kind, bend_of(seed, tip), hidden=hidden, false=false, rivets=rivets
            )  # fmt: skip
            layout = layout or prepare(scene.markers).ready()
            for mode, options in MODES.items():
                start = time.thread_time()
                answer = register(scene.detections, scene.markers, scene.camera, layout=layout, **options)
                tally = tallies[tip, condition, mode]
                tally.seconds.append(time.thread_time() - start)
                tally.add(scene, xyz, answer)


if __name__ == "__main__":
    numbers = [int(a) for a in sys.argv[1:] if a.isdigit()]
    main("--quick" in sys.argv, *numbers)
