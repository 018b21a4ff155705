"""Pose tracking: how often right, found again, refused, never wrong; how sure, and what it costs on one thread.

Sequences of projected markers (`tests/registration/track_scenes.py`): A (24 markers), A0 (24 in exactly regular rows),
B (60), C (150) and G, a grid of 6 x 4 whose every pose has an equal (its first frame gets a prior). Hidden markers and
false spots change from frame to frame. The motion swings: slow (up to 0.1 deg, 0.1 % and 1 px per frame), medium
(1 deg, 1 %, 10 px), fast (4 deg, 4 %, 40 px); "knocks" are jumps by up to 10 deg, 10 % and 100 px at three frames, and
two frames are empty.

"wrong": a visible marker is displaced by 5 px, or a pose is given to a frame without a model; it has to stay 0.
"labels": all visible markers labelled and no wrong label, up to spots within three sigma of another marker's place.
z: standard deviation of the tracked poses' error over its sigma, of all six coordinates. Times: CPU time of `track`
where it follows the prediction, beside `register` (cold, prepared) on some of the same frames.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np

import _matching_cases as cases
from windmark.registration import Registration, TrackState, register, track

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "registration"))
import track_scenes as sequences
from registration_scenes import Scene

FIRST_SEED = 1_910_000
FRAMES, JUMPS, EMPTY = 40, (12, 22, 31), (17, 26)
CELLS = (
    ("A", "slow", 0.2, 0.5), ("A", "medium", 0.5, 1.0), ("A", "fast", 0.5, 1.0), ("A0", "medium", 0.5, 1.0),
    ("A0", "fast", 0.2, 0.5), ("G", "medium", 0.2, 0.5), ("G", "fast", 0.2, 0.5), ("B", "slow", 0.2, 0.5),
    ("B", "medium", 0.5, 1.0), ("B", "fast", 0.5, 1.0), ("C", "medium", 0.5, 1.0), ("C", "fast", 0.2, 0.5),
)  # fmt: skip
SPEEDS = {"slow": sequences.SLOW, "medium": sequences.MEDIUM, "fast": sequences.FAST}
COLD_SHARE = 10
"""One of so many frames is registered cold, too."""


class Tally:
    """Outcomes, errors and times of one row of the table."""

    def __init__(self) -> None:
        self.status: Counter[str] = Counter()
        self.wrong = self.false_labels = self.labelled = self.frames = 0
        self.z: list[np.ndarray] = []
        self.seconds: list[float] = []
        self.cold_seconds: list[float] = []

    def follow(self, images: list[Scene], prior: bool) -> None:
        """One sequence."""
        state: TrackState | None = None
        for k, scene in enumerate(images):
            start = time.thread_time()
            answer, state = track(
                state, scene.detections, scene.markers, scene.camera,
                prior=scene.cam_from_model if prior and k == 0 else None,
            )  # fmt: skip
            seconds = time.thread_time() - start
            self.frames += 1
            gone = not (scene.label >= 0).any()
            self.status["empty" if gone and not answer else state.status] += 1
            if isinstance(answer, Registration):
                self._score(answer, scene, state.status, gone)
            if state.status == "tracked":
                self.seconds.append(seconds)
                if k % COLD_SHARE == 1:
                    start = time.thread_time()
                    register(scene.detections, scene.markers, scene.camera, layout=state.prepared.layout)
                    self.cold_seconds.append(time.thread_time() - start)

    def _score(self, answer: Registration, scene: Scene, status: str, gone: bool) -> None:
        case = cases.Case(scene.detections, scene.markers, scene.camera, scene)
        if gone or not case.pose_right(answer):
            self.wrong += 1
            return
        wrong, missing = case.labels(answer.matching)
        self.false_labels += wrong > 0
        self.labelled += wrong == 0 and missing == 0
        if status == "tracked":
            delta = (answer.cam_from_model @ scene.cam_from_model.inverse()).log()
            self.z.append(delta / np.sqrt(np.diag(answer.cov)))

    def figures(self) -> dict[str, float]:
        """The row of the table."""
        ms, cold = 1e3 * np.array(self.seconds or [np.nan]), 1e3 * np.array(self.cold_seconds or [np.nan])
        with_model = self.frames - self.status["empty"]
        return {
            "frames": self.frames, "tracked": self.status["tracked"], "cold": self.status["cold"],
            "reacquired": self.status["reacquired"], "lost": self.status["lost"], "empty": self.status["empty"],
            "wrong": self.wrong, "labels_percent": 100 * self.labelled / with_model, "false_labels": self.false_labels,
            "z_std": float(np.std(self.z)) if self.z else np.nan, "median_ms": float(np.median(ms)),
            "p99_ms": float(np.percentile(ms, 99)), "register_median_ms": float(np.median(cold)),
        }  # fmt: skip


def main(quick: bool = False, count: int = 40) -> dict[str, dict[str, float]]:
    """Measure, print one table, return its rows."""
    count = 2 if quick else count
    warm = sequences.sequence(0, "A", sequences.SLOW, frames=3)
    Tally().follow(warm, False)
    figures: dict[str, dict[str, float]] = {}
    print(f"{'':38s} {'frames':>6s} {'tracked':>7s} {'again':>5s} {'lost':>5s} {'empty':>5s} {'wrong':>5s}"
          f" {'labels':>7s} {'false':>5s} {'z':>5s} {'median':>7s} {'99 %':>6s} {'register':>8s}  (ms)")  # fmt: skip
    for kind, speed, hidden, false in CELLS:
        for knocks in (False, True):
            tally = Tally()
            for seed in range(FIRST_SEED, FIRST_SEED + max(count // (5 if kind == "C" else 1), 1)):
                more = {"jumps": JUMPS, "empty": EMPTY} if knocks else {}
                images = sequences.sequence(
                    seed, kind, SPEEDS[speed], frames=FRAMES, hidden=hidden, false=false, **more
                )  # fmt: skip
                tally.follow(images, kind == "G")
            name = f"{kind} {speed}, {hidden:.0%} hidden {false:.0%} false{', knocks' if knocks else ''}"
            r = figures[name] = tally.figures()
            print(f"{name:38s} {r['frames']:6.0f} {r['tracked']:7.0f} {r['reacquired']:5.0f} {r['lost']:5.0f}"
                  f" {r['empty']:5.0f} {r['wrong']:5.0f} {r['labels_percent']:6.1f}% {r['false_labels']:5.0f}"
                  f" {r['z_std']:5.2f} {r['median_ms']:7.3f} {r['p99_ms']:6.2f} {r['register_median_ms']:8.2f}",
                  flush=True)  # fmt: skip
    return figures


if __name__ == "__main__":
    numbers = [int(a) for a in sys.argv[1:] if a.isdigit()]
    main("--quick" in sys.argv, *numbers)
