"""Speed and memory of detection beside SimpleBlobDetector, trackpy and photutils, in one run, on one thread.

Scenes are `windmark.synth.marker_scene`, 2048 x 2048 px with 150 markers (infrared 640 x 512 with 60), and NASA's open
test frame where it lies beside the checkout. All tools take turns in each round; times are CPU times per megapixel,
medians over the rounds. The coarse search is all that happens before shapes are measured and markers decided on:
grey levels and dead pixels, noise, depth filter, SPOT's merit and bowl at the candidates.

Memory is the high-water mark of a fresh process above what it held before the call, over the image's bytes (Linux).
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy is loaded

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from _scoring import pair, photutils_detector, simple_blob, trackpy_detector
from windmark.detection import detect, merit_map, why_none
from windmark.detection.image import check_polarity, prepare
from windmark.detection.spots import find_spots
from windmark.synth import Scene, marker_scene

RADII_PX = (2.5, 3.5, 5.0)
FIRST_SEED = 1000  # of the scenes that judge; do not tune on these
MERIT_MAX = 0.7
BLOB = "SimpleBlobDetector, defaults"
NASA = Path(__file__).parents[2] / "shared" / "data" / "nasa-upsp-cam5" / "CAM5.png"
MEMORY = (  # type of the pixels, side of the image, what is done, dead pixels and a masked corner or none
    ("uint8", 4500, "one radius", False),
    ("uint8", 4500, "bowl", False),
    ("uint8", 4500, "template", False),
    ("uint8", 4500, "template", True),
    ("uint8", 4500, "merit map", True),
    ("uint8", 4500, "no radius", False),
    ("uint16", 4500, "template", True),
    ("uint16", 10000, "bowl", False),
    ("uint16", 10000, "template", True),
)


def main(quick: bool = False) -> dict[str, object]:
    """Measure, print, return the numbers."""
    results: dict[str, object] = {}
    for kind in ("clean", "cluttered", "infrared"):
        scene = marker_scene(FIRST_SEED, kind)
        results[kind] = _race(kind, scene.image, scene.polarity, len(scene), 2 if quick else 7)
    if NASA.exists():
        import imageio.v3 as iio

        results["NASA camera 5"] = _race("NASA camera 5", iio.imread(NASA), "dark", 15, 2 if quick else 7)
    results["clean scenes"] = _clean_scenes(2 if quick else 12)
    results["memory"] = _memory(MEMORY[:1] if quick else MEMORY)
    results["extremes"] = _extremes()
    if not quick:
        results["first call"] = _first_call()
    return results


def _coarse(image: NDArray, polarity: str, radius_px: float) -> object:
    prepared = prepare(image, check_polarity(polarity))
    return None if prepared is None else find_spots(prepared, radius_px, MERIT_MAX)


def _runs(image: NDArray, polarity: str, count: int) -> dict[str, Callable[[], object]]:
    """What is timed. Trackpy and photutils have no decision of their own: they are told how many markers there are."""
    runs: dict[str, Callable[[], object]] = {
        f"coarse search, radius {r:g}": lambda r=r: _coarse(image, polarity, r) for r in (3.0, 5.0)
    }
    for r in (3.0, 5.0):
        runs[f"merit map, radius {r:g}"] = lambda r=r: merit_map(image, r, polarity)
    runs["detect, radius 3, bowl"] = lambda: detect(image, radius_px=3.0, polarity=polarity, refine="bowl")
    for name in ("bowl", "template"):
        runs[f"detect, three radii, {name}"] = lambda name=name: detect(
            image, radius_px=RADII_PX, polarity=polarity, refine=name
        )
    peers = {"trackpy": trackpy_detector(RADII_PX[-1], count), "photutils": photutils_detector(RADII_PX[1], count)}
    try:
        peers[BLOB], peers["SimpleBlobDetector, tuned"] = simple_blob(None), simple_blob((RADII_PX[0], RADII_PX[-1]))
    except ImportError:
        print("OpenCV is not installed: no SimpleBlobDetector")
    for name, peer in peers.items():
        if peer is None:
            print(f"{name} is not installed")
        else:
            runs[name] = lambda peer=peer: peer(image, polarity)
    return runs


def _race(title: str, image: NDArray, polarity: str, count: int, rounds: int) -> dict[str, float]:
    """Median CPU time in ms per megapixel; printed with the ratio to SimpleBlobDetector, the median over the rounds."""
    runs = _runs(image, polarity, count)
    for run in runs.values():
        run()  # compiles
    times: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(rounds):
        for name, run in runs.items():
            start = time.process_time()
            run()
            times[name].append(1e3 * (time.process_time() - start) / (image.size / 1e6))
    print(
        f"\n{title}, {image.shape[1]} x {image.shape[0]} {image.dtype}{'ms/Mpx':>20s}{'/ ' + BLOB.split(',')[0]:>22s}"
    )
    for name, values in times.items():
        ratio = f"{np.median(np.array(values) / times[BLOB]):22.2f}" if BLOB in times else ""
        print(f"{name:40s}{np.median(values):12.2f}{ratio}")
    return {name: float(np.median(values)) for name, values in times.items()}


def _clean_scenes(count: int) -> dict[str, float]:
    """Recall in per cent and false markers per image on clean scenes, of `detect` and SimpleBlobDetector."""
    tools: dict[str, Callable[[Scene], NDArray]] = {
        f"detect, three radii, {name}": lambda s, name=name: detect(s.image, radius_px=RADII_PX, refine=name).xy
        for name in ("bowl", "template")
    }
    try:
        blob = simple_blob(None)
        tools[BLOB] = lambda s: blob(s.image, s.polarity)[0]
    except ImportError:
        pass
    found, total = {name: np.zeros(2) for name in tools}, 0
    for seed in range(FIRST_SEED, FIRST_SEED + count):
        scene = marker_scene(seed, "clean")
        whole = ~scene.border
        total += whole.sum()
        for name, tool in tools.items():
            pairs = pair(tool(scene), scene.xy, np.maximum(0.5 * scene.radius_px, 1.5))
            found[name] += whole[pairs.true].sum(), len(pairs.false)
    print(f"\n{count} clean scenes, {total} markers{'found %':>20s}{'false per image':>18s}")
    results = {}
    for name, (right, false) in found.items():
        print(f"{name:40s}{100 * right / total:12.2f}{false / count:12.2f}")
        results[f"{name}: found %"], results[f"{name}: false"] = 100 * right / total, false / count
    return results


# --- memory -----------------------------------------------------------------------------------


def _memory(cases: tuple[tuple[str, int, str, bool], ...]) -> dict[str, Any]:
    """Peak memory over the image's bytes, one fresh process for each case."""
    if not Path("/proc/self/clear_refs").exists():
        print("\nmemory is measured on Linux only")
        return {}
    print(f"\n{'memory':48s}{'Mpx':>6s}{'extra / image':>15s}{'found':>8s}{'ms/Mpx':>9s}")
    results = {}
    for case in cases:
        call = [sys.executable, __file__, *map(str, case)]
        row = json.loads(subprocess.run(call, check=True, capture_output=True, text=True).stdout)
        name = f"{case[0]}, {case[2]}{', dead pixels' if case[3] else ''}"
        print(f"{name:48s}{case[1] ** 2 / 1e6:6.0f}{row['extra']:15.2f}{row['found']:8d}{row['ms_per_mpx']:9.1f}")
        results[f"{name}, {case[1]} px"] = row
    return results


