"""Links of the paper's case: 25 pictures by hand, 100 markers, 10 % of the spots missing, 10 % false, noise 0.1 px.

Poses are wrong by 0.2 degrees and 2 mm per axis (some 12 px). Counted over all seeds: links right, wrong and missed;
markers with three spots or more that have no track ("lost"); tracks of no marker ("false"); CPU time of one case. Then
the same with 50 pictures of 150 markers, and chance: pictures of false spots only, with exact poses.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

from windmark.epipolar import Association, associate
from windmark.scene import Detections

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "epipolar"))
import reconstruct_scenes as scenes

SEEDS = 7000
CELLS = (
    ("plate", "walk", 25, 100), ("plate", "cloud", 25, 100), ("model", "walk", 25, 100), ("model", "cloud", 25, 100),
    ("plate", "walk", 50, 150), ("model", "cloud", 50, 150),
)  # fmt: skip


def judged(case: scenes.Case, found: Association) -> scenes.Count:
    """Against the truth."""
    links = zip(found.tracks.view, found.tracks.detection, strict=True)
    label = np.array([case.labels[v][s] for v, s in links], dtype=int)
    return scenes.judge(found.tracks.track, label, case.views_of)


def main(quick: bool = False, seeds: int = 20) -> dict[str, dict[str, float]]:
    """Print one table; return its rows."""
    print(f"{'':28s} {'cases':>5s} {'right':>7s} {'wrong':>5s} {'missed':>6s} {'lost':>4s} {'false':>5s} {'s':>6s}")
    figures: dict[str, dict[str, float]] = {}
    for model, path, views, points in CELLS:
        number = 2 if quick else seeds if views == 25 else max(1, seeds // 5)
        total, seconds = np.zeros(5, dtype=int), []
        for seed in range(SEEDS, SEEDS + number):
            case = scenes.make(seed, model, path, views=views, points=points)
            poses, cov = case.perturbed(seed)
            start = time.thread_time()
            found = associate(case.detections, case.camera, poses, pose_cov=cov)
            seconds.append(time.thread_time() - start)
            count = judged(case, found)
            total += [count.right, count.wrong, count.missed, count.lost, count.false]
        name = f"{model}, {path}, {views} x {points}"
        words = ("right", "wrong", "missed", "lost", "false")
        figures[name] = {**dict(zip(words, total.tolist(), strict=True)), "seconds": float(np.median(seconds))}
        print(
            f"{name:28s} {number:5d} {total[0]:7d} {total[1]:5d} {total[2]:6d} {total[3]:4d} {total[4]:5d} "
            f"{np.median(seconds):6.2f}",
            flush=True,
        )
    figures["chance"] = chance(4 if quick else 5 * seeds)
    return figures


def chance(cases: int) -> dict[str, float]:
    """False points in pictures without markers."""
    size, points = np.array(scenes.CAMERA.size_px), 0
    for seed in range(SEEDS, SEEDS + cases):
        rng, views = np.random.default_rng(seed), 5 if seed % 2 else 15
        poses = scenes.make(seed, "plate", "cloud", views=views, points=12).poses
        spots = [Detections.make(rng.uniform(-0.5, size - 0.5, (60, 2))) for _ in range(views)]
        points += len(associate(spots, scenes.CAMERA, poses))
    print(f"false spots only: {points} points in {cases} sets of 5 or 15 pictures with 60 spots each")
    return {"cases": cases, "points": points}


if __name__ == "__main__":
    main("--quick" in sys.argv)
