"""Recall of faint and tilted markers, and false markers over things that are none.

    python benchmarks/detection_hunt.py [--quick] [--only WORD] [--seed N]

Faint: discs on almost even light whose matched filter sqrt(s^T C^-1 s) has 6 to 25 sigma (C: white, 25 electrons, or
textured paint of 3 %, 1.5 px), tilted by up to 60 deg, radius 2 to 8; recall by that signal to noise, and false markers
beside them. Clean: the same at depth / noise 10, tilted by up to 70 deg. Clutter: 13 kinds of things that are no
discs (`_clutter`), each over 768 x 768 px, with 40 markers and with none, dark and bright; with the radius given
(and the polarity), and with nothing given (`detect(image, polarity="auto")`, what the command line does).

A marker is found if something is within max(1.5 px, radius / 2) of its centre; anything else is false. Left out: how
well they are measured (`detection_limits`), markers that touch clutter, kinds mixed with each other, and letters of
fonts with round dots (a round dot of the markers' size is a disc).
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from _clutter import PAINTERS
from _hunt_scenes import LIGHT, Hunt, clean, cluttered, faint
from _scoring import pair
from _sensor import Sensor
from windmark.detection import detect

RADII_PX = (2.0, 3.0, 5.0, 8.0)
BINS = (6.0, 8.0, 10.0, 15.0, 25.0)
FIRST_SEED = 290_000  # of the scenes that judge; do not tune on these
SENSORS = {
    "white noise": Sensor(white=6.0),
    "25 electrons": Sensor(white=1.5 * LIGHT / 25, electrons=25),
    "texture 3 %": Sensor(white=2.0, texture=0.03, length=1.5),
}
WAYS: dict[str, Callable[[Hunt], Any]] = {
    "given": lambda h: detect(h.image, radius_px=h.radius, polarity=h.polarity),
    "nothing": lambda h: detect(h.image, polarity="auto"),
}


def hunted(scene: Hunt, way: str) -> tuple[NDArray[np.bool_], int, float]:
    """Which markers were found (N,), the number of false ones, and megapixels."""
    found = WAYS[way](scene)
    pairs = pair(found.xy, scene.xy.reshape(-1, 2), max(1.5, 0.5 * scene.radius))
    seen = np.zeros(len(scene.xy), dtype=bool)
    seen[pairs.true] = True
    return seen, len(pairs.false), scene.image.size / 1e6


def faint_table(results: dict[str, Any], frames: int, seed: int) -> None:
    """Recall by the matched filter's signal to noise."""
    print(f"\n{'faint':28s}" + "".join(f"{f'{a:g}-{b:g} sigma':>20s}" for a, b in pairwise(BINS))
          + f"{'false/Mpx':>11s}")  # fmt: skip
    for name, sensor in SENSORS.items():
        for radius in RADII_PX:
            scenes = [faint(radius, seed + k, sensor, (BINS[0], BINS[-1])) for k in range(frames)]
            _faint_row(results, f"{name}, r {radius:g}", scenes, "given")
    for name, sensor in SENSORS.items():
        scenes = [faint(5.0, seed + k, sensor, (BINS[0], BINS[-1])) for k in range(frames)]
        _faint_row(results, f"{name}, r 5, nothing given", scenes, "nothing")


def _faint_row(results: dict[str, Any], name: str, scenes: list[Hunt], way: str) -> None:
    outcome = [hunted(s, way) for s in scenes]
    seen, snr = np.concatenate([o[0] for o in outcome]), np.concatenate([s.snr for s in scenes])
    false = sum(o[1] for o in outcome) / sum(o[2] for o in outcome)
    row = []
    for low, high in pairwise(BINS):
        mine = (snr >= low) & (snr < high)
        row.append((100 * float(seen[mine].mean()) if mine.any() else np.nan, int(mine.sum())))
    results[name] = {"recall %": [r for r, _ in row], "false/Mpx": false}
    print(f"{name:28s}" + "".join(f"{r:11.1f} % of {n:4d}" for r, n in row) + f"{false:11.2f}", flush=True)


