"""Detection on real images with truth: recall, false markers, distance to the truth, time.

With the radius (from the size of the discs that each set's README states) and the polarity given, and with no option
at all: `detect(image)`, and `detect(image, polarity="auto")`, which is what the command line does. The data lie beside
the checkout (`../shared/data`); without them the benchmark says so and ends. Left out: how good the truth itself is
(`centres_real`). The chart has no discs, so everything found there is false.

    python benchmarks/detection_real.py [--quick] [--pictures DIR] [--sheets DIR] [SET ...]
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from _real_truth import DATA, SETS, RealSet, View
from _scoring import Detector, Pairs, pair, refinements, simple_blob, timed, windmark_detector
from windmark.detection import detect

COLUMNS = ("views", "true", "recall %", "worst %", "false", "worst", "other", "RMS px", "median", "ms/Mpx")


@dataclass
class Tally:
    """What one detector did on one set: lists over views, errors over markers."""

    true: list[int] = field(default_factory=list)
    found: list[int] = field(default_factory=list)
    false: list[int] = field(default_factory=list)
    other: list[int] = field(default_factory=list)
    error: list[float] = field(default_factory=list)
    ms_per_mpx: list[float] = field(default_factory=list)

    def row(self) -> dict[str, float]:
        """The numbers of `COLUMNS`; RMS and median are of the 2-D distance to the truth."""
        error = np.array(self.error or [np.nan])
        values = (
            len(self.true), sum(self.true), 100 * sum(self.found) / sum(self.true) if any(self.true) else np.nan,
            100 * min([f / t for f, t in zip(self.found, self.true, strict=True) if t] or [np.nan]),
            sum(self.false), max(self.false),
            sum(self.other), float(np.sqrt(np.mean(error**2))), float(np.median(error)),
            float(np.median(self.ms_per_mpx)),
        )  # fmt: skip
        return dict(zip(COLUMNS, values, strict=True))


def judge(view: View, detector: Detector, tally: Tally) -> tuple[np.ndarray, Pairs, np.ndarray]:
    """Add a view to the tally; return the found positions, their pairs with the truth, and which false are other."""
    (xy, _), seconds = timed(lambda: detector(view.image, view.polarity), 2)
    pairs = pair(xy, view.true, view.gate_px)
    # Discs that need not be found are excused however often they are, as nobody can say where their centre is.
    rest = xy[pairs.false]
    excused = np.zeros(len(rest), dtype=bool)
    if len(view.other) and len(rest):
        excused = np.hypot(*(rest[:, None] - view.other).transpose(2, 0, 1)).min(axis=1) <= view.other_gate_px
    tally.true.append(len(view.true))
    tally.found.append(len(pairs.true))
    tally.false.append(int((~excused).sum()))
    tally.other.append(int(excused.sum()))
    tally.error += np.hypot(*(xy[pairs.found] - view.true[pairs.true]).T).tolist()
    tally.ms_per_mpx.append(1e3 * seconds / (view.image.size / 1e6))
    return xy, pairs, excused


def drawn(view: View, xy: np.ndarray, pairs: Pairs, excused: np.ndarray, radius_px: float) -> np.ndarray:
    """The view with found (green), missed (red), false (magenta) and other (blue) circled."""
    import cv2

    low, high = np.percentile(view.image, [0.5, 99.5])
    grey = np.clip((view.image - low) / max(high - low, 1e-9) * 255, 0, 255).astype(np.uint8)
    scale = 2 if max(view.image.shape) < 1300 else 1
    colour = cv2.cvtColor(
        cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST), cv2.COLOR_GRAY2BGR
    )

    def ring(points: np.ndarray, radius: float, bgr: tuple[int, int, int], thick: int) -> None:
        for p in points:
            centre = np.rint(((p + 0.5) * scale - 0.5) * 16).astype(int).tolist()
            cv2.circle(colour, centre, int(radius * scale * 16), bgr, thick, cv2.LINE_AA, 4)

    ring(xy[pairs.found], 1.3 * radius_px + 1, (0, 220, 0), 1)
    ring(view.true[pairs.missed], 1.6 * radius_px + 6, (0, 0, 255), 2)
    ring(xy[pairs.false[~excused]], 1.6 * radius_px + 6, (255, 0, 255), 2)
    ring(xy[pairs.false[excused]], 1.3 * radius_px + 1, (255, 128, 0), 1)
    return colour


def write_sheet(path: Path, parts: list[np.ndarray]) -> None:
    """All views of a set on one picture, at most four side by side."""
    import cv2

    wide = 2560 // min(len(parts), 4)
    small = [cv2.resize(p, (wide, round(wide * p.shape[0] / p.shape[1])), interpolation=cv2.INTER_AREA) for p in parts]
    small += [np.zeros_like(small[0])] * (-len(small) % min(len(small), 4))
    across = min(len(parts), 4)
    rows = [np.hstack(small[k : k + across]) for k in range(0, len(small), across)]
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.vstack(rows))


NOTHING = "no option, as the command"


def run_set(
    name: str, one: RealSet, quick: bool, pictures: Path | None, sheets: Path | None
) -> dict[str, dict[str, float]]:
    """All detectors on one set; pictures and sheets are of the result with nothing given."""
    import cv2

    radii = one.radius_px
    detectors: dict[str, Detector] = {
        NOTHING: windmark_detector(None, polarity="auto"),
        "no option, in Python": lambda image, _: (detect(image).xy, None),
    }
    detectors |= {f"radius given, {r}": windmark_detector(radii, refine=r) for r in refinements()}
    detectors["SimpleBlob tuned"] = simple_blob((radii[0], radii[-1]))
    tallies, parts = {key: Tally() for key in detectors}, []
    for number, view in enumerate(one.views(DATA / one.folder)):
        if quick and number == one.quick:
            break
        for key, detector in detectors.items():
            if number == 0:
                detector(view.image, view.polarity)  # compiles
            result = judge(view, detector, tallies[key])
            if key == NOTHING and (pictures or sheets):
                parts.append(drawn(view, *result, radii[-1]))
                if pictures is not None:
                    file = f"{one.folder}-{view.name}.png".replace(" ", "").replace(",", "-")
                    pictures.mkdir(parents=True, exist_ok=True)
                    cv2.imwrite(str(pictures / file), parts[-1])
    if sheets is not None:
        write_sheet(sheets / f"{one.folder}.png", parts)
    print(f"{name}: radius_px = {radii if len(radii) > 1 else radii[0]}; truth: {one.truth}")
    for key, tally in tallies.items():
        print(f"  {key:26s}" + "".join(f"{_number(v):>9s}" for v in tally.row().values()), flush=True)
    return {key: tally.row() for key, tally in tallies.items()}


def main(
    quick: bool = False, pictures: Path | None = None, names: list[str] | None = None, sheets: Path | None = None
) -> dict[str, object]:
    """Judge on the named sets (all by default), print one table, return its numbers: set -> detector -> column."""
    if not DATA.is_dir():
        print("skipped: the real data are not beside the checkout (../shared/data)")
        return {"skipped": "no data"}
    print(f"{'':28s}" + "".join(f"{name:>9s}" for name in COLUMNS))
    results: dict[str, object] = {}
    for name in names or list(SETS):
        if not (DATA / SETS[name].folder).is_dir():
            print(f"{name}: skipped, {SETS[name].folder} is absent")
            continue
        results[name] = run_set(name, SETS[name], quick, pictures, sheets)
    print(
        "recall over all and of the worst view; false markers in all views and in the worst; others found (cut, holed "
        "or\nunpublished discs, not judged); distance to the truth, 2-D; time per megapixel (single thread)"
    )
    return results


def _number(value: float) -> str:
    if not np.isfinite(value):
        return "-"
    return f"{value:.0f}" if float(value).is_integer() else (f"{value:.3f}" if abs(value) < 10 else f"{value:.1f}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("sets", nargs="*", metavar="SET", help=f"one of {', '.join(SETS)}; all by default")
    parser.add_argument("--quick", action="store_true", help="only a few views of each set")
    parser.add_argument("--pictures", type=Path, metavar="DIR", help="write every view with the result drawn in")
    parser.add_argument("--sheets", type=Path, metavar="DIR", help="write one picture of all views of each set")
    options = parser.parse_args()
    unknown = sorted(set(options.sets) - set(SETS))
    if unknown:
        parser.error(f"unknown set {unknown[0]!r}; expected one of {', '.join(SETS)}")
    main(options.quick, options.pictures, options.sets, options.sheets)