def _one_case(dtype: str, side: str, what: str, dead: str) -> None:
    """Run one of `MEMORY` in this process and print what it took as JSON."""
    tile = marker_scene(FIRST_SEED, "clean").image.astype(dtype) * (1 if dtype == "uint8" else 16)
    n = int(side)
    image = np.empty((n, n), dtype)
    for y in range(0, n, len(tile)):
        for x in range(0, n, len(tile)):
            image[y : y + len(tile), x : x + len(tile)] = tile[: n - y, : n - x]
    if dead == "True":
        image[100::97, 50::89] = np.iinfo(dtype).max
    work: dict[str, Callable[[NDArray], Any]] = {
        "merit map": lambda a: merit_map(a, 3.0),
        "no radius": lambda a: detect(a),
        "one radius": lambda a: detect(a, radius_px=3.0),
    }
    run = work.get(what, lambda a: detect(a, radius_px=RADII_PX, refine=what))
    run(image[:1000, :1000])
    run(image[:900, :1000].copy())  # compiled and warm
    Path("/proc/self/clear_refs").write_text("5")  # the high-water mark starts again here
    before, start = _status_bytes("VmRSS"), time.process_time()
    found = run(image)
    seconds, peak = time.process_time() - start, _status_bytes("VmHWM")
    row = {"extra": (peak - before) / image.nbytes, "found": len(found), "ms_per_mpx": 1e9 * seconds / image.size}
    print(json.dumps(row))


def _status_bytes(key: str) -> int:
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith(key))


# --- the ends ---------------------------------------------------------------------------------


def _extremes() -> dict[str, str]:
    """Small images, images with missing pixels and images without markers: what is found or said."""
    scene = marker_scene(FIRST_SEED, "clean")
    x, y = np.rint(scene.xy[np.argmin(np.abs(scene.xy - 1024).max(axis=1))]).astype(int)
    small = scene.image[y - 32 : y + 32, x - 32 : x + 32]
    holes = small.astype(float)
    holes[:, 45:] = np.nan
    noise = np.random.default_rng(0).normal(100, 5, (64, 64))
    images = {
        "64 x 64 px": small, "64 x 64 px, a third NaN": holes, "64 x 64 px of noise": noise,
        "64 x 64 px, all NaN": np.full((64, 64), np.nan), "64 x 64 px, all alike": np.full((64, 64), 7, np.uint8),
        "5 x 5 px": small[:5, :5],
    }  # fmt: skip
    print()
    results = {}
    for name, image in images.items():
        found = detect(image, radius_px=RADII_PX)
        results[name] = f"{len(found)} found" if len(found) else f"none: {why_none(image, radius_px=RADII_PX)}"
        print(f"{name:40s}{results[name]}")
    return results


def _first_call() -> dict[str, float]:
    """Seconds of the first `detect` of all, which compiles, and of importing windmark; each in a fresh process."""
    prelude = "import os, time, numpy as np; t = time.perf_counter(); import windmark as wm; "
    texts = {
        "import windmark": prelude,
        "detect, bowl, nothing compiled": prelude + "wm.detect(np.eye(99), radius_px=3.0, refine='bowl'); ",
        "detect, bowl, compiled before": prelude + "wm.detect(np.eye(99), radius_px=3.0, refine='bowl'); ",
    }
    results = {}
    with tempfile.TemporaryDirectory() as cache:
        for name, text in texts.items():
            call = [sys.executable, "-c", text + "print(time.perf_counter() - t)"]
            env = {**os.environ, "NUMBA_CACHE_DIR": cache}
            done = subprocess.run(call, check=True, capture_output=True, text=True, env=env)
            results[name] = float(done.stdout)
            print(f"{name:40s}{results[name]:8.2f} s")
    return results


if __name__ == "__main__":
    if len(sys.argv) == 5:
        _one_case(*sys.argv[1:])
    else:
        main("--quick" in sys.argv)
