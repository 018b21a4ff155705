"""Tracking: markers found near predictions, speed and accuracy beside matchTemplate with a parabola, in one run.

A hundred ellipses of known shape (r = 3, tilts to 45 degrees) per image, predictions off by up to 2.5 px along each
axis, exact images (analytic disc, blur 0.7 px) with white noise. RMS is per axis, over the Cramer-Rao bound with shape
and blur known. Speed is of the whole call (100 markers), one thread, in CPU time: median and
best of repeated calls.

Then scenes with truth (`windmark.synth.marker_scene`, one default setting): recall, false markers at the predictions
and at random places without a marker, z-scores, contaminated markers.

    python benchmarks/tracking.py [--quick]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import windmark as wm
from windmark.detection.template.crlb import centre_bound
from windmark.detection.template.disc_model import patch_model, shape_matrix
from windmark.synth import marker_scene

Array = NDArray[np.float64]
RADIUS, BLUR, LIGHT, DEPTH, AWAY, SIDE = 3.0, 0.7, 120.0, 72.0, 2.5, 10
SEEDS = range(2000, 2010)  # not used for tuning


@dataclass(frozen=True)
class Case:
    """One kind of image: depth over noise, wrong factor of the predicted axes, light per px, share of markers there."""

    name: str
    ratio: float
    wrong: float = 1.0
    slope: float = 0.0
    there: float = 1.0


CASES = (
    Case("depth/noise 36", 36),
    Case("depth/noise 10", 10),
    Case("depth/noise 3, half of them absent", 3, there=0.5),
    Case("predicted axes 10 % too large, depth/noise 36", 36, wrong=1.1),
    Case("predicted axes 10 % too small, depth/noise 36", 36, wrong=0.9),
    Case("light 3 %/px, depth/noise 36", 36, slope=0.03),
)


@dataclass(frozen=True)
class Frame:
    """An image with its truth: centres, half axes, angles, who is there; predictions; bound of the variance."""

    image: NDArray[np.uint16]
    xy: Array
    axes: Array
    angle: Array
    there: NDArray[np.bool_]
    predicted: Array
    bound: Array


def make(case: Case, seed: int) -> Frame:
    """A frame; grey levels in steps of 1/64, so that rounding does not matter."""
    rng = np.random.default_rng(seed)
    count = SIDE * SIDE
    xy = 30.0 + 44.0 * np.stack(np.meshgrid(np.arange(SIDE), np.arange(SIDE)), -1).reshape(-1, 2)
    xy += rng.uniform(-4, 4, xy.shape)
    axes = RADIUS * np.column_stack([np.ones(count), np.cos(rng.uniform(0, np.pi / 4, count))])
    angle, there = rng.uniform(-np.pi / 2, np.pi / 2, count), rng.random(count) < case.there
    slope = case.slope * np.array([0.8, 0.6])
    depth = DEPTH if case.ratio > 5 else 12.0
    image, bound = np.full((44 * SIDE + 16, 44 * SIDE + 16), LIGHT), np.empty(count)
    for k, (x, y) in enumerate(xy):
        i, j = int(x) - 21, int(y) - 21
        cols, rows = np.arange(i, i + 43.0) - int(x), np.arange(j, j + 43.0) - int(y)
        shape = shape_matrix(axes[k], angle[k])
        params = [x - int(x), y - int(y), shape[0, 0], shape[0, 1], shape[1, 1], BLUR, depth * there[k], LIGHT, *slope]
        image[j : j + 43, i : i + 43] = patch_model(cols, rows, params)[0]
        cov = centre_bound(
            axes[k], angle[k], blur_px=BLUR, depth=depth, noise=depth / case.ratio, background=LIGHT,
            slope=tuple(slope), photometry="multiplicative", known=(2, 3, 4, 5), xy=(x - round(x), y - round(y)),
        )  # fmt: skip
        bound[k] = 0.5 * np.trace(cov)
    image += rng.normal(0, depth / case.ratio, image.shape)
    image = np.clip(np.round(64 * image), 0, 65535).astype(np.uint16)
    return Frame(image, xy, axes, angle, there, xy + rng.uniform(-AWAY, AWAY, xy.shape), bound)


Tracker = Callable[[Frame, Array], tuple[Array, NDArray[np.bool_]]]  # frame, predicted axes -> xy, found


def guided(known: object = None, **options: object) -> Tracker:
    """`windmark.detect_at`; a tracked sequence hands the frame's blur and noise on as `known`."""

    def run(frame: Frame, axes: Array) -> tuple[Array, NDArray[np.bool_]]:
        got = wm.detect_at(frame.image, frame.predicted, axes_px=axes, angle=frame.angle, frame=known, **options)
        return got.xy, got.found

    return run


def match_template() -> Tracker | None:
    """OpenCV's normalised correlation with a drawn ellipse over the same 7 x 7 places, then a parabola per axis."""
    try:
        import cv2
    except ImportError:
        return None
    cv2.setNumThreads(1)

    def run(frame: Frame, axes: Array) -> tuple[Array, NDArray[np.bool_]]:
        image, reach, steps = frame.image.astype(np.float32), 7, 3
        y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1].astype(float)
        out = np.empty_like(frame.xy)
        for k, (px, py) in enumerate(np.rint(frame.predicted).astype(int)):
            c, s = np.cos(frame.angle[k]), np.sin(frame.angle[k])
            rho = np.hypot((c * x + s * y) / axes[k, 0], (c * y - s * x) / axes[k, 1])
            template = np.clip((rho - 1.0) * RADIUS / (2.0 * BLUR) + 0.5, 0, 1).astype(np.float32)
            window = image[max(py - reach - steps, 0) : py + reach + steps + 1, max(px - reach - steps, 0) :][
                :, : 2 * (reach + steps) + 1
            ]
            score = cv2.matchTemplate(window, template, cv2.TM_CCOEFF_NORMED)
            j, i = np.unravel_index(int(score.argmax()), score.shape)
            out[k] = px - steps + i, py - steps + j
            for axis, line, at in ((0, score[j], i), (1, score[:, i], j)):
                if 0 < at < len(line) - 1:
                    bend = line[at - 1] - 2 * line[at] + line[at + 1]
                    out[k, axis] += 0.5 * (line[at - 1] - line[at + 1]) / bend if bend < 0 else 0.0
        return out, np.ones(len(out), dtype=bool)

    return run


