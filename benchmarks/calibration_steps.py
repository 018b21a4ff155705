"""The paper's growing and shrinking steps (AIAA 2005-5007, section IV.B) beside Levenberg-Marquardt on a network.

Scenario S1 (`_networks`: 25 pictures of 100 markers), four markers held, 0.1 px of noise, markers 1 mm off (1 sigma per
coordinate). "poses and markers": the camera is known; "everything": focal length off by 2.6 %, no distortion to start
with. The steps move one parameter at a time, so a valley that is not along one (focal length and distance, principal
point and turn) is walked in very small steps.

"RMS": of the residuals beside the minimum's. "from the minimum": Newton's decrement, in the estimate's own sigma, over
all parameters together. "evaluations": of all residuals. "times": CPU time beside Levenberg-Marquardt's.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace

import numpy as np

import _networks as nets
from calibration import OPTIONS
from windmark.adjust import PaperOptions, minimise
from windmark.adjust.network import NetworkProblem, minimise_network_by_steps

SEEDS = 2_716_000
PASSES = (10, 100, 1000, 3000)


def rows(what: str, passes: tuple[int, ...]) -> dict[str, dict[str, float]]:
    """Figures after some passes."""
    scene, rng = nets.scenario("S1", SEEDS), np.random.default_rng(SEEDS)
    network, start = scene.network(True, scene.noisy(rng)), scene.start(rng, marker=1.0)
    points = np.where(network.held, scene.truth.points, start.points)
    start = replace(start, points=points)
    if what == "poses and markers":
        network, start = replace(network, free_camera=((),)), replace(start, cameras=scene.truth.cameras)
    problem = NetworkProblem(network, start)
    minimise(problem, start, OPTIONS)
    begin = time.thread_time()
    _, _, best = minimise(problem, start, OPTIONS)
    seconds = time.thread_time() - begin
    out = {}
    for count in passes:
        begin = time.thread_time()
        found, report = minimise_network_by_steps(problem, start, PaperOptions(max_passes=count))
        spent = time.thread_time() - begin
        system = problem.linearise(found)
        assert system is not None
        newton = system.solve(0.0)
        out[f"{what}, {count} passes"] = {
            "rms_ratio": float(np.sqrt(report.final_cost / best.final_cost)),
            "sigmas": float(np.sqrt(2 * newton.decrease)) if newton is not None else float("nan"),
            "passes": report.iterations, "evaluations": report.evaluations, "cpu_s": spent, "times": spent / seconds,
            "newton_ms": 1e3 * seconds, "newton_evaluations": best.evaluations, "converged": report.converged,
        }  # fmt: skip
        if report.converged:
            break
    return out


def main(quick: bool = False) -> dict[str, dict[str, float]]:
    """Measure, print the table, return its rows."""
    figures: dict[str, dict[str, float]] = {}
    print("steps, after                          RMS  from the minimum  evaluations    CPU s    times")
    for what in ("poses and markers", "everything"):
        found = rows(what, PASSES[:2] if quick else PASSES)
        figures |= found
        for key, r in found.items():
            print(f"{key:34s} {r['rms_ratio']:7.4f} {r['sigmas']:12.4f} sigma {r['evaluations']:12.0f}"
                  f" {r['cpu_s']:8.2f} {r['times']:8.0f}{'  ended' if r['converged'] else ''}", flush=True)  # fmt: skip
        print(f"{what}, Levenberg-Marquardt: {r['newton_evaluations']:.0f} evaluations, {r['newton_ms']:.1f} ms")
    return figures


if __name__ == "__main__":
    main("--quick" in sys.argv)
