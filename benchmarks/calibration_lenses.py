"""`windmark calibrate` on rendered pictures of a dot board through lenses of 90, 120 and 160 degrees.

No start, no lens model and no tolerance are given: what is known is the pitch of the board and which three dots are
large. The dots are off their grid by 0.3 % of the pitch, so they are measured. The board is shown to all parts of the
picture, corners too, turned and tilted. Truth: an equidistant lens with coefficients (`cv2.fisheye`'s), and for 90
degrees also a rational one and Brown's, which must be recognised.

Printed: pictures used, marks, the lens model that was chosen and its lead, sigma0, the markers' errors by their sigmas
(RMS of e / sigma, all coordinates, after a fit of shift, turn and scale), and how far the lens found is from the true
one over the marks' places (after the best turn of the camera: what its coordinates' directions are is free).
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from typer.testing import CliRunner

from windmark import io
from windmark.app.cli import app
from windmark.geometry import Camera, Pose
from windmark.geometry.similarity import align

Array = NDArray[np.float64]

SIZE = (1400, 1050)
COLUMNS, ROWS, PITCH, RADIUS, LARGE = 13, 10, 20.0, 4.4, 1.5
MARKS = ((4, 3), (9, 3), (4, 6))
PRINTED, PICTURES, SUB = 0.06, 20, 5
BLUR_PX, NOISE, PAPER, INK = 0.7, 2.0, 210.0, 40.0
LENSES = {
    "90 brown": (90.0, Camera(SIZE, 880.0, 1.0, 706.0, 518.0, k1=-0.09, k2=0.02)),
    "90 rational": (90.0, Camera(SIZE, 880.0, 1.0, 706.0, 518.0, 0.62, 0.09, k3=2e-3, k4=0.95, k5=0.25, k6=0.012,
                                 lens="rational")),
    "90 fisheye": (90.0, Camera(SIZE, 880.0, 1.0, 706.0, 518.0, k1=-0.02, k2=4e-3, lens="fisheye")),
    "120 fisheye": (120.0, Camera(SIZE, 665.0, 1.0, 694.0, 531.0, k1=-0.015, k2=3e-3, k3=-1e-3, lens="fisheye")),
    "160 fisheye": (160.0, Camera(SIZE, 505.0, 1.0, 702.0, 520.0, k1=-0.012, k2=2e-3, k3=-5e-4, k4=4e-5,
                                  lens="fisheye")),
}  # fmt: skip


def cells() -> NDArray[np.int64]:
    """(N, 2) column and row of all dots."""
    column, row = np.meshgrid(np.arange(COLUMNS), np.arange(ROWS))
    return np.stack([column.ravel(), row.ravel()], axis=1)


def stations(rng: np.random.Generator, camera: Camera, across_deg: float) -> list[Pose]:
    """``cam_from_board``: the board in all parts of the picture, facing the camera within some 40 degrees."""
    middle = Pose.from_rotvec(np.zeros(3), [-PITCH * (COLUMNS - 1) / 2, -PITCH * (ROWS - 1) / 2, 0])
    out = []
    for k in range(PICTURES):
        roll = Pose.from_rotvec([0, 0, rng.uniform(-np.pi, np.pi)], np.zeros(3))
        around = rng.uniform(0, 2 * np.pi)
        lean = Pose.from_rotvec(np.radians(rng.uniform(10, 40)) * np.array([np.cos(around), np.sin(around), 0]),
                                np.zeros(3))  # fmt: skip
        away = Pose.from_rotvec(np.zeros(3), [0, 0, rng.uniform(190, 260)])
        # Every third picture from the middle, the others towards a point on the border or in a corner.
        place = np.array([0.5, 0.5]) if k % 3 == 0 else rng.uniform(0.08, 0.92, 2)
        aim = camera.directions(place * np.array(SIZE))
        axis = np.cross([0, 0, 1.0], aim)
        size = np.linalg.norm(axis)
        turn = np.arctan2(size, aim[2]) * axis / size if size > 1e-9 else np.zeros(3)
        out.append(Pose.from_rotvec(turn, np.zeros(3)) @ away @ lean @ roll @ middle)
    return out


def picture(rng: np.random.Generator, camera: Camera, pose: Pose, xyz: Array, radius: Array) -> NDArray[np.uint8]:
    """A picture of dots on a plane: every pixel's part in them by SUB x SUB exact rays."""
    share = np.zeros(SIZE[::-1])
    turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    inverse = pose.inverse()
    eye = inverse.translation
    step = (np.arange(SUB) + 0.5) / SUB - 0.5
    for at, r in zip(xyz, radius, strict=True):
        rim = at + r * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
        xy, valid = camera.project(pose.apply(rim))
        if not valid.all():
            continue
        low = np.maximum(np.floor(xy.min(axis=0)) - 1, 0).astype(int)
        high = np.minimum(np.ceil(xy.max(axis=0)) + 1, np.array(SIZE) - 1).astype(int)
        if (high < low).any():
            continue
        x = (np.arange(low[0], high[0] + 1)[:, None] + step).ravel()
        y = (np.arange(low[1], high[1] + 1)[:, None] + step).ravel()
        ray = camera.directions(np.stack(np.meshgrid(x, y), axis=-1)) @ inverse.rotation.T
        with np.errstate(divide="ignore", invalid="ignore"):
            along = (at[2] - eye[2]) / ray[..., 2]
            hit = eye[:2] + along[..., None] * ray[..., :2]
        inside = (along > 0) & (((hit - at[:2]) ** 2).sum(axis=-1) < r * r)
        tall, wide = high[1] - low[1] + 1, high[0] - low[0] + 1
        share[low[1] : high[1] + 1, low[0] : high[0] + 1] += inside.reshape(tall, SUB, wide, SUB).mean(axis=(1, 3))
    clean = PAPER + (INK - PAPER) * gaussian_filter(np.minimum(share, 1.0), BLUR_PX)
    return np.clip(np.rint(clean + rng.normal(0, NOISE, clean.shape)), 0, 255).astype(np.uint8)


