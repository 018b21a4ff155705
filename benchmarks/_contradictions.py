"""The table that the benchmarks of contradictory data print: kinds of faults, what came of each, and figures of it."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Outcome = tuple[str, str, Array]
"""right, named, refused or WRONG; "right name" or what else was said; deviations from the truth in stated sigmas."""
Figure = Callable[[Sequence[tuple[str, Array]]], float]
"""A number from what came of every trial and its deviations; NaN where there is none."""

HEADS = ("right", "named", "refused", "WRONG")


def table(
    text: str, kinds: Mapping[str, Any], outcome: Callable[[Any, np.random.Generator], Outcome],
    figures: Mapping[str, Figure], trials: int, seed: int,
) -> None:  # fmt: skip
    """Read the command line, then print one row a kind; ``outcome`` takes what a kind makes, and the generator."""
    parser = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("trials", nargs="?", type=int, default=trials)
    parser.add_argument("kinds", nargs="*", help="parts of names; none means all")
    parser.add_argument("--seed", type=int, default=seed)
    asked = parser.parse_args()
    heads = (*HEADS, "right name", *figures)
    print(f"{'kind':36s}" + "".join(f"{h:>{12 if h == 'right name' else 9}s}" for h in heads))
    total: Counter[str] = Counter()
    for kind, make in kinds.items():
        if asked.kinds and not any(part in kind for part in asked.kinds):
            continue
        total += _row(kind, make, outcome, figures, range(asked.seed, asked.seed + asked.trials))
    print("all:", ", ".join(f"{k} {n}" for k, n in total.items()))


def _row(
    kind: str, make: Any, outcome: Callable[[Any, np.random.Generator], Outcome], figures: Mapping[str, Figure],
    seeds: range,
) -> Counter[str]:  # fmt: skip
    done: list[tuple[str, Array]] = []
    other: Counter[str] = Counter()
    wrong: list[tuple[int, float]] = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        what, name, z = outcome(make(rng), rng)
        done.append((what, z))
        other[name] += 1
        if what == "WRONG":
            wrong.append((seed, round(float(z.max()), 1)))
    count = Counter(what for what, _ in done)
    values = [f"{value:9.2f}" if np.isfinite(value := figure(done)) else f"{'-':>9s}" for figure in figures.values()]
    said = ", ".join(f"{n} {k}" for k, n in other.items() if k not in ("", "right name"))
    print(f"{kind:36s}" + "".join(f"{count[h]:9d}" for h in HEADS) + f"{other['right name']:12d}" + "".join(values)
          + f"  {said} {wrong[:3] or ''}", flush=True)  # fmt: skip
    return count


def rms(values: Sequence[Array]) -> float:
    """Root mean square of all of them; NaN of none."""
    every = np.concatenate([np.zeros(0), *values])
    return float(np.sqrt(np.mean(every**2))) if len(every) else float("nan")
