"""Self-calibration from bad starts: at the optimum, refused, or wrong?

192 starts: scenarios S1 and S2 (`_networks`: a nearly flat plate of 690 mm, and a model before walls), and S2 from the
guess that it is flat; markers off by 5 to 150 mm (1 sigma per coordinate), focal length off by -40 to +40 %, no
distortion, no poses, 0.1 px of noise of its own in each. "optimum": the marks and the cost (to 1e-6 of it) of the
calibration that starts from the truth; "refused": a `NotCalibrated`, with its causes; "wrong": anything else.

pycolmap (where it is installed) gets the same marks, markers and focal length, and needs poses: those that windmark
finds for these markers and this focal length. It is at the optimum where it has the cost of least squares from the
truth, of all marks.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

import _networks as nets
from calibration import OPTIONS, peer
from windmark.adjust.levenberg_marquardt import minimise
from windmark.adjust.network import NetworkProblem
from windmark.calibration import Calibration, Free, NotCalibrated, self_calibrate
from windmark.calibration.start import start_poses
from windmark.geometry import Pose

Array = NDArray[np.float64]

SEEDS = 2_712_000
SCENES = ("S1", "S2", "S2 flat")
MARKERS_MM = (5, 10, 20, 35, 50, 75, 100, 150)
FOCAL_PERCENT = (-40, -30, -20, -10, 10, 20, 30, 40)
SAME = 1e-6


def start(scene: nets.Scenario, kind: str, marker: float, rng: np.random.Generator) -> Array:
    """Rough markers."""
    rough = scene.truth.points + rng.normal(0, marker, scene.truth.points.shape)
    return rough * [1, 1, 0] if kind.endswith("flat") else rough


def verdict(found: Calibration | NotCalibrated, best: Calibration) -> str:
    """What became of a start, beside the calibration that starts from the truth."""
    if isinstance(found, NotCalibrated):
        return found.cause
    same = len(found.used) == len(best.used) and bool((found.used == best.used).all())
    costs = [c.redundancy * c.sigma0**2 for c in (found, best)]
    return "optimum" if same and abs(costs[0] / costs[1] - 1) < SAME else "wrong"


def peer_at_optimum(scene: nets.Scenario, xy: Array, rough: Array, focal: float, seed: int) -> bool | None:
    """Whether pycolmap reaches the least-squares minimum; None without pycolmap."""
    camera = replace(nets.Camera(nets.CAMERA.size_px, nets.CAMERA.focal_px * focal))
    count = len(scene.truth.frames.translation)
    marks = [(xy[scene.view == v], rough[scene.point[scene.view == v]]) for v in range(count)]
    poses = start_poses(camera, marks, scan_focal=False, rng=np.random.default_rng(seed))[1]
    frames = Pose(np.stack([p.rotation for p in poses if p]), np.stack([p.translation for p in poses if p]))
    begin = replace(scene.truth, cameras=(camera,), frames=frames, points=rough)
    cost = peer(scene, xy, begin)[1]
    problem = NetworkProblem(scene.network(False, xy), scene.truth)
    best = minimise(problem, scene.truth, OPTIONS)[1].cost
    return None if np.isnan(cost) else bool(cost / best - 1 < SAME)


def main(quick: bool = False, seeds: int = 1, beside: bool = True) -> dict[str, dict[str, float]]:
    """Measure, print the table, return its rows."""
    figures: dict[str, dict[str, float]] = {}
    print("scene    markers off  starts  optimum  refused  wrong  CPU s  pycolmap at optimum  causes")
    for kind in SCENES:
        for marker in MARKERS_MM[::7] if quick else MARKERS_MM:
            counts, seconds, theirs = Counter[str](), [], []
            for n, percent in enumerate(FOCAL_PERCENT[::4] if quick else FOCAL_PERCENT * seeds):
                rng = np.random.default_rng([SEEDS, SCENES.index(kind), marker, n])
                scene = nets.scenario(kind[:2], SEEDS + n // len(FOCAL_PERCENT))
                xy, rough, focal = scene.noisy(rng), start(scene, kind, marker, rng), 1 + percent / 100
                best = self_calibrate(*scene.nouns(xy, scene.truth.points, posed=True), datum=Free())
                assert best, best
                begin = time.thread_time()
                found = self_calibrate(*scene.nouns(xy, rough, focal), datum=Free())
                seconds.append(time.thread_time() - begin)
                counts[verdict(found, best)] += 1
                if beside and n < len(FOCAL_PERCENT):
                    theirs.append(peer_at_optimum(scene, xy, rough, focal, n))
            total, refused = sum(counts.values()), {k: v for k, v in counts.items() if k not in ("optimum", "wrong")}
            known = [t for t in theirs if t is not None]
            r = figures[f"{kind} {marker} mm"] = {
                "starts": total, "optimum": counts["optimum"], "refused": sum(refused.values()),
                "wrong": counts["wrong"], "cpu_s": float(np.median(seconds)), "worst_s": max(seconds),
                "pycolmap": sum(known) if known else float("nan"), "pycolmap_starts": len(known),
            }  # fmt: skip
            causes = ", ".join(f"{k} {v}" for k, v in sorted(refused.items()))
            print(f"{kind:8s} {marker:8d} mm {total:7d} {r['optimum']:8.0f} {r['refused']:8.0f} {r['wrong']:6.0f}"
                  f" {r['cpu_s']:6.2f} {r['pycolmap']:9.0f} of {r['pycolmap_starts']:2.0f}         {causes}",
                  flush=True)  # fmt: skip
    every = {k: sum(r[k] for r in figures.values()) for k in ("starts", "optimum", "refused", "wrong", "pycolmap")}
    every["pycolmap_starts"] = sum(r["pycolmap_starts"] for r in figures.values())
    figures["all"] = every
    print(f"all: {every['optimum']:.0f} of {every['starts']:.0f} at the optimum, {every['refused']:.0f} refused,"
          f" {every['wrong']:.0f} wrong; pycolmap {every['pycolmap']:.0f} of {every['pycolmap_starts']:.0f}"
          )  # fmt: skip
    return figures


if __name__ == "__main__":
    numbers = [int(a) for a in sys.argv[1:] if a.isdigit()]
    main("--quick" in sys.argv, *numbers)
