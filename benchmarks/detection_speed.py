"""Speed and memory of detection beside SimpleBlobDetector in one run, on one thread.

Pictures: `windmark.synth.marker_scene` (2048 x 2048 px with 150 markers; infrared 640 x 512 with 60), 378 discs of
radius 10, and real ones where the data lie beside the checkout. The peer has tuned settings (`_scoring.simple_blob`,
one setting for all pictures but for the range of radii); its image is stretched to bytes in its time where it has more.
All take turns in each round; times are CPU times of the calling thread, medians over the rounds, and the ratio is the
median of the rounds' ratios. The coarse search is that for candidates, measured by their regions, before templates.
Left out: reading the file, the first call (compiling, at the end of the table), and what each of them finds
(`detection_scenes`, `detection_real`).

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
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from _hunt_scenes import press, stamp
from _real_truth import DATA, SETS
from _scoring import pair, simple_blob
from _sensor import Sensor
from windmark.detection import detect, merit_map, why_none
from windmark.detection.image import check_polarity, prepare
from windmark.detection.look import look_for
from windmark.synth import Scene, marker_scene

RADII_PX = (2.5, 3.5, 5.0)
FIRST_SEED = 1000  # of the scenes that judge; do not tune on these
MERIT_MAX = 0.7
BLOB = "SimpleBlobDetector, tuned"
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
    for title, image, polarity, radii in _pictures():
        results[title] = _race(title, image, polarity, radii, 2 if quick else 7)
    results["clean scenes"] = _clean_scenes(2 if quick else 12)
    results["memory"] = _memory(MEMORY[:1] if quick else MEMORY)
    results["extremes"] = _extremes()
    if not quick:
        results["first call"] = _first_call()
    return results


def _pictures() -> Iterator[tuple[str, NDArray, str, tuple[float, ...]]]:
    """Name, picture, polarity and the radii that are given."""
    for kind in ("clean", "cluttered", "infrared"):
        scene = marker_scene(FIRST_SEED, kind)
        yield kind, scene.image, scene.polarity, RADII_PX
    yield "378 discs of radius 10", discs(378, 10.0), "dark", (10.0,)
    for name in ("NASA camera 5", "MyPTV ridge", "LPT tilted", "DBAT sheet", "CSP dot wall"):
        one = SETS[name]
        if (DATA / one.folder).is_dir():
            view = next(iter(one.views(DATA / one.folder)))
            yield name, view.image, view.polarity, one.radius_px


def discs(count: int, radius: float) -> NDArray[np.uint8]:
    """So many discs tilted by up to 60 deg on even paint, depth / noise 60."""
    rng, across = np.random.default_rng(FIRST_SEED), int(np.ceil(np.sqrt(count)))
    pitch = round(4 * radius + 20)
    share = np.ones((pitch * across, pitch * across))
    for k in range(count):
        xy = (np.array(divmod(k, across)) + 0.5) * pitch + rng.uniform(-0.5, 0.5, 2)
        press(share, xy, 0.7 * (1 - stamp(radius, np.degrees(np.arccos(rng.uniform(0.5, 1))), xy, rng).draw()))
    return np.asarray(Sensor(white=2.0, bits=8).picture(180.0 * share, rng))


def _coarse(image: NDArray, polarity: str, radius_px: float) -> object:
    prepared = prepare(image, check_polarity(polarity))
    return None if prepared is None else look_for(prepared, (radius_px,), MERIT_MAX)[0]


def _runs(image: NDArray, polarity: str, radii: tuple[float, ...]) -> dict[str, Callable[[], object]]:
    """What is timed."""
    middle = radii[len(radii) // 2]
    runs: dict[str, Callable[[], object]] = {
        f"coarse search, radius {middle:g}": lambda: _coarse(image, polarity, middle),
        "detect, radius and polarity given": lambda: detect(image, radius_px=radii, polarity=polarity),
        "detect, nothing given": lambda: detect(image, polarity="auto"),
        "detect, radius given, bowl": lambda: detect(image, radius_px=radii, polarity=polarity, refine="bowl"),
    }
    try:
        blob = simple_blob((radii[0], radii[-1]))
        blob(image[:32, :32], polarity)
    except ImportError:
        print("OpenCV is not installed: no SimpleBlobDetector")
        return runs
    return runs | {BLOB: lambda: blob(image, polarity)}


def _race(title: str, image: NDArray, polarity: str, radii: tuple[float, ...], rounds: int) -> dict[str, Any]:
    """Medians of the CPU time in ms, of that per megapixel, and of the ratio to SimpleBlobDetector."""
    runs = _runs(image, polarity, radii)
    for run in runs.values():
        run()  # compiles
    times: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(rounds):
        for name, run in runs.items():
            start = time.thread_time()
            run()
            times[name].append(1e3 * (time.thread_time() - start))
    mpx = image.size / 1e6
    print(f"\n{title}, {image.shape[1]} x {image.shape[0]} {image.dtype}, radii {radii}")
    print(f"{'':40s}{'ms':>10s}{'ms/Mpx':>10s}{'/ blob':>10s}")
    table: dict[str, Any] = {}
    for name, values in times.items():
        ratio = float(np.median(np.array(values) / times[BLOB])) if BLOB in times else np.nan
        middle = float(np.median(values))
        print(f"{name:40s}{middle:10.1f}{middle / mpx:10.2f}{ratio:10.2f}", flush=True)
        table[name] = {"ms": middle, "ms/Mpx": middle / mpx, "over the blob detector": ratio}
    return table


def _clean_scenes(count: int) -> dict[str, float]:
    """Recall in per cent and false markers per image on clean scenes, of `detect` and SimpleBlobDetector."""
    tools: dict[str, Callable[[Scene], NDArray]] = {
        f"detect, three radii, {name}": lambda s, name=name: detect(s.image, radius_px=RADII_PX, refine=name).xy
        for name in ("bowl", "template")
    }
    try:
        blob = simple_blob((RADII_PX[0], RADII_PX[-1]))
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
