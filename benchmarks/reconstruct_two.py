"""Two pictures alone: what `reconstruct` links, with exact poses and with names made by hand, and whether it is right.

A nearly flat plate (3 mm) and a wing with its body before walls, 25, 67 or 150 markers, 6, 15 or 30 degrees between
the pictures, 0.1 or 0.3 px noise, 10 % of the spots missing and 10 % false. "poses": both poses are given, exact;
"labels": the six primary markers that both pictures show are named in both. "Both" are markers with a spot in both
pictures, "right" those with a track of these two spots, "wrong" tracks of any other two spots, "open" the rest;
"refused" are whole cases.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np

from windmark.geometry import Pose
from windmark.scene import Detections, MarkerSet, View
from windmark.tasks.reconstruct import reconstruct

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "epipolar"))
import reconstruct_scenes as scenes

NUMBERS, ANGLES_DEG, NOISES = (25, 67, 150), (6, 15, 30), (0.1, 0.3)
MISSING, FALSE, PRIMARIES = 0.1, 0.1, 6
COLUMNS = ("cases", "refused", "both", "right", "open", "wrong")


def pictures(
    model: str, seed: int, number: int, angle_deg: float, noise: float
) -> tuple[np.ndarray, list[Pose], list[Detections], list[np.ndarray]]:
    """Markers, poses, spots, and the marker of every spot (-1: false)."""
    rng = np.random.default_rng(seed)
    xyz, normal = (scenes.plate if model == "plate" else scenes.wing_body_walls)(rng, 3 * number)
    kept = scenes._apart(xyz)[:number]
    xyz, normal = xyz[kept], normal[kept]
    half, way, middle = np.radians(angle_deg / 2), rng.uniform(0, 2 * np.pi), rng.uniform(-0.3, 0.3, 2)
    reach = float(np.abs(xyz[:, :2]).max())
    step = half * np.array([np.cos(way), np.sin(way)])
    poses = [scenes._station(rng, reach, *(middle + s * step), rng.normal(0, 0.1)) for s in (-1, 1)]
    seen = [scenes._seen(rng, scenes.CAMERA, p, xyz, normal, model, MISSING, FALSE, noise) for p in poses]
    return xyz, poses, [s for s, _ in seen], [label for _, label in seen]


def one(model: str, route: str, seed: int, number: int, angle_deg: float, noise: float) -> tuple[np.ndarray, str]:
    """The columns of a case, and the cause of a refusal."""
    xyz, poses, spots, labels = pictures(model, seed, number, angle_deg, noise)
    both = np.intersect1d(*(label[label >= 0] for label in labels))
    far = np.linalg.norm(xyz[both] - xyz[both].mean(axis=0), axis=1)
    known = both[np.argsort(-far)[:PRIMARIES]]
    primary = MarkerSet.make([f"m{i}" for i in known], xyz[known], role="primary")
    names = ["v0", "v1"]
    views = [View(n, "cam", "", p if route == "poses" else None) for n, p in zip(names, poses, strict=True)]
    by_hand = {n: {int(np.flatnonzero(label == m)[0]): f"m{m}" for m in known}
               for n, label in zip(names, labels, strict=True)}  # fmt: skip
    found = reconstruct(
        spots, {"cam": scenes.CAMERA}, primary, views=views, **({"labels": by_hand} if route == "labels" else {})
    )
    if not found:
        return np.array([1, 1, len(both), 0, len(both), 0]), f"{found.cause}: {found.reason}"
    right = wrong = 0
    for track in range(len(found.markers)):
        mine = found.tracks.track == track
        spot = dict(zip(found.tracks.view[mine].tolist(), found.tracks.detection[mine].tolist(), strict=True))
        if len(spot) == 2:
            a, b = (int(labels[v][spot[v]]) for v in (0, 1))
            right, wrong = right + (a == b >= 0), wrong + (not a == b >= 0)
    return np.array([1, 0, len(both), right, len(both) - right, wrong]), ""


def main(quick: bool = False, seeds: int = 10) -> dict[str, dict[str, int]]:
    """Print one table; return its rows."""
    figures: dict[str, dict[str, int]] = {}
    why: Counter[str] = Counter()
    print(f"{'':42s} " + " ".join(f"{c:>8s}" for c in COLUMNS) + "       s")
    for route in ("poses", "labels"):
        for model in ("plate", "model"):
            for number in NUMBERS:
                for angle in ANGLES_DEG:
                    start, total = time.process_time(), np.zeros(len(COLUMNS), dtype=int)
                    for noise in NOISES:
                        for seed in range(1 if quick else seeds):
                            row, reason = one(model, route, seed, number, angle, noise)
                            total += row
                            why.update([reason[:110]] if reason else [])
                    name = f"{route}, {model}, {number} markers, {angle} degrees"
                    figures[name] = dict(zip(COLUMNS, total.tolist(), strict=True))
                    seconds = time.process_time() - start
                    print(f"{name:42s} " + " ".join(f"{v:8d}" for v in total) + f" {seconds:7.1f}", flush=True)
    total = np.sum([list(row.values()) for row in figures.values()], axis=0)
    print(f"{'all':42s} " + " ".join(f"{v:8d}" for v in total))
    for reason, times in why.most_common():
        print(f"  refused {times} times: {reason}")
    return figures


if __name__ == "__main__":
    main("--quick" in sys.argv)
