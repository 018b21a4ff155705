"""Known markers whose errors are correlated: the bound, coverage, and what leaving the correlations out costs.

    python benchmarks/calibration_control.py [SURVEYS] [--seed S]

A plate of 690 mm with 40 markers in ten pictures, 0.1 px of noise (`calibration_contradictions`). Eight of the markers
were surveyed by one instrument 3 m away: 0.02 mm of each point's own (1 sigma per coordinate), and what all share, a
turn of the instrument (0.1 mrad about each axis, 0.3 mm at the markers) and its scale (50 ppm). Every survey has scene,
errors and noise of its own. `Weighted` has the joint covariance, or its diagonal alone, as sigmas in a table are.

"rms / bound": errors of all markers' coordinates beside the Cramer-Rao bound with the joint covariance. "in 95 %":
markers within the 95 % ellipsoid of their stated covariance. "doubts": surveys of which something was named. Where one
of the surveyed points is so many millimetres elsewhere, "named" says that its name is among ``suspect``.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

import _networks as nets
from calibration_contradictions import MARKERS, names, plate
from windmark.adjust.network import KnownTogether, NetworkProblem
from windmark.adjust.network.covariance import network_covariance
from windmark.adjust.network.datum import in_datum
from windmark.calibration import Calibration, NotCalibrated, Weighted, self_calibrate
from windmark.geometry.rotations import hat
from windmark.scene import MarkerCovariance

Array = NDArray[np.float64]

SEED, SURVEYS = 6_300_000, 100
OWN, TURN, SCALE = 0.02, 1e-4, 5e-5
STATION = np.array([300.0, -500.0, 3000.0])
OFF_MM = (0.0, 0.15, 0.3, 1.0)


def surveyed(xyz: Array) -> Array:
    """(3K, 3K) covariance of points."""
    arm = xyz - STATION
    shared = np.concatenate([-hat(arm) * TURN, SCALE * arm[:, :, None]], axis=2).reshape(-1, 4)
    return np.asarray(OWN**2 * np.eye(len(shared)) + shared @ shared.T)


@dataclass
class Tally:
    """What came of the surveys with one kind of covariance."""

    runs: int = 0
    refused: int = 0
    doubts: int = 0
    named: int = 0
    squares: float = 0.0
    limit: float = 0.0
    inside: list[bool] = field(default_factory=list)


def bound(scene: nets.Scenario, known: NDArray[np.int64], cov: Array) -> Array:
    """(N, 3, 3) the Cramer-Rao bound of the markers."""
    values = KnownTogether(known, scene.truth.points[known], MarkerCovariance(names(known), cov).whitener())
    problem = NetworkProblem(nets.replace(scene.network(False), together=values), scene.truth)
    system = problem.linearise(scene.truth)
    assert system is not None
    return in_datum(network_covariance(system, problem.layout)).points()


def one(seed: int, off: float, tallies: dict[str, Tally]) -> None:
    """One survey, told with and without its correlations."""
    rng = np.random.default_rng(seed)
    case = plate(rng)
    scene, truth = case.scene, case.scene.truth.points
    known = np.sort(np.concatenate([scene.primaries, np.setdiff1d(np.arange(MARKERS), scene.primaries)[:4]]))
    cov = surveyed(truth[known])
    table = truth + rng.normal(0, 3.0, truth.shape)
    table[known] = truth[known] + rng.multivariate_normal(np.zeros(len(cov)), cov).reshape(-1, 3)
    step = rng.normal(size=3)
    who = int(rng.choice(known))
    table[who] += off * step / np.linalg.norm(step)
    limit = bound(scene, known, cov)
    for kind, told in (("joint", cov), ("diagonal", np.diag(np.diag(cov)))):
        datum = Weighted(covariance=MarkerCovariance(names(known), told))
        result = self_calibrate(*scene.nouns(case.xy, table, 1.1), datum=datum)
        counted(tallies.setdefault(kind, Tally()), result, truth, limit, names(np.array([who]))[0])


def counted(tally: Tally, result: Calibration | NotCalibrated, truth: Array, limit: Array, who: str) -> None:
    """Add one result."""
    tally.runs += 1
    if not isinstance(result, Calibration):
        tally.refused += 1
        return
    tally.doubts += bool(result.doubts)
    tally.named += who in result.suspect
    at = np.array([int(n[1:]) for n in result.markers.name])
    error = result.markers.xyz - truth[at]
    tally.squares += float((error**2).sum())
    tally.limit += float(np.trace(limit[at], axis1=1, axis2=2).sum())
    size = np.einsum("ni,nij,nj->n", error, np.linalg.inv(result.marker_cov), error)
    tally.inside += (size < chi2.ppf(0.95, 3)).tolist()


def main() -> None:
    """One table for right surveys, one for a wrong point."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("surveys", nargs="?", type=int, default=SURVEYS)
    parser.add_argument("--seed", type=int, default=SEED)
    asked = parser.parse_args()
    print("one point off   covariance  runs  refused  doubts  named  rms / bound  in 95 %")
    for off in OFF_MM:
        tallies: dict[str, Tally] = {}
        for seed in range(asked.seed, asked.seed + (asked.surveys if off == 0 else asked.surveys // 3)):
            one(seed, off, tallies)
        for kind, t in tallies.items():
            ratio = np.sqrt(t.squares / t.limit) if t.limit else np.nan
            print(f"{off:10.2f} mm   {kind:10s}{t.runs:6d}{t.refused:9d}{t.doubts:8d}{t.named:7d}{ratio:13.3f}"
                  f"{100 * np.mean(t.inside or [np.nan]):8.1f} %", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
