"""Registration: how often right, how often refused, never wrong; and how much CPU time it takes, cold, on one thread.

Scenes A (24 markers in near-regular rows on a nearly flat wing), A0 (exactly regular) and B (60 on wing and body):
random cameras (10 to 60 degrees, any roll), noise 0.1 to 0.3 px, hidden markers and uniform false spots, spots in
random order (ranked spots are faster). `wrong` counts accepted poses that displace a visible marker by more than
5 px; it has to stay 0. Pictures of other models and clutter have to be refused.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "registration"))
import registration_scenes as scenes

from windmark.geometry import Pose
from windmark.registration import NotRegistered, Registration, register
from windmark.scene import Detections, MarkerSet

CELLS = (
    ("A", 0.0, 0.0), ("A", 0.25, 0.5), ("A", 0.5, 1.0), ("A0", 0.0, 0.0), ("A0", 0.5, 1.0),
    ("B", 0.0, 0.0), ("B", 0.25, 0.5), ("B", 0.5, 1.0),
)  # fmt: skip


@dataclass
class Tally:
    """Outcomes and times of one row of the table."""

    accepted: list[float] = field(default_factory=list)
    refused: list[float] = field(default_factory=list)
    wrong: int = 0
    false_labels: int = 0

    def add(self, result: Registration | NotRegistered, seconds: float, scene: scenes.Scene) -> None:
        """Count one case."""
        if not isinstance(result, Registration):
            self.refused.append(seconds)
            return
        self.accepted.append(seconds)
        self.wrong += scenes.pose_error_px(result.cam_from_model, scene, result.camera) > 5.0
        self.false_labels += scenes.wrong_labels(result.matching.detection, result.matching.marker, scene)

    def figures(self) -> dict[str, float]:
        """The row of the table."""
        n = len(self.accepted) + len(self.refused)
        ms = 1e3 * np.array(self.accepted or [np.nan])
        return {
            "cases": n,
            "right_percent": 100 * (len(self.accepted) - self.wrong) / n,
            "wrong": self.wrong,
            "false_labels": self.false_labels,
            "median_ms": float(np.median(ms)),
            "p99_ms": float(np.percentile(ms, 99)),
            "refused_median_ms": float(1e3 * np.median(self.refused)) if self.refused else float("nan"),
        }


def main(quick: bool = False) -> dict[str, dict[str, float]]:
    """Measure, print one table, return its rows."""
    cases = 20 if quick else 200
    figures: dict[str, dict[str, float]] = {"first_call": {"compile_s": _first_call()}}
    print(f"first call (compiled or read from numba's cache): {figures['first_call']['compile_s']:.2f} s")
    print(f"{'scene, hidden, false':34s} {'cases':>5s} {'right':>7s} {'wrong':>5s} {'labels':>6s}"
          f" {'median':>8s} {'99 %':>8s} {'refusal':>8s}")  # fmt: skip
    for kind, hidden, false in CELLS:
        name = f"{kind} {hidden:.0%} {false:.0%}"
        _row(figures, name, cases, lambda seed, k=kind, h=hidden, f=false: _cold(seed, k, h, f))
    for kind in ("A", "B"):
        _row(figures, f"{kind} 50% 100% ranked", cases, lambda seed, k=kind: _cold(seed, k, 0.5, 1.0, ranked=True))
        _row(figures, f"{kind} 50% 100% prior 30 deg/30 %", cases, lambda seed, k=kind: _with_prior(seed, k))
        _row(figures, f"{kind} 25% 50% focal +-30 % unknown", cases, lambda seed, k=kind: _free_focal(seed, k))
    for name, other in (("clutter", _clutter), ("A on a picture of B", _a_on_b), ("B on a picture of A", _b_on_a)):
        _row(figures, name, max(cases // 4, 5), other)
    return figures


Case = tuple[scenes.Scene, dict[str, Any]]


def _row(figures: dict[str, dict[str, float]], name: str, cases: int, case: Callable[[int], Case]) -> None:
    tally = Tally()
    for seed in range(cases):
        scene, options = case(seed + 20_000)
        camera = options.pop("camera", scene.camera)
        start = time.process_time()
        result = register(scene.detections, scene.markers, camera, **options)
        tally.add(result, time.process_time() - start, scene)
    row = figures[name] = tally.figures()
    counts = f"{row['cases']:5.0f} {row['right_percent']:6.1f}% {row['wrong']:5.0f} {row['false_labels']:6.0f}"
    times = f"{row['median_ms']:5.1f} ms {row['p99_ms']:5.0f} ms {row['refused_median_ms']:5.0f} ms"
    print(f"{name:34s} {counts} {times}", flush=True)


def _first_call() -> float:
    scene = scenes.scene(0)
    start = time.process_time()
    register(scene.detections, scene.markers, scene.camera)
    return time.process_time() - start


def _cold(seed: int, kind: str, hidden: float, false: float, ranked: bool = False) -> Case:
    return scenes.scene(seed, kind, hidden=hidden, false=false, ranked=ranked), {}


def _with_prior(seed: int, kind: str) -> Case:
    scene, rng = scenes.scene(seed, kind, hidden=0.5, false=1.0), np.random.default_rng(seed)
    axis = rng.normal(size=3)
    turn = Pose.from_rotvec(axis / np.linalg.norm(axis) * np.radians(rng.uniform(0, 25)), np.zeros(3)).rotation
    centre, pose = scene.markers.xyz.mean(axis=0), scene.cam_from_model
    rotation = pose.rotation @ turn
    place = pose.apply(centre) * np.exp(rng.uniform(-0.2, 0.2))
    return scene, {"prior": Pose(rotation, place - rotation @ centre)}


def _free_focal(seed: int, kind: str) -> Case:
    scene = scenes.scene(seed, kind, hidden=0.25, false=0.5)
    factor = np.exp(np.random.default_rng(seed).uniform(-0.3, 0.3))
    return scene, {"camera": replace(scene.camera, focal_px=scene.camera.focal_px * factor), "free_focal": True}


def _clutter(seed: int) -> Case:
    scene, rng = scenes.scene(seed), np.random.default_rng(seed)
    spots = rng.uniform(0, 1, (rng.integers(20, 90), 2)) * scene.camera.size_px
    return replace(scene, detections=Detections.make(spots, sigma_px=0.2), label=np.full(len(spots), -1)), {}


def _other(scene: scenes.Scene, markers: MarkerSet) -> Case:
    """The picture of one model with the table of another: no label is right, and no pose."""
    far = Pose(scene.cam_from_model.rotation, scene.cam_from_model.translation * 3)
    label = np.full(len(scene.detections), -1)
    return replace(scene, markers=markers, cam_from_model=far, label=label), {}


def _a_on_b(seed: int) -> Case:
    return _other(scenes.scene(seed, "B", hidden=0.25), scenes.wing(np.random.default_rng(seed)))


def _b_on_a(seed: int) -> Case:
    return _other(scenes.scene(seed, "A", hidden=0.25), scenes.wing_and_body(np.random.default_rng(seed)))


if __name__ == "__main__":
    main("--quick" in sys.argv)
