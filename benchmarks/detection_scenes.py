"""Detection on scenes with known truth, beside SimpleBlobDetector, trackpy and photutils in the same run.

2048 x 2048 px, 150 markers of radius 2.5 to 5 px, tilt up to 60 deg: clean, cluttered, and infrared 640 x 512 with 60
markers (`windmark.synth.marker_scene`). Every detector has one setting for all kinds; windmark is given three radii
and the polarity. Markers that the border cuts count neither as missed nor as false.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field

import numpy as np

from _scoring import (
    Detector,
    pair,
    photutils_detector,
    refinements,
    simple_blob,
    timed,
    trackpy_detector,
    windmark_detector,
)
from windmark.detection.template.crlb import centre_bound
from windmark.synth import Scene, marker_scene

KINDS = ("clean", "cluttered", "infrared")
RADII_PX = (2.5, 3.5, 5.0)
FIRST_SEED = 7000  # of the scenes that judge; do not tune on these
CONTAMINATED = 4  # bit of Detections.flags
COLUMNS = (
    "recall %", "worst %", "false/im", "clean im", "RMS px", "RMS/CRLB", "median", "dirty px", "flagged %",
    "wrongly %", "ms/Mpx",
)  # fmt: skip


@dataclass
class Tally:
    """What one detector did on the scenes of one kind; lists over images or over markers."""

    found: list[int] = field(default_factory=list)
    total: list[int] = field(default_factory=list)
    false: list[int] = field(default_factory=list)
    clean_error: list[float] = field(default_factory=list)
    clean_bound: list[float] = field(default_factory=list)
    dirty_error: list[float] = field(default_factory=list)
    dirty_flagged: list[bool] = field(default_factory=list)
    clean_flagged: list[bool] = field(default_factory=list)
    ms_per_mpx: list[float] = field(default_factory=list)

    def add(self, scene: Scene, bound: np.ndarray, detector: Detector, repeat: int) -> None:
        """Judge a detector on one scene; pairs are at most half a radius, or 1.5 px, apart."""
        (xy, flags), seconds = timed(lambda: detector(scene.image, scene.polarity), repeat)
        pairs = pair(xy, scene.xy, np.maximum(0.5 * scene.radius_px, 1.5))
        whole = ~scene.border
        self.found.append(int(whole[pairs.true].sum()))
        self.total.append(int(whole.sum()))
        self.false.append(len(pairs.false))
        self.ms_per_mpx.append(1e3 * seconds / (scene.image.size / 1e6))
        error = np.hypot(*(xy[pairs.found] - scene.xy[pairs.true]).T)
        dirty = scene.contaminated[pairs.true] & whole[pairs.true]
        clean = ~scene.contaminated[pairs.true] & whole[pairs.true]
        self.clean_error += error[clean].tolist()
        self.clean_bound += bound[pairs.true][clean].tolist()
        self.dirty_error += error[dirty].tolist()
        if flags is not None:
            marked = (flags[pairs.found] & CONTAMINATED) > 0
            self.dirty_flagged += marked[dirty].tolist()
            self.clean_flagged += marked[clean].tolist()

    def row(self) -> dict[str, float]:
        """The numbers of `COLUMNS`; errors are 2-D, the bound is of both axes together."""
        error, bound = np.array(self.clean_error), np.sqrt(2) * np.array(self.clean_bound)
        # The squared error over the bound squared has mean 1 and median ln 2 for a detector on the bound.
        ratio = (error / bound) ** 2
        return dict(
            zip(
                COLUMNS,
                (
                    100 * sum(self.found) / sum(self.total),
                    100 * min(f / t for f, t in zip(self.found, self.total, strict=True)),
                    float(np.mean(self.false)),
                    float(np.mean(np.array(self.false) == 0)),
                    float(np.sqrt(np.mean(error**2))),
                    float(np.sqrt(np.mean(ratio))),
                    float(np.sqrt(np.median(ratio) / np.log(2))),
                    float(np.median(self.dirty_error)) if self.dirty_error else np.nan,
                    100 * float(np.mean(self.dirty_flagged)) if self.dirty_flagged else np.nan,
                    100 * float(np.mean(self.clean_flagged)) if self.clean_flagged else np.nan,
                    float(np.median(self.ms_per_mpx)),
                ),
                strict=True,
            )
        )


def detectors(scene: Scene) -> dict[str, Detector]:
    """All that can be had; trackpy and photutils are told the number of markers."""
    count = len(scene)
    some: dict[str, Detector | None] = {
        f"windmark {name}": windmark_detector(RADII_PX, refine=name) for name in refinements()
    }
    some["SimpleBlob tuned"] = simple_blob((RADII_PX[0], RADII_PX[-1]))
    some["SimpleBlob defaults"] = simple_blob(None)
    some["trackpy (count given)"] = trackpy_detector(RADII_PX[-1], count)
    some["photutils (count given)"] = photutils_detector(RADII_PX[1], count)
    return {name: detector for name, detector in some.items() if detector is not None}


def bounds(scene: Scene) -> np.ndarray:
    """(N,) Cramer-Rao bound per axis; sensor noise and paint texture together as if they were white."""
    noise = np.hypot(scene.noise, scene.texture)
    photometry = "additive" if scene.kind == "infrared" else "multiplicative"
    slope = np.zeros((len(scene), 2)) if scene.kind == "infrared" else scene.slope
    cov = [
        centre_bound(
            scene.axes_px[k], scene.angle[k], blur_px=scene.blur_px[k], depth=scene.depth[k], noise=noise[k],
            background=scene.depth[k] / scene.contrast[k], slope=tuple(slope[k]), xy=scene.xy[k] - np.rint(scene.xy[k]),
            photometry=photometry,
        )
        for k in range(len(scene))
    ]  # fmt: skip
    return np.sqrt(0.5 * np.trace(np.array(cov), axis1=1, axis2=2))


def main(quick: bool = False) -> dict[str, object]:
    """Judge all detectors, print one table, return its numbers: kind -> detector -> column."""
    seeds = range(FIRST_SEED, FIRST_SEED + (2 if quick else 12))
    results: dict[str, object] = {"seeds": len(seeds), "radius_px": list(RADII_PX)}
    print(f"{len(seeds)} scenes of each kind, radius_px = {RADII_PX}")
    print(f"{'':26s}" + "".join(f"{name:>10s}" for name in COLUMNS))
    for kind in KINDS:
        tallies: dict[str, Tally] = {}
        for seed in seeds:
            scene = marker_scene(seed, kind)
            bound = bounds(scene)
            for name, detector in detectors(scene).items():
                if name not in tallies:
                    detector(scene.image, scene.polarity)  # compiles
                tallies.setdefault(name, Tally()).add(scene, bound, detector, 1 if quick else 2)
        print(kind)
        results[kind] = {name: tally.row() for name, tally in tallies.items()}
        for name, tally in tallies.items():
            print(f"  {name:24s}" + "".join(f"{_number(v):>10s}" for v in tally.row().values()))
    print(
        "recall over all and of the worst image; false markers per image and share of images without; RMS (2-D) and "
        "its ratio\nto the bound for clean markers, and the ratio by the median; median error of contaminated markers; "
        "contaminated\nmarkers flagged, clean ones flagged; time per megapixel (single thread, this machine now)"
    )
    return results


def _number(value: float) -> str:
    if not np.isfinite(value):
        return "-"
    return f"{value:.3f}" if abs(value) < 10 else f"{value:.1f}"


if __name__ == "__main__":
    main("--quick" in sys.argv)
