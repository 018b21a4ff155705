"""Detection: centres and recall beside OpenCV's blob detector, in one run, on one thread (speed: `detection_speed`).

Scenes are synthetic with known truth (discs averaged over 11 x 11 sub-pixels, blurred, with noise); NASA's open test
frame is used too where it lies beside the checkout.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import windmark as wm

Array = NDArray[np.float64]
SUB = (np.arange(11) - 5) / 11.0
RADII = [2.7, 3.6, 4.6]  # for markers of 2.5 ... 5 px seen under up to 60 degrees


def main(quick: bool = False) -> dict[str, float]:
    """Measure, print one table, return its numbers (ms per megapixel, px, per cent as named)."""
    results: dict[str, float] = {}
    _centres(results, count=60 if quick else 400)
    for seed in range(1 if quick else 3):
        _clutter(results, 1000 if quick else 2048, seed)
    _nasa(results, repeat=2 if quick else 7)
    print("\ndetection                                                   value")
    for name, value in results.items():
        print(f"{name:<58} {value:8.4g}")
    return results


def best(call: Callable[[], object], repeat: int) -> float:
    """Least CPU time of some calls in ms, after one that compiles."""
    call()
    times = []
    for _ in range(repeat):
        start = time.thread_time()
        call()
        times.append(time.thread_time() - start)
    return 1e3 * min(times)


def add_disc(image: Array, disc: tuple[float, float, float, float, float], depth: float) -> None:
    """Darken the image by an ellipse x, y, major, minor, angle, pixel by pixel from 11 x 11 sub-pixels."""
    x, y, a, b, angle = disc
    rows = np.arange(max(0, int(y - a) - 1), min(image.shape[0], int(y + a) + 3))
    cols = np.arange(max(0, int(x - a) - 1), min(image.shape[1], int(x + a) + 3))
    u, v = np.meshgrid((cols[:, None] + SUB).ravel() - x, (rows[:, None] + SUB).ravel() - y)
    s, t = u * np.cos(angle) + v * np.sin(angle), v * np.cos(angle) - u * np.sin(angle)
    inside = (s / a) ** 2 + (t / b) ** 2 <= 1.0
    image[np.ix_(rows, cols)] -= depth * inside.reshape(len(rows), 11, len(cols), 11).mean(axis=(1, 3))


def blurred(image: Array) -> Array:
    """One 3 x 3 mean."""
    padded = np.pad(image, 1, mode="edge")
    h, w = image.shape
    return np.sum([padded[i : i + h, j : j + w] for i in range(3) for j in range(3)], axis=0) / 9.0


def tunnel(n: int, seed: int, clutter: bool) -> tuple[NDArray[np.uint8], Array]:
    """A painted wall with n^2 / 28,000 markers: 8-bit image, centres; with clutter also a black block."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:n, :n] / n
    image = 110 + 40 * np.sin(3 * x + 1) * np.cos(2 * y)
    if clutter:
        image[int(0.8 * n) :, int(0.7 * n) :] = 15.0
    cells = [
        (i, j) for j in range(24, n - 24, 40) for i in range(24, n - 24, 40) if not (j > 0.76 * n and i > 0.66 * n)
    ]
    cells = [cells[k] for k in rng.permutation(len(cells))]
    count = n * n // 28_000
    centres = np.array(cells[:count], dtype=float) + rng.uniform(-5, 5, (count, 2))
    if clutter:
        _add_clutter(image, rng, cells[count:])
    for cx, cy in centres:
        a = rng.uniform(2.5, 5.0)
        light = image[int(cy) - 7, int(cx) - 7]
        tilt = np.cos(rng.uniform(0, np.pi / 3))
        add_disc(image, (cx, cy, a, a * tilt, rng.uniform(0, np.pi)), light * rng.uniform(0.5, 0.85))
    noisy = blurred(image) * (1 + rng.normal(0, 0.008, (n, n))) + rng.normal(0, 1.2, (n, n))
    return np.clip(np.round(noisy), 0, 255).astype(np.uint8), centres


