"""Pose from three points (P3P), and from four with unknown focal length (P4Pf), beside PoseLib and OpenCV in one run.

    python benchmarks/pose_solvers.py [--quick] [--json FILE]

Every problem has a known pose. It is *lost* when no solution has its rotation to 1e-3 (for P4Pf also the focal length),
*spurious* is a solution that misses a ray by more than 1e-6 rad or has a point behind. The rotation error is the
Frobenius norm over sqrt 2 (radians) of the best solution; the reprojection error is that solution's, in pixels of a
1000 px lens. Lost problems are left out of the errors. windmark's P3P works on the whole batch, the peers are called
from Python once per problem on a part of the same problems; the clock sees only the calls.

``ratio`` is the time over windmark's; ``f < 5 %``: how often the best focal length is that close with 0.2 px of noise.
Triangles that windmark's `p3p` calls degenerate (area below 1e-10 of the longest edge squared) are left out for all.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import _triangles as make
from windmark.geometry import DegenerateGeometry, p3p, p4pf

Array = NDArray[np.float64]
LOST = 1e-3
SPURIOUS = 1e-6
CHUNK = 100_000
CLOSE = "focal_within_5_percent_at_0.2_px"


@dataclass(frozen=True)
class Solutions:
    """Up to four poses per problem, NaN elsewhere, and the seconds per solve."""

    rotation: Array
    translation: Array
    seconds: float


def main(quick: bool = False) -> dict[str, object]:
    """Measure, print one table, return its figures."""
    n = 50_000 if quick else 1_000_000
    peers = {"poselib": (by_poselib, 5_000 if quick else 200_000), "opencv": (by_opencv, 1_000 if quick else 40_000)}
    figures: dict[str, object] = {}
    print(f"{'problem':<20}{'solver':<10}{'problems':>9}{'lost ppm':>10}{'spurious':>10}{'rotation error':^30}", end="")
    print(f"{'reprojection px':^20}{'us/solve':>10}{'ratio':>8}", end="")
    print(f"  f < 5 %\n{'':<49}{'ppm':>10}{'median':>10}{'99.9 %':>10}{'max':>10}{'99.9 %':>10}{'max':>10}")
    sets = {"random": {"random": make.random}, "near-degenerate": make.DEGENERATE, **{k: {k: f} for k, f in each()}}
    for name, kinds in sets.items():
        whole = name in ("random", "near-degenerate")
        problems = mixed(kinds, n if whole else n // 10)
        base = report(figures, f"p3p {name}", "windmark", problems, by_windmark(problems), None)
        for peer, (solve, count) in peers.items():
            part = problems.take(count if whole else count // 10)
            report(figures, f"p3p {name}", peer, part, solve(part), base)
    for name, flatness in (("space", 1.0), ("near-flat", 0.05), ("flat", 0.0)):
        four_point_rows(figures, name, flatness, 200 if quick else 5_000)
    return figures


def each() -> list[tuple[str, Callable[[np.random.Generator, int], Array]]]:
    return list(make.DEGENERATE.items())


def mixed(kinds: dict[str, Callable[[np.random.Generator, int], Array]], n: int) -> make.Problems:
    """Equal shares of the kinds, shuffled so that a part is mixed too; degenerate triangles left out."""
    rng = np.random.default_rng(1)
    share = -(-n // len(kinds))
    cam = np.concatenate([f(rng, share) for f in kinds.values()])
    all_ = make.problems(cam[rng.permutation(len(cam))[:n]], rng)
    keep = ~np.concatenate(
        [p3p(all_.rays[i : i + CHUNK], all_.xyz[i : i + CHUNK]).degenerate for i in range(0, n, CHUNK)]
    )
    return make.Problems(*(getattr(all_, f)[keep] for f in all_.__dataclass_fields__))


# --- the solvers ---------------------------------------------------------------------------------
def by_windmark(p: make.Problems) -> Solutions:
    from windmark.geometry._p3p_kernels import p3p_batch_kernel

    n = len(p.xyz)
    rotation, translation, count = np.empty((n, 4, 3, 3)), np.empty((n, 4, 3)), np.empty(n, np.int64)
    best = np.inf
    for part in [slice(i, i + 5000) for i in range(0, n, 5000)] * 2:  # the fastest part counts, as for the peers
        start = time.perf_counter()
        p3p_batch_kernel(p.rays[part], p.xyz[part], rotation[part], translation[part], count[part])
        best = min(best, (time.perf_counter() - start) / len(count[part]))
    return Solutions(rotation, translation, best)


def one_by_one(p: make.Problems, solve: Callable[[int], object], poses: Callable[[object], list]) -> Solutions:
    """Call a peer for every problem; the fastest part of a few milliseconds is its time."""
    n = len(p.xyz)
    raw, best = [], np.inf
    for part in np.array_split(np.arange(n), max(n // 500, 1)):
        start = time.perf_counter()
        raw += [solve(i) for i in part]
        best = min(best, (time.perf_counter() - start) / len(part))
    rotation, translation = np.full((n, 4, 3, 3), np.nan), np.full((n, 4, 3), np.nan)
    for i, result in enumerate(raw):
        for k, (r, t) in enumerate(poses(result)[:4]):
            rotation[i, k], translation[i, k] = r, t
    return Solutions(rotation, translation, best)


def by_poselib(p: make.Problems) -> Solutions:
    import poselib

    rays, xyz = [list(y) for y in p.rays], [list(x) for x in p.xyz]
    return one_by_one(p, lambda i: poselib.p3p(rays[i], xyz[i]), lambda out: [(q.R, q.t) for q in out])


def by_opencv(p: make.Problems) -> Solutions:
    import cv2

    front = p.rays[..., 2].min(axis=1) > 0  # OpenCV takes image points, so only rays in front of the image plane
    xy = np.where(front[:, None, None], p.rays[..., :2] / p.rays[..., 2:], 0.0)
    eye = np.eye(3)
    return one_by_one(
        p,
        lambda i: cv2.solveP3P(p.xyz[i], xy[i], eye, None, flags=cv2.SOLVEPNP_P3P),
        lambda out: [(cv2.Rodrigues(r)[0], t.ravel()) for r, t in zip(out[1], out[2], strict=True)],
    )


# --- the figures ---------------------------------------------------------------------------------
def report(
    figures: dict[str, object], problem: str, solver: str, p: make.Problems, s: Solutions, base: float | None
) -> float:
    """Print and keep one row; returns the seconds per solve."""
    rotation_error, pixels, spurious = judge(p, s)
    found = rotation_error < LOST
    row = {
        "problems": len(found),
        "lost_ppm": 1e6 * float(np.mean(~found)),
        "spurious_ppm": 1e6 * spurious / len(found),
        "rotation_median": float(np.median(rotation_error[found])),
        "rotation_q999": float(np.quantile(rotation_error[found], 0.999)),
        "rotation_max": float(rotation_error[found].max()),
        "reprojection_q999_px": float(np.quantile(pixels[found], 0.999)),
        "reprojection_max_px": float(pixels[found].max()),
        "solutions": float(np.isfinite(s.rotation[..., 0, 0]).sum() / len(found)),
        "us": 1e6 * s.seconds,
    }
    if base is not None:
        row["ratio"] = s.seconds / base
    show(problem, solver, row)
    figures[f"{problem} {solver}"] = row
    return s.seconds


def show(problem: str, solver: str, row: dict[str, float]) -> None:
    """One line of the table; blank where a figure does not apply."""
    names = ("rotation_median", "rotation_q999", "rotation_max", "reprojection_q999_px", "reprojection_max_px")
    errors = "".join(f"{row[k]:>10.1e}" if k in row else f"{'':>10}" for k in names)
    spurious = f"{row['spurious_ppm']:>10.0f}" if "spurious_ppm" in row else f"{'':>10}"
    close = f"{row[CLOSE]:>8.0%}" if CLOSE in row else ""
    start = f"{problem:<20}{solver:<10}{int(row['problems']):>9}{row['lost_ppm']:>10.0f}{spurious}"
    print(f"{start}{errors}{row['us']:>10.3g}{row.get('ratio', 1.0):>8.3g}{close}", flush=True)


def judge(p: make.Problems, s: Solutions) -> tuple[Array, Array, int]:
    """Rotation error and reprojection error of the solution nearest to the truth, and the number of spurious ones."""
    n = len(p.xyz)
    error, pixels, spurious = np.empty(n), np.empty(n), 0
    for i in range(0, n, CHUNK):
        part = slice(i, min(i + CHUNK, n))
        given = np.isfinite(s.rotation[part]).all(axis=(-1, -2))
        off = np.linalg.norm(s.rotation[part] - p.rotation[part, None], axis=(-1, -2)) / np.sqrt(2)
        off = np.where(given, off, np.inf)
        best = off.argmin(axis=1)
        error[part] = off.min(axis=1)
        angle = ray_angle(p, s, part)
        pixels[part] = 1000 * np.take_along_axis(angle, best[:, None], axis=1)[:, 0]
        spurious += int((given & ~(angle < SPURIOUS)).sum())
    return error, pixels, spurious


def ray_angle(p: make.Problems, s: Solutions, part: slice) -> Array:
    """Largest angle between a ray and its point for each solution; pi when a point is behind."""
    cam = p.xyz[part, None] @ np.swapaxes(s.rotation[part], -1, -2) + s.translation[part, :, None]
    rays = p.rays[part, None]
    with np.errstate(invalid="ignore", divide="ignore"):
        angle = np.linalg.norm(np.cross(cam, rays), axis=-1) / np.linalg.norm(cam, axis=-1)
        return np.where(np.sum(cam * rays, axis=-1) > 0, angle, np.pi).max(axis=-1)


def four_point_rows(figures: dict[str, object], name: str, flatness: float, n: int) -> None:
    """P4Pf on exact images, and how often 0.2 px of noise leaves the best focal length within 5 %."""
    rng = np.random.default_rng(2)
    cases = [make.four_points(rng, flatness) for _ in range(n)]
    base = 0.0
    for solver, solve in (("windmark", p4pf_windmark), ("poselib", p4pf_poselib)):
        solve(cases[0][3], cases[0][2])
        error, seconds, close = np.full(n, np.inf), np.empty(n), 0
        noise = np.random.default_rng(3)
        for i, (focal, pose, xyz, xy) in enumerate(cases):
            start = time.perf_counter()
            found = solve(xy, xyz)
            seconds[i] = time.perf_counter() - start
            for f, r in found:
                error[i] = min(error[i], max(abs(f / focal - 1), np.linalg.norm(r - pose.rotation) / np.sqrt(2)))
            noisy = solve(xy + 0.2 * noise.normal(size=(4, 2)), xyz)
            close += bool(noisy) and abs(noisy[0][0] / focal - 1) < 0.05
        ok = error < LOST
        row = {
            "problems": n,
            "lost_ppm": 1e6 * float(np.mean(~ok)),
            CLOSE: close / n,
            "us": 1e6 * float(np.median(seconds)),
        }
        if ok.any():
            row |= {
                "rotation_median": float(np.median(error[ok])),
                "rotation_q999": float(np.quantile(error[ok], 0.999)),
                "rotation_max": float(error[ok].max()),
            }
        base = base or row["us"]
        if solver != "windmark":
            row["ratio"] = row["us"] / base
        show(f"p4pf {name}", solver, row)
        figures[f"p4pf {name} {solver}"] = row


def p4pf_windmark(xy: Array, xyz: Array) -> list[tuple[float, Array]]:
    try:
        return [(s.focal_px, s.pose.rotation) for s in p4pf(xy, xyz)]
    except DegenerateGeometry:
        return []


def p4pf_poselib(xy: Array, xyz: Array) -> list[tuple[float, Array]]:
    import poselib

    poses, focals = poselib.p4pf(list(xy), list(xyz), True)
    return [(f, p.R) for f, p in zip(focals, poses, strict=True)]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="50,000 triangles instead of a million")
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    options = parser.parse_args()
    result = main(options.quick)
    if options.json:
        from windmark.io import write_json

        write_json(options.json, result)
