"""Memory of self-calibration: the largest resident set of a fresh process that solves one scenario.

S3 (`_networks`): 500 pictures of 2000 markers, some 320,000 marks. "before": after imports, with all kernels compiled
on S1; then the highest mark after building the scenario, after the solution (from the rough start to the minimum),
and after the complete marginal covariance; apart from that, of the whole verb `self_calibrate` from given poses.
"""

from __future__ import annotations

import resource
import subprocess
import sys

import numpy as np

import _networks as nets
from calibration import OPTIONS, SEEDS
from windmark.adjust.levenberg_marquardt import minimise
from windmark.adjust.network import NetworkProblem
from windmark.adjust.network.covariance import network_covariance
from windmark.adjust.network.datum import in_datum
from windmark.calibration import Free, self_calibrate

MARKS = ("before", "scenario", "solution", "covariance")


def peak_mb() -> float:
    """Largest resident set so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def engine(name: str) -> list[float]:
    """Peaks of the engine alone: see `MARKS`."""
    _solve("S1")
    peaks = [peak_mb()]
    scene = nets.scenario(name, SEEDS)
    network, start = _given(scene)
    peaks.append(peak_mb())
    problem = NetworkProblem(network, start)
    _, system, report = minimise(problem, start, OPTIONS)
    assert report.converged, report
    peaks.append(peak_mb())
    in_datum(network_covariance(system, problem.layout)).points()
    return [*peaks, peak_mb()]


def verb(name: str) -> list[float]:
    """Peaks before and after the whole verb."""
    _calibrate("S1")
    before = peak_mb()
    _calibrate(name)
    return [before, peak_mb()]


def _given(scene: nets.Scenario) -> tuple[nets.Network, nets.NetworkState]:
    rng = np.random.default_rng(SEEDS)
    return scene.network(False, scene.noisy(rng)), scene.start(rng)


def _solve(name: str) -> None:
    network, start = _given(nets.scenario(name, SEEDS))
    problem = NetworkProblem(network, start)
    system = minimise(problem, start, OPTIONS)[1]
    in_datum(network_covariance(system, problem.layout)).points()


def _calibrate(name: str) -> None:
    scene, rng = nets.scenario(name, SEEDS), np.random.default_rng(SEEDS)
    rough = scene.truth.points + rng.normal(0, 3.0, scene.truth.points.shape)
    assert self_calibrate(*scene.nouns(scene.noisy(rng), rough, 1.026, posed=True), datum=Free())


def fresh(what: str, name: str) -> list[float]:
    """The peaks of one function in a process of its own."""
    done = subprocess.run([sys.executable, __file__, what, name], capture_output=True, text=True, check=True)
    return [float(v) for v in done.stdout.split()]


def main(quick: bool = False) -> dict[str, dict[str, float]]:
    """Measure, print the table, return its rows."""
    name = "S2" if quick else "S3"
    peaks = dict(zip(MARKS, fresh("engine", name), strict=True))
    before, whole = fresh("verb", name)
    print(f"{name}, MB: before {peaks['before']:.0f}, with the scenario {peaks['scenario']:.0f}, after the solution"
          f" {peaks['solution']:.0f} ({peaks['solution'] - peaks['before']:.0f} more), after the covariance"
          f" {peaks['covariance']:.0f} ({peaks['covariance'] - peaks['before']:.0f} more)\n"
          f"self_calibrate: before {before:.0f}, after {whole:.0f} ({whole - before:.0f} more)",
          flush=True)  # fmt: skip
    return {"engine_mb": peaks, "verb_mb": {"before": before, "after": whole}}


if __name__ == "__main__":
    if sys.argv[1:2] in (["engine"], ["verb"]):
        print(*globals()[sys.argv[1]](sys.argv[2]))
    else:
        main("--quick" in sys.argv)
