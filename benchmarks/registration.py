"""Registration: how often right, how often refused, never wrong, and how much CPU time it takes on one thread.

Scenes A (24 markers in near-regular rows on a nearly flat wing), A0 (exactly regular), B (60 on wing and body) and C
(150, B in a test section): random cameras (10 to 60 degrees, any roll), noise 0.1 to 0.3 px, hidden markers and uniform
false spots, spots in random order (ranked spots are faster). Without anything known but the camera, with a rough prior
(within 25 degrees and 20 %), and with the focal length wrong by up to 30 % and free.

"right": the pose displaces no visible marker by 5 px; a free focal length that no estimate could find within the limit
of 5 % (Cramer-Rao bound with the true labels) does not count if it is refused for that ("untold"; 0 to 8 % of a cell).
"wrong" has to stay 0; "labels": all visible markers labelled and no wrong label, up to spots within three sigma of
another marker's place. The tables of the markers are prepared before (`prepare`); the paper's search (RANSAC) runs
beside on some of the cases. Arguments: how many cases, and which kinds or conditions, as in
`registration.py 1000 A A0 cold prior`; with a condition named, without the paper's search.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

import _matching_cases as cases
from windmark.registration import Registration, prepare, register

if TYPE_CHECKING:
    from windmark.registration.search.layout import Layout

CELLS = (
    ("A", 0.0, 0.0), ("A", 0.25, 0.5), ("A", 0.5, 1.0), ("A0", 0.0, 0.0), ("A0", 0.5, 1.0),
    ("B", 0.0, 0.0), ("B", 0.25, 0.5), ("B", 0.5, 1.0), ("C", 0.0, 0.0), ("C", 0.5, 1.0),
)  # fmt: skip
FIRST_SEED = 4_730_000
PAPER_SHARE = 40
"""One of so many cases is given to the paper's search."""
CONDITIONS = {"cold": cases.cold, "prior": cases.with_prior, "focal free": cases.free_focal}


@dataclass
class Tally:
    """Outcomes and times of one row of the table."""

    seconds: list[float] = field(default_factory=list)
    refused: Counter[str] = field(default_factory=Counter)
    refused_seconds: list[float] = field(default_factory=list)
    untold: int = 0
    wrong: int = 0
    labelled: int = 0
    false_labels: int = 0

    def run(self, case: cases.Case, method: str, layout: Layout | None) -> None:
        """Register one case and count."""
        start = time.thread_time()
        result = register(
            case.detections, case.markers, case.camera, method=method, layout=layout, **case.options
        )  # fmt: skip
        seconds = time.thread_time() - start
        if not isinstance(result, Registration):
            untold = result.cause == "focal" and case.focal_bound() > result.options["max_focal_sigma"]
            self.untold += untold
            self.refused["untold" if untold else result.cause] += 1
            self.refused_seconds.append(seconds)
            return
        self.seconds.append(seconds)
        self.wrong += not case.pose_right(result)
        if case.truth is not None:
            wrong, missing = case.labels(result.matching)
            self.labelled += wrong == 0 and missing == 0
            self.false_labels += wrong > 0

    def figures(self) -> dict[str, float]:
        """The row of the table."""
        n = len(self.seconds) + len(self.refused_seconds)
        ms, refused = 1e3 * np.array(self.seconds or [np.nan]), 1e3 * np.array(self.refused_seconds or [np.nan])
        return {
            "cases": n,
            "untold": self.untold,
            "right_percent": 100 * (len(self.seconds) - self.wrong) / max(n - self.untold, 1),
            "wrong": self.wrong,
            "labels_percent": 100 * self.labelled / max(n - self.untold, 1),
            "false_labels": self.false_labels,
            "median_ms": float(np.median(ms)),
            "p99_ms": float(np.percentile(ms, 99)),
            "refused_median_ms": float(np.median(refused)),
            "refused_max_ms": float(refused.max()),
            **{f"refused_{cause}": count for cause, count in self.refused.items()},
        }


def rows(
    figures: dict[str, dict[str, float]], made: dict[str, Callable[[int], cases.Case]], seeds: range,
    method: str = "hash",
) -> None:  # fmt: skip
    """Measure rows (name: case of a seed), print them, and put them among the figures."""
    tallies = {name: Tally() for name in made}
    layout = None
    for seed in seeds:
        for name, case_of in made.items():
            case = case_of(seed)
            if method == "hash" and (layout is None or not layout.is_of(case.markers)):
                layout = prepare(case.markers).ready()
            tallies[name].run(case, method, layout)
    for name, tally in tallies.items():
        r = figures[f"{name}, {method}"] = tally.figures()
        why = ", ".join(f"{count} {cause}" for cause, count in tally.refused.most_common())
        print(f"{name:36s} {method:6s} {r['cases']:5.0f} {r['right_percent']:6.1f}% {r['wrong']:5.0f}"
              f" {r['labels_percent']:6.1f}% {r['false_labels']:5.0f} {r['median_ms']:7.2f} {r['p99_ms']:7.1f}"
              f" {r['refused_median_ms']:7.0f} {r['refused_max_ms']:7.0f}  {why}", flush=True)  # fmt: skip


def header() -> None:
    """The table's first line."""
    print(f"{'':36s} {'method':6s} {'cases':>5s} {'right':>7s} {'wrong':>5s} {'labels':>7s} {'false':>5s}"
          f" {'median':>7s} {'99 %':>7s} {'refusal':>7s} {'most':>7s}  refused (times in ms)")  # fmt: skip


def main(
    quick: bool = False, count: int = 1000, kinds: Collection[str] = (), conditions: Collection[str] = ()
) -> dict[str, dict[str, float]]:
    """Measure, print one table, return its rows."""
    count = 20 if quick else count
    figures: dict[str, dict[str, float]] = {"first_call": {"compile_s": _first_call()}}
    print(f"first call (compiled or read from numba's cache): {figures['first_call']['compile_s']:.2f} s")
    header()
    for kind, hidden, false in CELLS:
        if kinds and kind not in kinds:
            continue
        made = {
            f"{kind} {hidden:.0%} hidden {false:.0%} false {condition}": partial(
                make, kind=kind, hidden=hidden, false=false
            )
            for condition, make in CONDITIONS.items()
            if not conditions or condition in conditions
        }
        rows(figures, made, range(FIRST_SEED, FIRST_SEED + count))
        if not conditions:
            rows(figures, made, range(FIRST_SEED, FIRST_SEED + max(count // PAPER_SHARE, 5)), "ransac")
    return figures


def _first_call() -> float:
    case = cases.cold(0, "A", 0.0, 0.0)
    start = time.thread_time()
    register(case.detections, case.markers, case.camera)
    return time.thread_time() - start


if __name__ == "__main__":
    numbers = [int(a) for a in sys.argv[1:] if a.isdigit()]
    words = set(sys.argv[1:])
    main("--quick" in words, *numbers, kinds=words & {kind for kind, _, _ in CELLS}, conditions=words & set(CONDITIONS))
