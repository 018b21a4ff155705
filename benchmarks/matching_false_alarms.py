"""Is the false-alarm number honest? On pictures of nothing but clutter, count how often it falls below a limit.

`log10_nfa` promises that chance gives fewer than 10^t solutions with a number below 10^t per picture. Here every
other test of acceptance is off, so that whatever the search finds best is reported with its number; the share of
pictures below each limit must not exceed the limit. Uniform clutter is the model behind the number; clustered clutter
is what dust and rivets do, and is held by the local density of spots.
"""

from __future__ import annotations

import sys
import time

import numpy as np

import _matching_cases as cases
from windmark.registration import Registration, prepare, register

LIMITS = (0, -1, -2, -3)
KINDS = {"uniform clutter": cases.clutter, "clustered clutter": cases.clusters}
FIRST_SEED = 1_910_000
OPEN = {"max_log10_nfa": 3.0, "min_score": -1e9, "min_margin": 0.0, "max_table_error": 1e9}
"""Options that accept anything: only the number is of interest."""


def numbers(kind: str, count: int) -> np.ndarray:
    """(count,) log10 of the false-alarm number of the best solution, inf where there was none."""
    found = np.full(count, np.inf)
    for n in range(count):
        case = KINDS[kind](FIRST_SEED + n)
        result = register(case.detections, case.markers, case.camera, layout=prepare(case.markers), **OPEN)
        if isinstance(result, Registration):
            found[n] = result.log10_nfa
    return found


def main(quick: bool = False, count: int = 1000) -> dict[str, dict[str, float]]:
    """Measure, print one table, return its rows."""
    count = 30 if quick else count
    figures: dict[str, dict[str, float]] = {}
    heads = " ".join(f"{f'below 1e{t:+d}':>14s}" for t in LIMITS)
    print(f"{'pictures of':20s} {'pictures':>8s} {heads}    lowest")
    for kind in KINDS:
        start = time.perf_counter()
        found = numbers(kind, count)
        below = {t: int((found < t).sum()) for t in LIMITS}
        cells = " ".join(f"{below[t]:5d} <= {count * 10.0**t:5.4g}" for t in LIMITS)
        print(f"{kind:20s} {count:8d} {cells}   {found.min():6.2f}   ({time.perf_counter() - start:.0f} s)", flush=True)
        figures[kind] = {"pictures": count, "lowest": float(found.min())} | {
            f"below_1e{t:+d}": float(n) for t, n in below.items()
        }
    return figures


if __name__ == "__main__":
    arguments = [int(a) for a in sys.argv[1:] if a.isdigit()]
    main("--quick" in sys.argv, *arguments)