def judge(case: Case, tracker: Tracker, repeat: int, seeds: range) -> dict[str, float]:
    """Recall, false ones (found though absent, or over 1.5 px off), RMS over the bound, bias, markers per second."""
    hits = wrong = there = absent = 0
    errors, seconds = [], []
    for seed in seeds:
        frame = make(case, seed)
        axes = case.wrong * frame.axes
        xy, found = tracker(frame, axes)
        near = found & frame.there & (np.hypot(*(xy - frame.xy).T) < 1.5)
        hits, there = hits + near.sum(), there + frame.there.sum()
        wrong, absent = wrong + (found & ~near).sum(), absent + (~frame.there).sum()
        errors.append(((xy - frame.xy) / np.sqrt(frame.bound)[:, None])[near])
        for _ in range(repeat):
            start = time.thread_time()
            tracker(frame, axes)
            seconds.append(time.thread_time() - start)
    error = np.concatenate(errors)
    return {
        "recall %": 100.0 * hits / there, "false": float(wrong), "absent": float(absent),
        "RMS/CRLB": float(np.sqrt(np.mean(error**2))), "bias/CRLB": float(np.abs(error.mean(axis=0)).max()),
        "markers/s": SIDE * SIDE / float(np.median(seconds)), "best": SIDE * SIDE / min(seconds),
    }  # fmt: skip


def scenes(kind: str, seeds: range) -> dict[str, float]:
    """Every marker of a scene looked for near its true place, and nothing looked for at random places."""
    found = wrong = total = nowhere = false = 0
    clean: list[Array] = []
    z: list[Array] = []
    dirty: list[Array] = []
    flagged: list[NDArray[np.bool_]] = []
    for seed in seeds:
        scene, rng = marker_scene(seed, kind), np.random.default_rng(seed)
        whole = ~scene.border
        got = wm.detect_at(
            scene.image, scene.xy + rng.uniform(-AWAY, AWAY, scene.xy.shape), axes_px=scene.axes_px, angle=scene.angle,
            polarity=scene.polarity,
        )  # fmt: skip
        error = got.xy - scene.xy
        near = got.found & (np.hypot(*error.T) < 1.5)
        found, total, wrong = found + (near & whole).sum(), total + whole.sum(), wrong + (got.found & ~near).sum()
        good, bad = near & whole & ~scene.contaminated, near & whole & scene.contaminated
        clean.append(error[good])
        z.append((error / np.sqrt(np.diagonal(got.cov, axis1=1, axis2=2)))[good])
        dirty.append(np.hypot(*error[bad].T))
        flagged.append((got.flags[bad] & 4) > 0)
        height, width = scene.image.shape
        places = rng.uniform([12, 12], [width - 12, height - 12], (2000, 2))
        places = places[np.hypot(*(places[:, None] - scene.xy).transpose(2, 0, 1)).min(axis=1) > 16]
        at_random = wm.detect_at(scene.image, places, radius_px=3.5, polarity=scene.polarity, frame=got.frame)
        nowhere, false = nowhere + len(places), false + at_random.found.sum()
    spoilt = np.concatenate(dirty)
    return {
        "recall %": 100.0 * found / total, "markers": float(total), "wrong": float(wrong), "false": float(false),
        "of random": float(nowhere), "RMS px": float(np.sqrt(np.mean(np.concatenate(clean) ** 2))),
        "z-std": float(np.std(np.concatenate(z))),
        "dirty px": float(np.median(spoilt)) if spoilt.size else float("nan"),
        "flagged %": 100.0 * float(np.mean(np.concatenate(flagged))) if spoilt.size else float("nan"),
    }  # fmt: skip


def main(quick: bool = False) -> dict[str, dict[str, float]]:
    """Measure all, print one table, return its numbers."""
    results: dict[str, dict[str, float]] = {}
    seeds = SEEDS[:2] if quick else SEEDS
    for case in CASES:
        first = make(case, SEEDS[0] - 1)
        known = wm.detect_at(
            first.image,
            first.predicted,
            axes_px=first.axes,
            angle=first.angle,
            blur_px=BLUR if case.ratio < 5 else None,
        ).frame
        trackers = {
            "detect_at": guided(known), "detect_at, ten unknowns": guided(known, fit_shape=True),
            "matchTemplate + parabola": match_template(),
        }  # fmt: skip
        print(f"{case.name}")
        for name, tracker in trackers.items():
            if tracker is None:
                print(f"  {name}: skipped, not installed")
                continue
            row = judge(case, tracker, 2 if quick else 10, seeds)
            results[f"{case.name}, {name}"] = row
            print(f"  {name:26s}" + "".join(f"{key} {value:<9.4g} " for key, value in row.items()), flush=True)
    for kind in ("clean", "cluttered", "infrared"):
        row = scenes(kind, SEEDS[:1] if quick else SEEDS)
        results[f"scenes, {kind}"] = row
        print(f"scenes, {kind:10s}" + "".join(f"{key} {value:<8.4g} " for key, value in row.items()), flush=True)
    return results


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--quick", action="store_true", help="two images per case")
    main(parser.parse_args().quick)
