"""When registration must say no: clutter, other models, regular layouts, a wrong focal length; and large cases.

No pose is right for clutter, for the picture of another or of a mirrored model, and for a regular grid, so every
accepted one counts as wrong there. With a rough prior for such a grid, with one marker of the grid moved, with 700
unranked false spots, and with 500 markers and 2,000 spots the right pose may be found, or refused, but no other
accepted. With a focal length wrong by 20 % no pose is right within 5 px; there only wrong labels ("false") are errors.
"""

from __future__ import annotations

import sys
from functools import partial

import _matching_cases as cases
from registration import header, rows

FIRST_SEED = 5_830_000
KINDS = {
    "clutter": cases.clutter,
    "clustered clutter": cases.clusters,
    "another model": cases.other_model,
    "another wing": cases.other_wing,
    "mirrored wing": cases.mirrored,
    "regular grid": cases.regular_grid,
    "regular grid, rough prior": cases.grid_with_prior,
    "grid, one marker moved": cases.nearly_regular_grid,
    "focal wrong by 20 %": cases.wrong_focal,
    "700 unranked false spots": cases.unranked,
}


def main(quick: bool = False, count: int = 1000) -> dict[str, dict[str, float]]:
    """Measure, print one table, return its rows."""
    count = 9 if quick else count
    figures: dict[str, dict[str, float]] = {}
    header()
    for name, case in KINDS.items():
        rows(figures, {name: case}, range(FIRST_SEED, FIRST_SEED + count))
    for ranked in (True, False):
        name = f"500 markers 2000 spots {'ranked' if ranked else 'unranked'}"
        rows(figures, {name: partial(cases.large, ranked=ranked)}, range(FIRST_SEED, FIRST_SEED + max(count // 50, 3)))
    return figures


if __name__ == "__main__":
    numbers = [int(a) for a in sys.argv[1:] if a.isdigit()]
    main("--quick" in sys.argv, *numbers)
