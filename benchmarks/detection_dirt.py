"""Markers with dirt on them: are they flagged, and does the stated sigma cover?

    python benchmarks/detection_dirt.py [--quick] [--seed N] [--frames N]

Frames of 80 discs (radius 3 to 8, tilted by up to 60 deg, light 180, contrast 0.7, blur 0.6), every other one with a
patch on it: round, ragged or a streak, 0.2 to 0.6 radii large, at the rim, half way in, or just beside it, dark (takes
60 % of the light), bright (dust: 1.2 times the light, whatever lies under it) or grey (half of it). Drawn by
supersampling (`FINE` sub-pixels each way, a Gaussian, sums over pixels), which shares nothing with windmark. z is
sqrt(mean chi^2 / 2) of the errors with the stated covariance; "beyond 3.7" is the share with chi^2 > 13.8, 0.1 % of
what is normal. Every dirty marker counts, flagged or not. "moved" is the RMS error over that of a fit without dirt (the
stated sigma of the clean markers of the frame).
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from _scoring import pair
from windmark.detection import detect

Array = NDArray[np.float64]

FINE = 7  # sub-pixels along a pixel's side
LIGHT, CONTRAST, BLUR = 180.0, 0.7, 0.6
RADII_PX, DEPTH_OVER_NOISE = (3.0, 4.0, 5.0, 6.0, 8.0), (10.0, 20.0, 60.0)
KINDS = ("dark", "bright", "grey")
SHAPES = ("round", "ragged", "streak")
PLACES = {"inside": (0.4, 0.75), "rim": (0.85, 1.1), "beside": (1.15, 1.5)}  # of the patch's middle, in radii
SIZES = (0.2, 0.6)  # of the patch, in radii of the disc; at least LEAST px
LEAST = 0.5
ACROSS, DOWN = 8, 10
FIRST_SEED = 730_000  # of the scenes that judge; do not tune on these
TAIL = 13.816  # chi^2 of two degrees of freedom that 0.1 % exceed


@dataclass(frozen=True)
class Patch:
    """What lies on a disc."""

    kind: str
    shape: str
    place: str
    size: float


def outline(patch: Patch, radius: float, rng: np.random.Generator) -> Array:
    """A polygon (N, 2) round its middle, px."""
    size = max(patch.size * radius, LEAST)
    if patch.shape == "round":
        t = np.linspace(0.0, 2 * np.pi, 40, endpoint=False)
        return np.asarray(size * np.stack([np.cos(t), np.sin(t)], axis=1))
    if patch.shape == "streak":
        box = np.array([[-1.6, -0.4], [1.6, -0.4], [1.6, 0.4], [-1.6, 0.4]]) * size
    else:
        t = np.sort(rng.uniform(0.0, 2 * np.pi, 9))
        box = size * rng.uniform(0.6, 1.4, 9)[:, None] * np.stack([np.cos(t), np.sin(t)], axis=1)
    turn = rng.uniform(0.0, np.pi)
    c, s = np.cos(turn), np.sin(turn)
    return np.asarray(box @ np.array([[c, s], [-s, c]]))


def inside(x: Array, y: Array, corners: Array) -> NDArray[np.bool_]:
    """Which points lie in a polygon (even-odd rule)."""
    out = np.zeros(np.broadcast(x, y).shape, dtype=bool)
    for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if ay != by:
            out ^= ((ay > y) != (by > y)) & (x < (bx - ax) * (y - ay) / (by - ay) + ax)
    return out


def tile(size: int, radius: float, patch: Patch | None, rng: np.random.Generator) -> tuple[Array, Array]:
    """One marker (size, size) and its centre from the middle pixel."""
    wide = (np.arange(size * FINE) + 0.5) / FINE - 0.5 - size // 2
    x, y = np.broadcast_arrays(wide[None, :], wide[:, None])
    centre, turn, minor = rng.uniform(-0.5, 0.5, 2), rng.uniform(0, np.pi), radius * rng.uniform(0.5, 1.0)
    c, s = np.cos(turn), np.sin(turn)
    along, across = (x - centre[0]) * c + (y - centre[1]) * s, (y - centre[1]) * c - (x - centre[0]) * s
    light = np.where((along / radius) ** 2 + (across / minor) ** 2 <= 1.0, 1.0 - CONTRAST, 1.0)
    if patch is not None:
        where, share = rng.uniform(0, 2 * np.pi), rng.uniform(*PLACES[patch.place])
        u, v = share * radius * np.cos(where), share * minor * np.sin(where)
        middle = centre + np.array([u * c - v * s, u * s + v * c])
        mask = inside(x - middle[0], y - middle[1], outline(patch, radius, rng))
        light = np.where(mask, {"dark": 0.4 * light, "bright": 1.2, "grey": 0.5}[patch.kind], light)
    seen = gaussian_filter(light, BLUR * FINE, mode="nearest", truncate=5.0)
    return LIGHT * seen.reshape(size, FINE, size, FINE).mean(axis=(1, 3)), centre


def frame(radius: float, depth_over_noise: float, rng: np.random.Generator) -> tuple[Array, Array, list[Patch | None]]:
    """Picture, centres (80, 2) and what lies on them (None: nothing)."""
    size = 2 * int(np.ceil(max(2 * radius, radius + 5 * BLUR + 1) + 3)) + 1
    picture, centres, patches = np.empty((DOWN * size, ACROSS * size)), [], []
    for k in range(ACROSS * DOWN):
        row, column = divmod(k, ACROSS)
        patch = None
        if (row + column) % 2:
            patch = Patch(str(rng.choice(KINDS)), str(rng.choice(SHAPES)), str(rng.choice(list(PLACES))),
                          float(rng.uniform(*SIZES)))  # fmt: skip
        part, centre = tile(size, radius, patch, rng)
        picture[row * size : (row + 1) * size, column * size : (column + 1) * size] = part
        centres.append(centre + np.array([column, row]) * size + size // 2)
        patches.append(patch)
    picture = np.pad(picture, 9, mode="edge")
    noisy = picture + rng.normal(0.0, LIGHT * CONTRAST / depth_over_noise, picture.shape)
    return np.clip(np.rint(noisy * 128), 0, 65535).astype(np.uint16), np.array(centres) + 9, patches


def measured(radius: float, ratio: float, frames: int, seed: int) -> list[tuple[Patch | None, float, bool, float]]:
    """Of each marker: patch, chi^2 (NaN: not found), flagged, error over the clean ones' sigma."""
    out = []
    for k in range(frames):
        rng = np.random.default_rng([seed, k, round(1000 * radius), round(10 * ratio)])
        image, xy, patches = frame(radius, ratio, rng)
        found = detect(image, radius_px=radius)
        pairs = pair(found.xy, xy, max(1.5, 0.5 * radius))
        place = np.full(len(xy), -1)
        place[pairs.true] = pairs.found
        error = found.xy[place] - xy
        chi2 = np.einsum("ki,kij,kj->k", error, np.linalg.inv(found.cov[place]), error)
        clean = [i for i, p in enumerate(patches) if p is None and place[i] >= 0]
        usual = np.sqrt(np.median(np.trace(found.cov[place[clean]], axis1=1, axis2=2)))
        for i, patch in enumerate(patches):
            seen = place[i] >= 0
            out.append((patch, float(chi2[i]) if seen else np.nan, bool(seen and found.flags[place[i]] & 4),
                        float(np.hypot(*error[i]) / usual) if seen else np.nan))  # fmt: skip
    return out


