"""The paper's cross-check (AIAA 2005-5007, section IV.D): two sets of pictures of the same markers, calibrated apart.

Scenario S1 (`_networks`): two times 25 pictures of 100 markers on a plate of 690 mm, no picture in both, 0.1 px of
noise, new pictures and noise for every seed; the same rough markers. "chi2": mean squared difference of the markers in
units of both covariances, 1 where these tell the whole story; "+-" is its 1 sigma by the scatter over the seeds.
"95 %": markers whose difference is within the ellipsoid that should hold 95 %. Datums: free network, and four markers
held.
"""

from __future__ import annotations

import sys

import numpy as np
from scipy.stats import chi2

import _networks as nets
from windmark.calibration import Calibration, Fixed, Free, self_calibrate
from windmark.calibration.quality import compare

SEEDS = 2_714_000
ROUGH_MM = 3.0


def pair(seed: int, held: bool) -> tuple[Calibration, Calibration]:
    """Two calibrations of one plate."""
    rng = np.random.default_rng([seed, 1])
    first = nets.scenario("S1", seed)
    second = nets.pictures("S1", first.truth.points, 25, 0.8, rng)
    rough = first.truth.points + rng.normal(0, ROUGH_MM, first.truth.points.shape)
    datum: Free | Fixed = Free()
    if held:
        rough[first.primaries] = first.truth.points[first.primaries]
        datum = Fixed([f"m{n:04d}" for n in first.primaries])
    out = [self_calibrate(*s.nouns(s.noisy(rng), rough, 1.05, posed=True), datum=datum) for s in (first, second)]
    a, b = out
    assert isinstance(a, Calibration), a
    assert isinstance(b, Calibration), b
    return a, b


def row(held: bool, runs: int) -> dict[str, float]:
    """Agreement over many pairs of sets."""
    squares, rms, inside = [], [], []
    for run in range(runs):
        a, b = pair(SEEDS + run, held)
        found = compare(a, b)
        squares.append(found.ratio**2)
        rms.append(found.rms)
        inside.append(float((found.chi2[np.isfinite(found.chi2)] < chi2.ppf(0.95, 3)).mean()))
    return {
        "seeds": runs, "rms_mm": float(np.sqrt(np.mean(np.square(rms)))), "chi2": float(np.mean(squares)),
        "chi2_sigma": float(np.std(squares, ddof=1) / np.sqrt(runs)), "inside": float(np.mean(inside)),
        "least": float(np.sqrt(min(squares))), "most": float(np.sqrt(max(squares))),
    }  # fmt: skip


def main(quick: bool = False, runs: int = 40) -> dict[str, dict[str, float]]:
    """Measure, print the table, return its rows."""
    figures: dict[str, dict[str, float]] = {}
    print("datum   seeds  difference rms mm   chi2    +-     95 %   ratio of a pair, least and most")
    for held in (False, True):
        r = figures["held" if held else "free"] = row(held, 3 if quick else runs)
        print(f"{'4 held' if held else 'free':7s} {r['seeds']:5.0f} {r['rms_mm']:18.4f} {r['chi2']:6.3f}"
              f" {r['chi2_sigma']:5.3f} {100 * r['inside']:7.1f}% {r['least']:10.2f} {r['most']:5.2f}",
              flush=True)  # fmt: skip
    return figures


if __name__ == "__main__":
    numbers = [int(a) for a in sys.argv[1:] if a.isdigit()]
    main("--quick" in sys.argv, *numbers)
