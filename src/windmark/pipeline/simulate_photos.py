"""Hand-held pictures of a model as files: what `reconstruct` and `epipolar` want, and beside it the truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.errors import UsageError
from windmark.geometry import Camera, Pose
from windmark.scene import MarkerSet
from windmark.synth import Sensor, TunnelTest, render, stereo_layout, wind_tunnel
from windmark.synth.stereo import TARGET

Array = NDArray[np.float64]

SIZE_PX = (1024, 768)
DISTANCE, FIELD_MM = 1250.0, 950.0
"""Of the photographer from the wing, and the width of the picture there."""
PRIMARIES = 6
CLICKED = 13
"""Markers that clicks.csv has in the first two pictures; its last row is a wrong click."""
ROUGH_MM = 2.0
"""How far the rough coordinates are off, 1 sigma along each axis."""
CLICK_PX = 1.5
"""How far a hand is off, 1 sigma."""


def simulate_photos(folder: Path, seed: int, count: int = 20) -> TunnelTest:
    """Take pictures of the virtual wing by hand and write them into ``folder`` (existing, empty or not).

    Files: photos/P01.tif and so on, camera.json (interior parameters), primary.csv (six known markers), rough.csv (all
    markers, 2 mm off), clicks.csv (markers in the first two pictures by hand, one of them wrong), and
    truth/markers.csv, truth/poses/P01.json.

    Raises
    ------
    ValueError
        For fewer than two pictures.
    """
    if count < 2:
        raise UsageError(f"photos: expected at least 2, got {count}")
    rng = np.random.default_rng([seed, 11])
    width, height = SIZE_PX
    camera = Camera(SIZE_PX, DISTANCE / FIELD_MM * width, 1.0004, width / 2 + 6, height / 2 - 5, k1=-0.08, k2=0.03,
                    p1=2e-4, p2=-1e-4)  # fmt: skip
    poses = [_station(rng, k, count) for k in range(count)]
    test = wind_tunnel(seed, stations=[(camera, poses[0])], layout=stereo_layout, clutter=None, nodes=20_000)
    world, sensor = test.shots[0].world, Sensor()
    for name in ("photos", "truth", "truth/poses"):
        (folder / name).mkdir(exist_ok=True)
    seen = []
    for k, pose in enumerate(poses):
        perfect = render(world, camera, pose)
        image = sensor.expose(perfect.image, np.random.default_rng([seed, 12, k]), np.random.default_rng([seed, 13]))
        io.write_image(folder / "photos" / f"P{k + 1:02d}.tif", image)
        io.write_camera(folder / "truth" / "poses" / f"P{k + 1:02d}.json", camera, pose, unit="mm")
        seen.append((perfect.markers.xy, perfect.markers.visible))
    io.write_camera(folder / "camera.json", camera)
    io.write_markers(folder / "truth" / "markers.csv", test.markers, length_unit="mm")
    primary = _primaries(test.markers, [v for _, v in seen])
    io.write_markers(folder / "primary.csv", primary, length_unit="mm")
    _write_clicks(folder / "clicks.csv", test.markers, seen, rng)
    off = np.random.default_rng([seed, 14]).normal(0, ROUGH_MM, test.markers.xyz.shape)
    rough = replace(test.markers, xyz=test.markers.xyz + off)
    io.write_markers(folder / "rough.csv", rough, length_unit="mm")
    return test


def _station(rng: np.random.Generator, k: int, count: int) -> Pose:
    """Along an arc over the wing, some 9 degrees from picture to picture and back, never the same height."""
    span = min(4.5 * (count - 1), 40.0)
    along = np.radians(span * (2 * k / max(count - 1, 1) - 1) + rng.normal(0, 0.5))
    across = np.radians(18 * np.sin(2.2 * k) + rng.normal(0, 1.0))
    away = DISTANCE * rng.uniform(0.96, 1.06)
    eye = np.array(TARGET) + away * np.array([np.sin(along), np.sin(across), np.cos(along) * np.cos(across)])
    return Pose.look_at(eye, np.array(TARGET) + rng.normal(0, 8, 3), [0.1 * rng.normal(), 1.0, 0.0])


def _primaries(markers: MarkerSet, visible: list[NDArray[np.bool_]]) -> MarkerSet:
    """Markers that most pictures show, far apart from each other: each the farthest from those before."""
    often = np.sum(visible, axis=0)
    known = np.flatnonzero((markers.role != "wall") & (often >= 0.8 * len(visible)))
    chosen = [int(known[np.argmin(markers.xyz[known] @ [1.0, 1.0, 0.0])])]
    while len(chosen) < PRIMARIES:
        away = np.linalg.norm(markers.xyz[known][:, None] - markers.xyz[chosen][None], axis=2).min(axis=1)
        chosen.append(int(known[np.argmax(away)]))
    some = markers.take(np.sort(chosen))
    return replace(some, role=np.full(len(some), "primary"))


def _write_clicks(
    path: Path, markers: MarkerSet, seen: list[tuple[Array, NDArray[np.bool_]]], rng: np.random.Generator
) -> None:
    """Places of some markers in the first two pictures; the last one is another marker in the second picture."""
    (xy_a, in_a), (xy_b, in_b) = seen[:2]
    both = np.flatnonzero(in_a & in_b)
    picked = both[rng.permutation(len(both))[:CLICKED]]
    if len(picked) < CLICKED:
        return
    other = next(int(m) for m in both[np.argsort(np.linalg.norm(xy_b[both] - xy_b[picked[-1]], axis=1))][3:]
                 if m not in picked)  # fmt: skip
    place_b = xy_b[[*picked[:-1], other]]
    clicks = np.concatenate([xy_a[picked], place_b]) + rng.normal(0, CLICK_PX, (2 * CLICKED, 2))
    io.write_table(path, {
        "x_a": np.round(clicks[:CLICKED, 0], 1), "y_a": np.round(clicks[:CLICKED, 1], 1),
        "x_b": np.round(clicks[CLICKED:, 0], 1), "y_b": np.round(clicks[CLICKED:, 1], 1),
    })  # fmt: skip
