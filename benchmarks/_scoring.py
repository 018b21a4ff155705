"""How detectors are judged: pairs with the truth, and the peers with their settings."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from windmark.detection import detect

Array = NDArray[np.float64]
Detector = Callable[[NDArray, str], tuple[Array, Array | None]]  # image, polarity -> xy, flags


@dataclass(frozen=True)
class Pairs:
    """One-to-one pairs of found and true positions, the false ones and the missed ones (indices)."""

    found: NDArray[np.int64]
    true: NDArray[np.int64]
    false: NDArray[np.int64]
    missed: NDArray[np.int64]


def pair(found: Array, true: Array, gate_px: float | Array) -> Pairs:
    """Nearest pairs first, each at most ``gate_px`` (one, or one per true position) apart, one to one."""
    gate = np.broadcast_to(np.asarray(gate_px, dtype=float), (len(true),))
    f, t = np.zeros(0, np.int64), np.zeros(0, np.int64)
    if len(found) and len(true):
        near = cKDTree(true).query_ball_point(found, gate.max())
        f = np.repeat(np.arange(len(found)), [len(n) for n in near])
        t = np.array([j for n in near for j in n], dtype=np.int64)
        d = np.hypot(*(found[f] - true[t]).T)
        order = np.argsort(d)
        order = order[d[order] <= gate[t[order]]]
        f, t = _one_to_one(f[order], t[order])
    false = np.setdiff1d(np.arange(len(found)), f)
    return Pairs(f, t, false, np.setdiff1d(np.arange(len(true)), t))


def _one_to_one(f: NDArray[np.int64], t: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    used_f, used_t, keep = set(), set(), []
    for k, (i, j) in enumerate(zip(f.tolist(), t.tolist(), strict=True)):
        if i not in used_f and j not in used_t:
            used_f.add(i)
            used_t.add(j)
            keep.append(k)
    return f[keep], t[keep]


# --- detectors --------------------------------------------------------------------------------


def windmark_detector(radius_px: float | Sequence[float] | None, **options: object) -> Detector:
    """`windmark.detect`, everything at its defaults but the radius, the polarity and ``options``."""

    def run(image: NDArray, polarity: str) -> tuple[Array, Array | None]:
        found = detect(image, radius_px=radius_px, **{"polarity": polarity, **options})
        return found.xy, found.flags

    return run


def refinements() -> list[str]:
    """Which of the refinements this version of `detect` knows."""
    known = []
    for name in ("bowl", "template"):
        try:
            detect(np.zeros((8, 8)), radius_px=2.0, refine=name)
        except ValueError:
            continue
        known.append(name)
    return known


def eight_bits(image: NDArray) -> NDArray[np.uint8]:
    """Grey levels stretched to 0...255 (0.1 % clipped), for detectors that know only bytes."""
    if image.dtype == np.uint8:
        return image
    low, high = np.percentile(image, [0.05, 99.95])
    return np.clip((image - low) * (255.0 / max(high - low, 1e-9)) + 0.5, 0, 255).astype(np.uint8)


def simple_blob(radius_px: tuple[float, float] | None, max_tilt_deg: float = 60.0) -> Detector:
    """OpenCV's SimpleBlobDetector at its defaults (None), or tuned to a range of radii."""
    import cv2

    cv2.setNumThreads(1)

    def run(image: NDArray, polarity: str) -> tuple[Array, Array | None]:
        p = cv2.SimpleBlobDetector_Params()
        p.blobColor = 0 if polarity == "dark" else 255
        if radius_px is not None:
            low = np.pi * radius_px[0] ** 2 * np.cos(np.radians(max_tilt_deg))
            p.filterByArea, p.minArea, p.maxArea = True, 0.6 * low, 1.8 * np.pi * radius_px[1] ** 2
            p.filterByCircularity = False
            p.filterByInertia, p.minInertiaRatio = True, 0.15
            p.filterByConvexity, p.minConvexity = True, 0.8
            # Tried on seeds that do not judge: steps of 5 drown in noise, 4 repetitions lose faint markers.
            p.minThreshold, p.maxThreshold, p.thresholdStep = 5, 250, 10
            p.minDistBetweenBlobs, p.minRepeatability = 2 * radius_px[0], 3
        points = cv2.SimpleBlobDetector_create(p).detect(eight_bits(image))
        return np.array([q.pt for q in points], dtype=float).reshape(-1, 2), None

    return run


def trackpy_detector(radius_px: float, count: int) -> Detector | None:
    """Trackpy's `locate`, told how many there are, as it has no decision of its own; None if not installed."""
    try:
        import trackpy
    except ImportError:
        return None
    trackpy.quiet()

    def run(image: NDArray, polarity: str) -> tuple[Array, Array | None]:
        size = 2 * int(np.ceil(radius_px + 1)) + 1  # a mask that holds the blurred disc
        table = trackpy.locate(image, size, invert=polarity == "dark", topn=count, engine="python")
        return table[["x", "y"]].to_numpy(), None

    return run


def photutils_detector(radius_px: float, count: int) -> Detector | None:
    """Photutils' DAOStarFinder, told how many there are; None if not installed."""
    try:
        from photutils.detection import DAOStarFinder
    except ImportError:
        return None

    def run(image: NDArray, polarity: str) -> tuple[Array, Array | None]:
        sign = -1.0 if polarity == "dark" else 1.0
        values = sign * (image - np.median(image))
        table = DAOStarFinder(threshold=float(values.std()), fwhm=2 * radius_px)(values)
        if table is None:
            return np.zeros((0, 2)), None
        brightest = np.argsort(-np.asarray(table["flux"], dtype=float))[:count]
        names = ("x_centroid", "y_centroid") if "x_centroid" in table.colnames else ("xcentroid", "ycentroid")
        return np.column_stack([np.asarray(table[n], dtype=float) for n in names])[brightest], None

    return run


def timed(run: Callable[[], tuple[Array, Array | None]], repeat: int) -> tuple[tuple[Array, Array | None], float]:
    """The result and the least CPU time of ``repeat`` runs in seconds; what takes longer than a second is run once."""
    best = np.inf
    for _ in range(repeat):
        start = time.thread_time()
        result = run()
        best = min(best, time.thread_time() - start)
        if best > 1:
            break
    return result, best
