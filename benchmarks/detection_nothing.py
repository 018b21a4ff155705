"""False markers on surfaces that have none, by kind.

    python benchmarks/detection_nothing.py [--quick] [--seed N] [--pictures N] [--only WORD] [--sheets DIR]

27 kinds of surfaces without a disc (`_nothing`, `_nothing_more`: other generators than `_clutter`, which the rules of
the decision were measured on), 640 x 640 px, things of about 3, 4 and 6 px radius, half of the pictures dark on light
and half bright on dark; of `_nothing_more` every third after JPEG. Each is looked at with the radius and the polarity
given, with no option (`detect(image)`) and as the command does (`polarity="auto"`). Per Mpx. Three more kinds are
printed discs or nearly (full stops, screw heads, highlights out of focus): what is found there is no mistake. Left out:
surfaces with markers beside these things (`detection_hunt`).
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from _nothing import KINDS, picture
from _nothing_more import KINDS as MORE
from _nothing_more import ROUND, squeezed
from windmark.detection import detect

RADII_PX = (3.0, 4.0, 6.0)
FIRST_SEED = 830_000  # of the pictures that judge; do not tune on these
WAYS = ("radius given", "no option", "as the command")


def found(way: str, image: NDArray[np.uint8], radius: float, bright: bool) -> Any:
    """Markers found in one of `WAYS`."""
    if way == "radius given":
        return detect(image, radius_px=radius, polarity="bright" if bright else "dark")
    return detect(image) if way == "no option" else detect(image, polarity="auto")


def sheet(path: Path, cut: list[NDArray[np.uint8]]) -> None:
    """Pieces of the pictures round false markers, side by side."""
    import cv2

    path.parent.mkdir(parents=True, exist_ok=True)
    cut = [*cut[:60], *[np.zeros_like(cut[0])] * (-len(cut[:60]) % 10)]
    rows = [np.hstack(cut[k : k + 10]) for k in range(0, len(cut), 10)]
    cv2.imwrite(str(path), cv2.resize(np.vstack(rows), None, fx=3, fy=3, interpolation=cv2.INTER_NEAREST))


def main(
    quick: bool = False, seed: int = FIRST_SEED, pictures: int = 0, only: str = "", sheets: Path | None = None
) -> dict[str, object]:
    """Measure, print one table, return its numbers."""
    results: dict[str, Any] = {}
    pictures = pictures or (1 if quick else 4)
    print(f"{'false markers per Mpx':14s}" + "".join(f"{w:>18s}" for w in WAYS) + "   by radius, the first way")
    every = {**KINDS, **MORE, **ROUND}
    for kind in every:
        if only not in kind:
            continue
        count, by, area, cut = dict.fromkeys(WAYS, 0), dict.fromkeys(RADII_PX, 0), 0.0, []
        for radius in RADII_PX:
            for k in range(pictures):
                image = picture(kind, radius, seed + k, k % 2 == 1, every)
                if kind not in KINDS and k % 3 == 2:
                    image = squeezed(image)
                area += image.size / 1e6
                for way in WAYS:
                    markers = found(way, image, radius, k % 2 == 1)
                    count[way] += len(markers)
                    if way == WAYS[0]:
                        by[radius] += len(markers)
                        wide = np.pad(image, 16, mode="edge")
                        cut += [wide[y : y + 32, x : x + 32] for x, y in np.rint(markers.xy).astype(int)]
        if sheets is not None and cut:
            sheet(sheets / f"{kind}.png", cut)
        results[kind] = {way: n / area for way, n in count.items()}
        name = f"{kind} (round)" if kind in ROUND else kind
        print(f"{name:21s}" + "".join(f"{n / area:18.1f}" for n in count.values())
              + "   " + " ".join(f"{r:g}: {3 * n / area:.1f}" for r, n in by.items()), flush=True)  # fmt: skip
    return results


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--quick", action="store_true", help="fewer pictures")
    parser.add_argument("--seed", type=int, default=FIRST_SEED)
    parser.add_argument("--pictures", type=int, default=0)
    parser.add_argument("--only", default="", metavar="WORD")
    parser.add_argument("--sheets", type=Path, metavar="DIR", help="pieces of the pictures round false markers")
    given = parser.parse_args()
    main(given.quick, given.seed, given.pictures, given.only, given.sheets)