def _add_clutter(image: Array, rng: np.random.Generator, cells: list[tuple[int, int]]) -> None:
    """What a tunnel shows beside markers, in cells of the wall that have none."""
    n = len(image)
    kinds = ("tap", "ring", "scratch", "text", "speck")
    for k, (cx, cy) in enumerate(cells[: n * n // 14_000]):
        kind = kinds[k % len(kinds)]
        if kind == "tap":
            add_disc(image, (cx, cy, 0.8, 0.8, 0.0), 70)  # a third of the smallest marker, as on NASA's wall
        elif kind == "ring":
            add_disc(image, (cx, cy, 8.0, 8.0, 0.0), 30)
            add_disc(image, (cx, cy, 6.5, 6.5, 0.0), -30)
        elif kind == "scratch":
            add_disc(image, (cx, cy, 16.0, 0.7, rng.uniform(0, np.pi)), 40)
        elif kind == "text":
            for _ in range(4):
                i, j = rng.integers(-8, 8, 2)
                image[cy + j : cy + j + 2, cx + i : cx + i + 9] -= 45
                image[cy + j : cy + j + 9, cx + i : cx + i + 2] -= 45
    for _ in range(n * n // 8_000):
        i, j = rng.integers(2, n - 2, 2)
        image[j, i] += rng.choice([-40.0, 60.0])
    for k in range(4):
        image[int((0.15 + 0.2 * k) * n) : int((0.15 + 0.2 * k) * n) + 2] -= 20


def blob_detector(radius: tuple[float, float] | None = None) -> Callable[[NDArray[np.uint8]], Array]:
    """OpenCV's SimpleBlobDetector at defaults, or with areas for a range of radii and no limit of inertia."""
    import cv2

    cv2.setNumThreads(1)
    p = cv2.SimpleBlobDetector.Params()
    if radius is not None:
        p.minArea, p.maxArea = 0.5 * np.pi * radius[0] ** 2, 2.0 * np.pi * radius[1] ** 2
        p.minDistBetweenBlobs, p.minInertiaRatio, p.minConvexity = 3.0, 0.05, 0.8
    detector = cv2.SimpleBlobDetector.create(p)
    return lambda image: np.array([k.pt for k in detector.detect(image)]).reshape(-1, 2)


def _centres(results: dict[str, float], count: int) -> None:
    """2 RMS per coordinate on the paper's virtual markers (r0 = 3, radius +-0.5 px, one blur pass), also on a slope."""
    for noise, slope in ((0.03, 0.0), (0.1, 0.0), (0.03, 0.02)):
        rng = np.random.default_rng(1)
        ours, theirs = [], []
        for _ in range(count):
            centre, r = 20 + rng.uniform(-0.5, 0.5, 2), rng.uniform(2.5, 3.5)
            image = np.full((41, 41), 150.0)
            add_disc(image, (*centre, r, r * np.cos(rng.uniform(0, np.pi / 4)), rng.uniform(0, np.pi)), 100)
            image = blurred(image) + 100 * slope * (np.arange(41) - 20) + rng.normal(0, 100 * noise, image.shape)
            image = np.clip(np.round(image), 0, 255).astype(np.uint8)
            ours += _errors(wm.detect(image, radius_px=3.0, max_spots=1).xy, centre)
            try:
                theirs += _errors(blob_detector((2.0, 4.0))(image), centre)
            except ImportError:
                continue
        name = f"noise {100 * noise:g} %, slope {100 * slope:g} %/px"
        results[f"2 RMS, {name} [px]"] = 2 * np.sqrt(np.mean(np.square(ours)))
        results[f"  found, {name} [%]"] = 100 * len(ours) / count
        if theirs:
            results[f"  cv2.SimpleBlobDetector, {name} [px]"] = 2 * np.sqrt(np.mean(np.square(theirs)))


def _errors(xy: Array, centre: Array) -> list[Array]:
    near = [p - centre for p in xy if np.hypot(*(p - centre)) < 1.5]
    return near[:1]


def _clutter(results: dict[str, float], n: int, seed: int) -> None:
    image, truth = tunnel(n, seed, clutter=True)
    found = wm.detect(image, radius_px=RADII)
    _count(results, f"clutter {seed}, detect, three radii", found.xy, truth)
    results[f"clutter {seed}, detect, three radii [ms/Mpx]"] = (
        best(lambda: wm.detect(image, radius_px=RADII), 2) / image.size * 1e6
    )
    try:
        _count(results, f"clutter {seed},   cv2.SimpleBlobDetector", blob_detector((1.8, 5.0))(image), truth)
    except ImportError:
        return


def _count(results: dict[str, float], name: str, xy: Array, truth: Array) -> None:
    distance = np.hypot(*(xy[:, None] - truth[None]).transpose(2, 0, 1))
    true = distance.min(axis=1) < 1.5
    results[f"{name}: found of {len(truth)}"] = len(set(distance.argmin(axis=1)[true]))
    results[f"{name}: false"] = int((~true).sum())
    if not true.all() and "cv2" not in name:
        results[f"{name}: rank of the first false"] = int(np.flatnonzero(~true)[0])


def _nasa(results: dict[str, float], repeat: int) -> None:
    path = Path(__file__).parents[2] / "shared" / "data" / "nasa-upsp-cam5" / "CAM5.png"
    if not path.exists():
        return
    import imageio.v3 as iio

    image = iio.imread(path)
    results["NASA camera 5, radius 3: spots (15 dots)"] = len(wm.detect(image, radius_px=3.0))
    results["NASA camera 5, radius 3 [ms/Mpx]"] = best(lambda: wm.detect(image, radius_px=3.0), repeat) / 1.024


if __name__ == "__main__":
    main()