def clean_table(results: dict[str, Any], frames: int, seed: int) -> None:
    """Recall at depth / noise 10 by tilt."""
    edges = (0, 45, 60, 65, 70)
    names = [f"{a}-{b} deg" for a, b in pairwise(edges)]
    print(f"\n{'clean, depth/noise 10':28s}" + "".join(f"{n:>19s}" for n in names) + f"{'false/Mpx':>11s}")
    for radius in RADII_PX:
        for way in WAYS:
            # Large discs are few in a frame: more frames.
            scenes = [clean(radius, seed + k, 10.0) for k in range(frames * (2 if radius > 4 else 1))]
            outcome = [hunted(s, way) for s in scenes]
            seen, tilt = np.concatenate([o[0] for o in outcome]), np.concatenate([s.tilt_deg for s in scenes])
            false = sum(o[1] for o in outcome) / sum(o[2] for o in outcome)
            part = [seen[(tilt >= a) & (tilt < b)] for a, b in pairwise(edges)]
            text = "".join(f"{100 * p.mean():9.2f} % of {len(p):4d}" for p in part)
            name = f"r {radius:g}, {way if way == 'nothing' else 'radius'} given"
            results[f"clean, {name}"] = {"recall %": 100 * float(seen.mean()), "false/Mpx": false}
            print(f"{name:28s}{text}{false:11.2f}", flush=True)


def clutter_table(results: dict[str, Any], pictures: int, seed: int, word: str) -> None:
    """False markers over each kind of clutter, pictures without any, and recall of the markers beside it."""
    heads = [f"{p}, {'radius' if w == 'given' else 'nothing'} given" for w in WAYS for p in ("dark", "bright")]
    print(f"\n{f'clutter, {pictures} pictures':28s}" + "".join(f"{h:>26s}" for h in heads))
    print(f"{'':28s}" + "".join(f"{'false/Mpx clean recall %':>26s}" for _ in heads))
    for kind in PAINTERS:
        for markers in (40, 0):
            name = f"{kind}, {markers or 'no'} markers"
            if word not in name:
                continue
            tally: dict[tuple[str, str], list[Any]] = {(w, p): [] for w in WAYS for p in ("dark", "bright")}
            for k in range(pictures):
                for scene in cluttered(kind, (3.0, 4.0, 6.0)[k % 3], seed + k, markers):
                    for way in WAYS:
                        tally[way, scene.polarity].append(hunted(scene, way))
            row, text = {}, ""
            for (way, polarity), outcome in tally.items():
                false = sum(o[1] for o in outcome) / sum(o[2] for o in outcome)
                spotless, seen = sum(o[1] == 0 for o in outcome), np.concatenate([o[0] for o in outcome])
                recall = 100 * float(seen.mean()) if len(seen) else np.nan
                row[f"{polarity}, {way}"] = {"false/Mpx": false, "pictures without": spotless, "recall %": recall}
                text += f"{false:13.2f}{spotless:5d}" + (f"{recall:8.1f}" if len(seen) else f"{'-':>8s}")
            results[name] = row
            print(f"{name:28s}{text}", flush=True)


def main(quick: bool = False, only: str = "", seed: int = FIRST_SEED) -> dict[str, object]:
    """Measure, print the tables, return their numbers."""
    results: dict[str, object] = {}
    if only in ("", "faint"):
        faint_table(results, 1 if quick else 8, seed)
    if only in ("", "clean"):
        clean_table(results, 2 if quick else 12, seed)
    if only not in ("faint", "clean"):
        clutter_table(results, 3 if quick else 20, seed, only)
    return results


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--quick", action="store_true", help="fewer frames")
    parser.add_argument("--only", default="", metavar="WORD", help="faint, clean, or a word of a kind of clutter")
    parser.add_argument("--seed", type=int, default=FIRST_SEED)
    options = parser.parse_args()
    main(options.quick, options.only, options.seed)