def figures(rows: list[tuple[Patch | None, float, bool, float]]) -> dict[str, float]:
    """What is printed of some markers."""
    chi2, flagged, moved = (np.array([r[k] for r in rows], dtype=float) for k in (1, 2, 3))
    seen = np.isfinite(chi2)
    if seen.sum() < 10:
        return {"n": len(rows), "lost": int((~seen).sum())}
    quiet = seen & (flagged == 0)
    return {
        "n": len(rows), "lost": int((~seen).sum()), "moved": float(np.sqrt(np.mean(moved[seen] ** 2))),
        "flagged %": 100 * float(flagged[seen].mean()), "z": float(np.sqrt(chi2[seen].mean() / 2)),
        "z unflagged": float(np.sqrt(chi2[quiet].mean() / 2)) if quiet.any() else np.nan,
        "median z": float(np.sqrt(np.median(chi2[seen]) / 1.386)),
        "beyond 3.7 %": 100 * float((chi2[seen] > TAIL).mean()),
    }  # fmt: skip


HEADS = ("n", "lost", "moved", "flagged %", "z", "z unflagged", "median z", "beyond 3.7 %")


def main(quick: bool = False, seed: int = FIRST_SEED, frames: int = 0) -> dict[str, object]:
    """Measure, print one table, return its numbers."""
    results: dict[str, Any] = {}
    rows: dict[str, list[Any]] = defaultdict(list)
    frames = frames or (1 if quick else 8)
    print(f"{'':34s}" + "".join(f"{h:>13s}" for h in HEADS))

    def show(name: str, part: list[Any]) -> None:
        results[name] = figures(part)
        print(f"{name:34s}" + "".join(f"{results[name].get(h, np.nan):13.4g}" for h in HEADS), flush=True)

    for radius in RADII_PX:
        for ratio in DEPTH_OVER_NOISE:
            every = measured(radius, ratio, frames, seed)
            dirty = [r for r in every if r[0] is not None]
            for one in dirty:
                rows[f"{one[0].place}, {one[0].kind}"].append(one)
                rows[f"{one[0].shape}"].append(one)
                rows[f"size {0.2 + 0.1 * int((one[0].size - 0.2) / 0.1):.1f} radii"].append(one)
            rows["all dirty"] += dirty
            rows["all clean"] += [r for r in every if r[0] is None]
            show(f"dirty, r {radius:g}, depth/noise {ratio:g}", dirty)
            show(f"clean, r {radius:g}, depth/noise {ratio:g}", [r for r in every if r[0] is None])
    for name in sorted(rows):
        show(name, rows[name])
    return results


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--quick", action="store_true", help="fewer frames")
    parser.add_argument("--seed", type=int, default=FIRST_SEED)
    parser.add_argument("--frames", type=int, default=0)
    given = parser.parse_args()
    main(given.quick, given.seed, given.frames)
