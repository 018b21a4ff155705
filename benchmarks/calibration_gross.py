"""Self-calibration with gross errors: are they found, are good marks kept, is the rest as exact as without them?

Scenario S1 (`_networks`: 25 pictures of 100 markers on a nearly flat plate), 0.1 px of noise. A share of the marks is
wrong: half of these carry the label of another marker, the others are off by 10 to 1000 sigma (evenly in the
logarithm, any direction). `self_calibrate` starts from markers off by 5 mm, no poses, a focal length 10 % off.

"rms/CRLB": root mean square error of the markers over all runs beside the Cramer-Rao bound of the same network without
the wrong marks; "/oracle": beside the least-squares solution of the same noise without the wrong marks, which has
nothing of chance left. "false alarms": good marks that were left out. "small": errors of 5 and 7 sigma on 2 % of the
marks that were left out. "swaps": pairs of markers exchanged in one to five pictures, 1 % of wrong marks beside them.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import _networks as nets
from windmark.calibration import Calibration, Free, self_calibrate
from windmark.geometry.similarity import align

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SEEDS = 2_711_000
SHARES = (0.02, 0.05, 0.10, 0.20, 0.30)
ROUGH_MM, FOCAL = 5.0, 1.1
SMALL = (5.0, 7.0)
PAIRS, MOST_PICTURES = 3, 5
"""Pairs of markers exchanged in a run, in up to so many pictures each."""


@dataclass
class Tally:
    """Sums over the runs of one row."""

    runs: int = 0
    refused: int = 0
    gross: int = 0
    found: int = 0
    good: int = 0
    lost: int = 0
    squares: float = 0.0
    oracle: float = 0.0
    limit: float = 0.0

    def figures(self) -> dict[str, float]:
        """What is printed."""
        return {
            "runs": self.runs, "refused": self.refused, "gross": self.gross, "missed": self.gross - self.found,
            "false_alarms": self.lost / max(self.good, 1), "rms_over_crlb": float(np.sqrt(self.squares / self.limit)),
            "rms_over_oracle": float(np.sqrt(self.squares / self.oracle)),
        }  # fmt: skip


def wrong_marks(scene: nets.Scenario, share: float, rng: np.random.Generator) -> tuple[Array, Mask]:
    """Noisy marks with gross errors, and which are wrong."""
    xy = scene.noisy(rng)
    wrong = np.zeros(len(xy), bool)
    wrong[rng.choice(len(xy), round(share * len(xy)), replace=False)] = True
    out = xy.copy()
    for o in np.flatnonzero(wrong):
        other = rng.choice(np.flatnonzero((scene.view == scene.view[o]) & (scene.point != scene.point[o])))
        angle, length = rng.uniform(0, 2 * np.pi), nets.NOISE_PX * 10 ** rng.uniform(1, 3)
        # From the true place: an error of ten sigma is one, whatever the noise was.
        moved = scene.xy[o] + length * np.array([np.cos(angle), np.sin(angle)])
        out[o] = xy[other] if rng.random() < 0.5 else moved
    return out, wrong


def calibrated(scene: nets.Scenario, xy: Array, rng: np.random.Generator) -> Calibration | None:
    """From rough markers; None where refused."""
    rough = scene.truth.points + rng.normal(0, ROUGH_MM, scene.truth.points.shape)
    result = self_calibrate(*scene.nouns(xy, rough, FOCAL), datum=Free())
    return result if isinstance(result, Calibration) else None


def left_out(scene: nets.Scenario, result: Calibration) -> Mask:
    """(O,) marks of the scene that the result does not use."""
    marks, used = result.observations, result.used
    views = np.array([int(v.name[1:]) for v in result.views])
    points = np.array([int(n[1:]) for n in result.markers.name])
    count = len(scene.truth.points)
    kept = views[marks.view[used]] * count + points[marks.point[used]]
    return ~np.isin(scene.view * count + scene.point, kept)


def row(share: float, runs: int) -> dict[str, float]:
    """Figures over many runs of one share of gross errors."""
    tally = Tally()
    scene = nets.scenario("S1", SEEDS)
    for run in range(runs):
        rng = np.random.default_rng([SEEDS, round(1000 * share), run])
        xy, wrong = wrong_marks(scene, share, rng)
        tally.runs += 1
        result = calibrated(scene, xy, rng)
        if result is None:
            tally.refused += 1
            continue
        out = left_out(scene, result)
        tally.gross, tally.found = tally.gross + int(wrong.sum()), tally.found + int((wrong & out).sum())
        tally.good, tally.lost = tally.good + int((~wrong).sum()), tally.lost + int((~wrong & out).sum())
        clean = scene.only(~wrong)
        oracle = self_calibrate(*clean.nouns(xy[~wrong], scene.truth.points, posed=True), datum=Free(), reject=False)
        assert oracle
        tally.limit += float(np.trace(clean.bound(False)[0], axis1=1, axis2=2).sum())
        tally.squares += off(scene, result)
        tally.oracle += off(scene, oracle)
    return tally.figures()


def off(scene: nets.Scenario, result: Calibration) -> float:
    """Sum of squared errors of the markers, fitted to the truth."""
    true = scene.truth.points[[int(n[1:]) for n in result.markers.name]]
    return float(((align(result.markers.xyz, true).apply(result.markers.xyz) - true) ** 2).sum())


def small(size: float, runs: int) -> dict[str, float]:
    """Share of errors of so many sigma on 2 % of the marks that are left out."""
    scene, found, count = nets.scenario("S1", SEEDS), 0, 0
    for run in range(runs):
        rng = np.random.default_rng([SEEDS, 1, round(size), run])
        xy = scene.noisy(rng)
        chosen = rng.choice(len(xy), round(0.02 * len(xy)), replace=False)
        angle = rng.uniform(0, 2 * np.pi, len(chosen))
        xy[chosen] += size * nets.NOISE_PX * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        result = calibrated(scene, xy, rng)
        assert result
        found, count = found + int(left_out(scene, result)[chosen].sum()), count + len(chosen)
    return {"runs": runs, "errors": count, "found": found / count}


def swaps(runs: int) -> dict[str, float]:
    """Exchanged markers: named, not named, and pairs named that were not exchanged."""
    scene = nets.scenario("S1", SEEDS)
    total, named, false, refused = 0, 0, 0, 0
    for run in range(runs):
        rng = np.random.default_rng([SEEDS, 2, run])
        xy, _ = wrong_marks(scene, 0.01, rng)
        noisy, made = scene.noisy(rng), set()
        for pair in rng.permutation(len(scene.truth.points))[: 2 * PAIRS].reshape(PAIRS, 2):
            both = [v for v in range(len(scene.truth.frames.translation)) if _sees(scene, v, pair)]
            for v in rng.permutation(both)[: rng.integers(1, MOST_PICTURES + 1)]:
                a, b = (int(np.flatnonzero((scene.view == v) & (scene.point == p))[0]) for p in pair)
                xy[[a, b]] = noisy[[b, a]]
                made.add((frozenset(f"m{p:04d}" for p in pair), f"v{v:03d}"))
        result = calibrated(scene, xy, rng)
        if result is None:
            refused += 1
            continue
        told = {(frozenset((a, b)), v) for a, b, v in result.swapped}
        total, named, false = total + len(made), named + len(made & told), false + len(told - made)
    return {"runs": runs, "refused": refused, "swaps": total, "named": named, "wrongly_named": false}


def _sees(scene: nets.Scenario, view: int, pair: NDArray[np.int64]) -> bool:
    return bool(np.isin(pair, scene.point[scene.view == view]).all())


def main(quick: bool = False, runs: int = 100) -> dict[str, dict[str, float]]:
    """Measure, print the tables, return their rows."""
    figures: dict[str, dict[str, float]] = {}
    runs = 2 if quick else runs
    print(" wrong  runs  refused  wrong marks  missed  false alarms  rms/CRLB  /oracle")
    for share in SHARES:
        r = figures[f"{100 * share:.0f} %"] = row(share, runs if share == SHARES[0] else max(runs // 4, 1))
        print(f"{100 * share:4.0f} % {r['runs']:5.0f} {r['refused']:8.0f} {r['gross']:12.0f} {r['missed']:7.0f}"
              f" {100 * r['false_alarms']:11.3f} % {r['rms_over_crlb']:9.4f} {r['rms_over_oracle']:8.4f}",
              flush=True)  # fmt: skip
    for size in SMALL:
        r = figures[f"{size:.0f} sigma"] = small(size, max(runs // 5, 1))
        print(f"small: {size:.0f} sigma, {r['errors']:.0f} errors: {100 * r['found']:.1f} % left out", flush=True)
    r = figures["swaps"] = swaps(max(runs // 4, 1))
    print(f"swaps: {r['swaps']:.0f} in {r['runs']:.0f} runs ({r['refused']:.0f} refused): {r['named']:.0f} named,"
          f" {r['wrongly_named']:.0f} named that were none")  # fmt: skip
    return figures


if __name__ == "__main__":
    numbers = [int(a) for a in sys.argv[1:] if a.isdigit()]
    main("--quick" in sys.argv, *numbers)
