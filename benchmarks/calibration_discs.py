"""The eccentricity of imaged discs in self-calibration: what it does to markers and focal length, and its correction.

Discs of 20 mm diameter; scenarios of `_networks`: S2, a model before a wall, the model's normals up to 40 degrees off
its axis; "S2 near", the wall no larger than the model, all seen from half as far; "S2 smooth", 50 pictures of 150
markers on a smooth bump; S1, a nearly flat plate with a rake. The marks are the exact centroids of the imaged discs.
Bias: markers with discs less markers with points and the same noise (0.1 px), mean of the runs, as a share of the
Cramer-Rao bound (rms of all markers); the focal length's in sigma. To first order a disc of radius r at a distance d
acts as a shift of the marker by r^2 / d along its normal: no picture tells it from a real one, so a normal wrong by an
angle leaves that part of it ("r^2/d": for the median distance), and the bound grows with the distance while the shift
falls.

Correction: "off"; "table" with true normals, and with normals wrong by 5 and 10 degrees in a random direction each;
"5 deg off, ellipses": with such a table and the ellipses of the discs (half axes with 0.15 px of noise), which tell the
normals better; "auto" with neither: from the surface through the neighbouring markers. "normals": how far off.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

import _networks as nets
from windmark.calibration import Calibration, Free, self_calibrate
from windmark.calibration.normals import all_normals
from windmark.geometry import Pose, imaged_ellipse
from windmark.geometry.similarity import align

Array = NDArray[np.float64]

SEEDS = 2_713_000
RADIUS_MM = 10.0
AXES_PX = 1.5 * nets.NOISE_PX
MOST_TILT_DEG = 75.0
ROUGH_MM, FOCAL = 3.0, 1.05
WRONG_DEG = (5.0, 10.0)


def scene_with_normals(name: str, seed: int) -> tuple[nets.Scenario, Array]:
    """A scenario without marks of discs seen at grazing angles, and (N, 3) normals."""
    rng = np.random.default_rng([seed, 1])
    if name == "S2 near":
        xyz = rng.uniform(-345, 345, (150, 3)) * [1, 0.8, 0.45]
        xyz[nets.MODEL :, 2] = -180
        scene = nets.pictures(name, xyz, 50, 0.8, rng)
        normal = leaning(150, nets.MODEL, rng)
    elif name == "S2 smooth":
        xyz = rng.uniform(-345, 345, (150, 3)) * [1, 0.8, 0]
        u, v = xyz[:, 0] / 200, xyz[:, 1] / 170
        height = 220 * np.exp(-(u**2 + v**2) / 2)
        xyz[:, 2] = height
        normal = np.stack([height * u / 200, height * v / 170, np.ones(150)], axis=1)
        scene = nets.pictures(name, xyz, 50, 0.8, rng)
    else:
        scene = nets.scenario(name, seed)
        normal = leaning(len(scene.truth.points), nets.MODEL if name == "S2" else 12, rng)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    frames = scene.truth.frames
    seen = np.einsum("oij,oj->oi", frames.rotation[scene.view], scene.truth.points[scene.point])
    seen += frames.translation[scene.view]
    facing = np.einsum("oij,oj->oi", frames.rotation[scene.view], normal[scene.point])
    cosine = -(facing * seen).sum(axis=1) / np.linalg.norm(seen, axis=1)
    return scene.only(cosine > np.cos(np.radians(MOST_TILT_DEG))), normal


def leaning(count: int, some: int, rng: np.random.Generator) -> Array:
    """(N, 3) normals along z, the first ones up to 40 degrees off."""
    out = np.tile([0.0, 0.0, 1.0], (count, 1))
    lean, around = np.radians(rng.uniform(0, 40, some)), rng.uniform(0, 2 * np.pi, some)
    out[:some] = np.stack([np.sin(lean) * np.cos(around), np.sin(lean) * np.sin(around), np.cos(lean)], axis=1)
    return out


def imaged(scene: nets.Scenario, normal: Array) -> tuple[Array, Array]:
    """(O, 2) centroid of each imaged disc less the image of its centre; (O, 3) half axes and direction."""
    shift, ellipse = np.zeros_like(scene.xy), np.zeros((len(scene.xy), 3))
    frames = scene.truth.frames
    for v in range(len(frames.translation)):
        mine = scene.view == v
        pose, p = Pose(frames.rotation[v], frames.translation[v]), scene.point[mine]
        seen = imaged_ellipse(nets.CAMERA, pose.apply(scene.truth.points[p]), pose.rotate(normal[p]), RADIUS_MM)
        shift[mine], ellipse[mine] = seen.eccentricity_px, np.column_stack([seen.axes_px, seen.angle])
    return shift, ellipse


def measured(ellipse: Array, rng: np.random.Generator) -> Array:
    """Ellipses with noise: on the symmetric root of their matrix, whose eigenvalues are the half axes."""
    turn = np.stack(
        [np.cos(ellipse[:, 2]), -np.sin(ellipse[:, 2]), np.sin(ellipse[:, 2]), np.cos(ellipse[:, 2])], axis=1
    )
    axes = turn.reshape(-1, 2, 2)
    n = rng.normal(0, AXES_PX, (len(ellipse), 3)) * [1, 1, np.sqrt(0.5)]
    root = (axes * ellipse[:, None, :2]) @ axes.transpose(0, 2, 1) + n[:, [0, 2, 2, 1]].reshape(-1, 2, 2)
    value, vector = np.linalg.eigh(root)
    return np.column_stack([value[:, ::-1], np.arctan2(vector[:, 1, 1], vector[:, 0, 1])])


def turned(normal: Array, degrees: float, rng: np.random.Generator) -> Array:
    """Normals wrong by an angle, each in a direction of its own."""
    across = np.cross(normal, rng.normal(0, 1, normal.shape))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return np.cos(np.radians(degrees)) * normal + np.sin(np.radians(degrees)) * across


def solved(
    scene: nets.Scenario, xy: Array, rough: Array, normal: Array, how: str, ellipses: Array | None = None
) -> Calibration:
    """A calibration of discs."""
    observations, markers, cameras, views = scene.nouns(xy, rough, FOCAL, posed=True)
    markers = replace(markers, radius=np.full(len(rough), RADIUS_MM), normal=normal)
    result = self_calibrate(observations, markers, cameras, views, datum=Free(), eccentricity=how, ellipses=ellipses)
    assert result, result
    return result


def fitted(scene: nets.Scenario, result: Calibration) -> Array:
    """Markers fitted to the truth."""
    return align(result.markers.xyz, scene.truth.points).apply(result.markers.xyz)


def scene_rows(name: str, runs: int) -> dict[str, dict[str, float]]:
    """Figures of all corrections on one scene."""
    scene, normal = scene_with_normals(name, SEEDS)
    bound, lens = scene.bound(False)
    limit = np.sqrt(np.trace(bound, axis1=1, axis2=2).mean())
    focal_sigma = np.sqrt(lens[0, 0]) * nets.CAMERA.focal_px
    (shift, ellipse), unknown = imaged(scene, normal), np.full_like(normal, np.nan)
    towards = np.mean([p.center for p in _poses(scene)], axis=0) - scene.truth.points
    tables: dict[str, tuple[Array, str]] = {"off": (normal, "off"), "true normals": (normal, "table")}
    for degrees in WRONG_DEG:
        wrong = turned(normal, degrees, np.random.default_rng([SEEDS, round(degrees)]))
        tables[f"{degrees:.0f} deg off"] = wrong, "table"
    tables["5 deg off, ellipses"] = tables["5 deg off"][0], "auto"
    tables["auto"] = unknown, "auto"
    markers, focal = {k: [] for k in tables}, {k: [] for k in tables}
    told: list[Array] = []
    for run in range(runs):
        rng = np.random.default_rng([SEEDS, 2, run])
        noise = scene.noisy(rng) - scene.xy
        rough = scene.truth.points + rng.normal(0, ROUGH_MM, scene.truth.points.shape)
        plain = solved(scene, scene.xy + noise, rough, normal, "off")
        for key, (given, how) in tables.items():
            ellipses = measured(ellipse, rng) if key.endswith("ellipses") else None
            result = solved(scene, scene.xy + noise + shift, rough, given, how, ellipses)
            if ellipses is not None:
                told.append(result.markers.normal @ align(result.markers.xyz, scene.truth.points).rotation.T)
            markers[key].append(fitted(scene, result) - fitted(scene, plain))
            focal[key].append(result.cameras["cam"].focal_px - plain.cameras["cam"].focal_px)
    found = all_normals(scene.truth.points, unknown, towards / np.linalg.norm(towards, axis=1, keepdims=True))
    rows = {}
    for key, (given, how) in tables.items():
        used = (
            [given] if how == "table" else told if key.endswith("ellipses") else [found if how == "auto" else unknown]
        )
        cosine = (np.array(used) * normal).sum(axis=2)
        angle = np.degrees(np.arccos(np.clip(cosine[np.isfinite(cosine)], -1, 1)))
        bias = np.mean(markers[key], axis=0)
        rows[f"{name}, {key}"] = {
            "bias_mm": float(np.sqrt((bias**2).sum(axis=1).mean())), "bound_mm": float(limit),
            "share": float(np.sqrt((bias**2).sum(axis=1).mean()) / limit),
            "focal_sigma": float(np.mean(focal[key]) / focal_sigma),
            "shift_mm": RADIUS_MM**2 / float(np.median(np.linalg.norm(scene.truth.frames.translation, axis=1))),
            "normal_deg": float(np.sqrt((angle**2).mean())) if len(angle) else float("nan"),
            "px": float(np.sqrt((shift**2).sum(axis=1).mean())),
        }  # fmt: skip
    return rows


def _poses(scene: nets.Scenario) -> list[Pose]:
    frames = scene.truth.frames
    return [Pose(r, t) for r, t in zip(frames.rotation, frames.translation, strict=True)]


def main(quick: bool = False, runs: int = 10) -> dict[str, dict[str, float]]:
    """Measure, print the table, return its rows."""
    figures: dict[str, dict[str, float]] = {}
    print("scene, correction                 bias mm  r^2/d mm  bound mm   share  focal sigma  normals off, deg     px")
    for name in ("S2", "S2 near", "S2 smooth", "S1"):
        rows = scene_rows(name, 2 if quick else runs)
        figures |= rows
        for key, r in rows.items():
            print(f"{key:32s} {r['bias_mm']:8.4f} {r['shift_mm']:9.3f} {r['bound_mm']:9.4f} {100 * r['share']:6.1f}%"
                  f" {r['focal_sigma']:12.2f} {r['normal_deg']:17.2f} {r['px']:16.3f}", flush=True)  # fmt: skip
    return figures


if __name__ == "__main__":
    numbers = [int(a) for a in sys.argv[1:] if a.isdigit()]
    main("--quick" in sys.argv, *numbers)
