"""A wrong click among 8 to 16 of `windmark epipolar`: is it named, is it said to be unchecked, or taken silently?

Two pictures 10 to 30 degrees apart of a wing with its body before walls, of a block filled with markers, and of a
nearly flat plate (3 mm). One click is displaced by 15 to 200 px onto a false spot, or means another marker in the
second picture. Without a camera the spots have 1 px noise and the lens does not distort; with one they have 0.1 px;
"bare": with a camera, and pictures that have no spots but the clicked ones.

"Silent" are wrong clicks that are neither named nor unchecked, and sets without a wrong click of which all are checked;
"silent, off", which must be 0, those whose lines miss the true places of all markers of both pictures by more than 5 of
their own sigmas. "Misnamed" are right clicks that are called wrong, "left" right ones said to be unchecked, "wrong" are
matches, beside the wrong click, of two markers.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "epipolar"))
import clicked_scenes as scenes

NUMBERS = (8, 9, 10, 11, 12, 14, 16)
SHAPES = ("wing", "block", "plate")


def main(quick: bool = False, seeds: int = 3) -> dict[str, dict[str, int]]:
    """Print one table; return its rows."""
    figures: dict[str, dict[str, int]] = {}
    print(f"{'':34s} " + " ".join(f"{c:>12s}" for c in scenes.COLUMNS) + "      s")
    for kind in ("no camera", "camera", "bare"):
        for wrong in (True, False):
            for shape in SHAPES:
                start, total = time.process_time(), np.zeros(len(scenes.COLUMNS), dtype=int)
                for number in NUMBERS:
                    for seed in range(9000, 9000 + (2 if quick else seeds)):
                        row = scenes.one(shape, number, seed, kind, wrong)
                        total += 0 if row is None else row
                name = f"{kind}, {'one wrong' if wrong else 'all right'}, {shape}"
                figures[name] = dict(zip(scenes.COLUMNS, total.tolist(), strict=True))
                seconds = time.process_time() - start
                print(f"{name:34s} " + " ".join(f"{v:12d}" for v in total) + f" {seconds:6.1f}", flush=True)
    return figures


if __name__ == "__main__":
    main("--quick" in sys.argv)