def lens_error_px(found: Camera, true: Camera, xy: Array) -> float:
    """RMS distance over the marks' places of the lens found from the true one, after the best turn of the camera."""
    a, b = true.directions(xy), found.directions(xy)
    known = np.isfinite(a + b).all(axis=1)
    u, _, vt = np.linalg.svd(b[known].T @ a[known])
    turned = a[known] @ (u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt).T
    off = found.project(turned)[0] - xy[known]
    return float(np.sqrt(np.nanmean((off**2).sum(axis=1))))


def measure(name: str, seed: int, work: Path) -> dict[str, object]:
    """Render, calibrate, compare."""
    across, camera = LENSES[name]
    rng = np.random.default_rng(seed)
    index = cells()
    xyz = np.column_stack([index * PITCH, np.zeros(len(index))])
    xyz[:, :2] += rng.normal(0, PRINTED, (len(index), 2))
    large = np.array([tuple(c) in MARKS for c in index.tolist()])
    radius = np.where(large, LARGE, 1.0) * RADIUS
    for k, pose in enumerate(stations(rng, camera, across)):
        io.write_image(work / f"p{k:02d}.png", picture(rng, camera, pose, xyz, radius))
    begin = time.process_time()
    done = CliRunner().invoke(app, [
        "calibrate", *map(str, sorted(work.glob("*.png"))), "--unit", "mm", "--board", str(PITCH),
        "--board-size", f"{COLUMNS}x{ROWS}", "--board-marks", "large" + "".join(f":{c},{r}" for c, r in MARKS),
        "-o", str(work / "out"),
    ], catch_exceptions=False)  # fmt: skip
    seconds = time.process_time() - begin
    print(f"--- {name}, seed {seed}\n{done.output}")
    if done.exit_code:
        return {"lens": name, "seed": seed, "calibrated": False, "seconds": seconds}
    found, got = io.read_markers(work / "out" / "markers.csv"), io.read_camera(work / "out" / "camera.json")[0]
    table = io.read_matches(work / "out" / "matches.csv")
    place = {f"c{c:02d}r{r:02d}": p for (c, r), p in zip(index.tolist(), xyz, strict=True)}
    known = np.array([place[n] for n in found.name.tolist()])
    off = align(found.xyz, known, scale=True).apply(found.xyz) - known
    z = off / found.sigma
    summary = json.loads((work / "out" / "summary.json").read_text())
    return {
        "lens": name, "seed": seed, "calibrated": True, "chosen": got.lens, "right": got.lens == camera.lens,
        "pictures": summary["views"], "marks": summary["marks"], "sigma0": summary["sigma0"],
        "z": float(np.sqrt((z**2).mean())), "z_xyz": np.sqrt((z**2).mean(axis=0)).tolist(),
        "rms_mm": np.sqrt((off**2).mean(axis=0)).tolist(), "lens_px": lens_error_px(got, camera, table.xy),
        "seconds": seconds,
    }  # fmt: skip


def main(seeds: list[int], names: list[str]) -> list[dict[str, object]]:
    """Measure, print a table, return the figures."""
    rows = []
    for name in names:
        for seed in seeds:
            with tempfile.TemporaryDirectory() as place:
                rows.append(measure(name, seed, Path(place)))
    print(f"{'lens':12} {'seed':>5} {'chosen':>9} {'pictures':>8} {'marks':>6} {'sigma0':>7} {'z':>6} "
          f"{'z along x, y, z':>18} {'lens px':>8} {'CPU s':>6}")  # fmt: skip
    for r in rows:
        if not r["calibrated"]:
            print(f"{r['lens']:12} {r['seed']:5} not calibrated")
            continue
        by = " ".join(f"{v:5.2f}" for v in r["z_xyz"])  # type: ignore[attr-defined]
        print(f"{r['lens']:12} {r['seed']:5} {r['chosen']:>9} {r['pictures']:8} {r['marks']:6} {r['sigma0']:7.3f} "
              f"{r['z']:6.2f} {by:>18} {r['lens_px']:8.3f} {r['seconds']:6.1f}")  # fmt: skip
    return rows


if __name__ == "__main__":
    chosen = [a for a in sys.argv[1:] if not a.isdigit()]
    found_names = [n for n in LENSES if not chosen or n in chosen or n.split()[0] in chosen]
    main([int(a) for a in sys.argv[1:] if a.isdigit()] or [1], found_names)
