"""Attacks on registration: pictures and tables that invite a wrong answer with a small sigma.

    python benchmarks/attacks.py [TRIALS] [ATTACK ...] [--seed S] [--json FILE]
    python benchmarks/attacks.py --show ATTACK/VARIANT/SEED

An attack is a kind of scene in which a matcher that does not look far enough is sure of something false: a pose that
hangs on one spot, a regular layout, a mirrored table, a board larger than its table, a camera that is not as stated, a
second copy of the model. Attacks are given by number or name, none means all. Every seed makes one trial; nothing but
the public verbs of `windmark.registration` is called, so the table can be compared across versions.

An answer is WRONG where it displaces the counted markers by more than 1 px on average, in the camera that took the
picture (4 px in real pictures), and that error is more than five of the stated sigmas (root of chi-square over six,
from ``result.cov``); or where more than half of its labels are wrong. Where no pose is right (a mirrored picture) every
accepted one is wrong. A wrong answer is "said" instead where the picture cannot show the fault and the result names it
(``unchecked``). Of a bent model the right pose is that of what stands still; of a bent wing alone that of the root, of
the least squares in space or of those in the picture, whichever is nearest. A refusal is for the right reason if its
cause or a word of it is in the table `_attack_judge.REASONS`; of what must be accepted no reason is right.

"labels": wrong labels of all the accepted answers, in percent. "chi2/6": of the pose, mean and 99 % quantile over the
accepted answers with mostly right labels; 1 and 2.8 for a true covariance, if the errors are normal. Of a sequence the
worst frame counts. "ms": median CPU time of this thread.

What the figures leave out: the share of attacks among real pictures (every trial here is an attack); answers that are
off by less than a pixel, and those whose covariance owns up to it; covariances that are too large. Where the time limit
of a search strikes, its answer is that of this machine. Spots of the real boards take half a minute to detect; where
their data are absent those rows are left out.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

import _attack_judge as judge
from _attack_scenes import ATTACKS, Attack, attack, trial

TRIALS, QUICK, SEED = 500, 2, 7_000_000
WRONG_SHOWN = 3
"""Seeds of wrong answers that a row names."""


def row(one: Attack, variant: str, seeds: range) -> dict[str, Any]:
    """Judge all trials of a variant."""
    outcomes = {seed: judge.run(one.name, one.variants[variant](seed)) for seed in seeds}
    count = Counter(o.kind for o in outcomes.values())
    accepted = [o for o in outcomes.values() if o.matched]
    chi2 = [o.sigmas**2 for o in accepted if 2 * o.wrong <= o.matched and np.isfinite(o.sigmas)]
    return {
        "trials": len(seeds), **{kind: count[kind] for kind in judge.KINDS},
        "wrong_labels_percent": 100 * sum(o.wrong for o in accepted) / max(sum(o.matched for o in accepted), 1),
        "chi2_mean": float(np.mean(chi2)) if chi2 else float("nan"),
        "chi2_99": float(np.quantile(chi2, 0.99)) if chi2 else float("nan"),
        "median_ms": float(np.median([o.milliseconds for o in outcomes.values()])),
        "wrong_seeds": [seed for seed, o in outcomes.items() if o.kind == "WRONG"],
        "refusals": dict(Counter(o.word.split(":")[0] for o in outcomes.values() if o.kind in ("reason", "refused"))),
    }  # fmt: skip


def told(attack_name: str, variant: str, r: dict[str, Any]) -> str:
    """One row of the table."""
    counts = "".join(f"{r[kind]:>8}" for kind in judge.KINDS)
    figures = f"{r['wrong_labels_percent']:7.1f}%{r['chi2_mean']:9.3g}{r['chi2_99']:9.3g}{r['median_ms']:8.1f}"
    words = ", ".join(f"{n} {cause}" for cause, n in r["refusals"].items())
    wrong = f"  wrong: {' '.join(map(str, r['wrong_seeds'][:WRONG_SHOWN]))}" if r["wrong_seeds"] else ""
    return f"{attack_name:14s}{variant:30s}{r['trials']:>6}{counts}{figures}  {words}{wrong}"


def main(
    quick: bool = False, trials: int = TRIALS, attacks: tuple[Attack, ...] = ATTACKS, first: int = SEED
) -> dict[str, dict[str, Any]]:
    """Judge the attacks, print one table, return its rows."""
    seeds = range(first, first + (QUICK if quick else trials))
    kinds = "".join(f"{kind:>8}" for kind in judge.KINDS)
    print(
        f"{'attack':14s}{'variant':30s}{'trials':>6}{kinds}{'labels':>8}{'chi2/6':>9}{'99 %':>9}{'ms':>8}  refused as"
    )
    judge.run("sparse", trial("sparse/5 of 24/0"))  # the kernels are compiled or loaded
    figures: dict[str, dict[str, Any]] = {}
    for one in attacks:
        for variant in one.variants:
            figures[f"{one.name}/{variant}"] = made = row(one, variant, seeds)
            print(told(f"{one.number:<3d}{one.name}", variant, made), flush=True)
    total = {kind: sum(r[kind] for r in figures.values()) for kind in judge.KINDS}
    print(f"{'all':44s}{sum(total.values()):6d}" + "".join(f"{n:8d}" for n in total.values()))
    return figures


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("words", nargs="*", help="how many trials (the first number), then numbers or names of attacks")
    parser.add_argument("--seed", type=int, default=SEED, help="of the first trial")
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    parser.add_argument("--show", metavar="ATTACK/VARIANT/SEED", help="print one trial in full")
    given = parser.parse_args()
    if given.show:
        print(judge.shown(attack(given.show.split("/")[0]).name, trial(given.show)))
    else:
        count = int(given.words[0]) if given.words else TRIALS
        made = main(False, count, tuple(attack(word) for word in given.words[1:]) or ATTACKS, given.seed)
        if given.json:
            given.json.write_text(json.dumps(made, indent=1))
