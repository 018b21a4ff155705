"""Real pictures of two to four views matched without labels, and counted with the labels that are published.

MyPTV's ridge block (480 equal dots in rows, three views through a tank wall), the plate of the 4th PIV Challenge (two
cameras, seven positions) and DICe's stereo pairs of a regular grid of discs. OpenPTV's V-shaped block is seen through
walls and mirrors: no camera of ours describes its views, so there is nothing to match with.

Routes: "nothing", from the spots and the interior parameters alone (`match_pair`); "poses", with the relative pose as a
calibration gives it (`match_known_pair`); "triplets", all views with their poses, pairs joined where third views agree
(`match_known_pair`, `chain`). "In both": spots that should have a partner. Interior parameters and poses come from the
labels, the matching never sees them.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from _matching_real_cases import DATA, plate_labels, plate_table
from windmark import io
from windmark.detection import detect
from windmark.epipolar import match_known_pair, match_pair
from windmark.geometry import Camera, Pose
from windmark.registration import pose_from_labels
from windmark.scene import Detections
from windmark.tasks.reconstruct.pairwise import by_pairs

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Shot:
    """One view: spots, the label of each (-1: none), camera and pose."""

    spots: Detections
    label: Ints
    camera: Camera
    pose: Pose


@dataclass(frozen=True)
class Scene:
    """Views of one thing at one time; ``model_px`` is what its lens model leaves."""

    name: str
    shots: tuple[Shot, ...]
    near: Array
    model_px: float = 0.05


def main(quick: bool = False, only: Sequence[str] = ()) -> dict[str, dict[str, float]]:
    """Measure, print one table, return its rows; ``only`` are beginnings of the sets' names."""
    figures: dict[str, dict[str, float]] = {}
    print(f"{'':34s} {'route':9s} {'in both':>7s} {'right':>6s} {'wrong':>5s} {'open':>5s} {'pairs':>6s}  CPU s")
    if not DATA.is_dir():
        print("skipped: the real data are not beside the checkout (shared/data)")
        return {}
    for name, scenes in SETS.items():
        if only and not name.startswith(tuple(only)):
            continue
        seen = list(scenes())[: 1 if quick else None]
        for route, matched in (("nothing", _from_nothing), ("poses", _with_poses)):
            figures[f"{name}, {route}"] = _row(name, route, [
                (one, a, b, matched) for one in seen for a, b in combinations(range(len(one.shots)), 2)
            ])  # fmt: skip
        for one in seen:
            if len(one.shots) > 2:
                figures[f"{name}, triplets"] = _triplets(name, one)
    return figures


Matched = Callable[[Scene, Shot, Shot], tuple[Ints, Ints]]


def _from_nothing(scene: Scene, a: Shot, b: Shot) -> tuple[Ints, Ints]:
    pair = match_pair(a.spots, b.spots, a.camera, b.camera)
    return (pair.a, pair.b) if pair else (np.zeros(0, np.int64), np.zeros(0, np.int64))


def _with_poses(scene: Scene, a: Shot, b: Shot) -> tuple[Ints, Ints]:
    pair = match_known_pair(
        a.spots, b.spots, a.camera, b.camera, b.pose @ a.pose.inverse(), model_px=scene.model_px,
        depth_range=_depths(scene, a, b),
    )  # fmt: skip
    return pair.spot_a, pair.spot_b


def _depths(scene: Scene, a: Shot, b: Shot) -> tuple[float, float]:
    """Half the thing's size nearer and farther than it is: what a user who knows the set-up would give."""
    depth = np.concatenate([s.pose.apply(scene.near)[:, 2] for s in (a, b)])
    room = 0.5 * float(np.ptp(scene.near, axis=0).max())
    return max(float(depth.min()) - room, 0.2 * float(depth.min())), float(depth.max()) + room


def _row(name: str, route: str, cases: list[tuple[Scene, int, int, Matched]]) -> dict[str, float]:
    both = right = wrong = taken = 0
    start = time.process_time()
    for scene, i, j, matched in cases:
        a, b = scene.shots[i], scene.shots[j]
        in_a, in_b = matched(scene, a, b)
        same = a.label[in_a] == b.label[in_b]
        labelled = (a.label[in_a] >= 0) & (b.label[in_b] >= 0)
        both += len(np.intersect1d(a.label[a.label >= 0], b.label[b.label >= 0]))
        right, wrong = right + int((same & labelled).sum()), wrong + int((~same & labelled).sum())
        taken += len(in_a) > 0
    return _said(name, route, both, right, wrong, f"{taken}/{len(cases)}", time.process_time() - start)


def _triplets(name: str, scene: Scene) -> dict[str, float]:
    """All views together: links of tracks, each judged against the label that most of its track has."""
    start, shots = time.process_time(), scene.shots
    wider = [Detections.make(s.spots.xy, cov=s.spots.cov + scene.model_px**2 * np.eye(2)) for s in shots]
    found = by_pairs(wider, [s.camera for s in shots], [s.pose for s in shots], [None] * len(shots), scene.near)
    label = np.array([shots[v].label[s] for v, s in zip(found.tracks.view, found.tracks.detection, strict=True)], int)
    right = wrong = 0
    for track in range(len(found.xyz)):
        mine = label[(found.tracks.track == track) & (label >= 0)]
        most = int(np.bincount(mine).max()) if len(mine) else 0
        right, wrong = right + most, wrong + len(mine) - most
    count = np.bincount(np.concatenate([np.unique(s.label[s.label >= 0]) for s in shots]))
    return _said(name, "triplets", int(count[count >= 2].sum()), right, wrong, "-", time.process_time() - start)


def _said(name: str, route: str, both: int, right: int, wrong: int, pairs: str, seconds: float) -> dict[str, float]:
    left = both - right - wrong
    print(f"{name:34s} {route:9s} {both:7d} {right:6d} {wrong:5d} {left:5d} {pairs:>6s}  {seconds:5.1f}", flush=True)
    return {"both": both, "right": right, "wrong": wrong, "seconds": seconds}


# --- the sets ------------------------------------------------------------------------------------
def labelled(spots: Detections, true: Array, gate: float) -> Ints:
    """(M,) which of the true places each spot is, -1 for none."""
    distance, index = cKDTree(true).query(spots.xy)
    return np.where(distance < gate, index, -1)


def ridge() -> Iterator[Scene]:
    """Three views; interior parameters and poses fitted to all labels of each view."""
    folder, shots = DATA / "myptv-ridge-3cam", []
    table = np.loadtxt(folder / "target_file")[:, :3]
    for view in (1, 2, 3):
        rows = np.loadtxt(folder / f"cam{view}_cal_points")
        fit = pose_from_labels(
            rows[:, :2], rows[:, 2:], Camera((1024, 1024), 3000.0), free=("focal_px", "k1", "cx", "cy", "p1", "p2")
        )
        image = io.read_image(folder / f"cam{view}.tif")
        spots = detect(image, radius_px=(1.2, 1.5, 2.0, 2.6), polarity="bright")
        place, dot = np.full((len(table), 2), -1e6), cKDTree(table).query(rows[:, 2:])[1]
        place[dot] = rows[:, :2]
        shots.append(Shot(spots, labelled(spots, place, 3.0), fit.camera, fit.cam_from_model))
    yield Scene("MyPTV ridge", tuple(shots), table, 0.15)


def plate() -> Iterator[Scene]:
    """Two cameras fitted to the labels of all positions; the plate stands still, and moves between the scenes."""
    folder, fits = DATA / "piv-challenge-e-calib", {}
    for number in (1, 3):
        labels = [plate_labels(number, position) for position in range(1, 8)]
        raised = np.concatenate([xyz + np.array([0, 0, 0.1 * (n - 3)]) for n, (_, xyz) in enumerate(labels)])
        xy = np.concatenate([xy for xy, _ in labels])
        fits[number] = pose_from_labels(xy, raised, Camera((1024, 1024), 6000.0), free=("focal_px", "k1"))
    table = plate_table(3).xyz
    for position in range(1, 8):
        shift, shots = Pose(np.eye(3), np.array([0.0, 0.0, 0.1 * (position - 4)])), []
        for number, radius in ((1, 19.0), (3, 27.0)):
            image = io.read_image(folder / f"camera{number}" / f"E_camera_{number}_z_{position}.tif")
            spots = detect(image, radius_px=radius, polarity="bright")
            camera, pose = fits[number].camera, fits[number].cam_from_model @ shift
            shots.append(Shot(spots, labelled(spots, camera.project(pose.apply(table))[0], 6.0), camera, pose))
        yield Scene(f"PIV-E, position {position}", tuple(shots), plate_table(0).xyz, 0.5)


def grid() -> Iterator[Scene]:
    """Stereo pairs; the rig as `windmark calibrate` finds it from the same pictures, four pixels averaged to one."""
    from typer.testing import CliRunner

    from calibration_rig import COMMAND, RADIUS_PX, smaller
    from windmark.app.cli import app

    with tempfile.TemporaryDirectory() as place:
        images, out = smaller(Path(place), 4), Path(place) / "out"
        done = CliRunner().invoke(app, [
            "calibrate", *map(str, images), *COMMAND, "-r", f"{RADIUS_PX / 4:g}", "-o", str(out), "--json",
        ], catch_exceptions=False)  # fmt: skip
        if done.exit_code:
            raise SystemExit(done.output)
        table = io.read_markers(out / "markers.csv", roles=None).xyz
        for left in sorted(p for p in images if p.stem.endswith("_0")):
            shots = []
            for path in (left, left.with_name(left.name.replace("_0.png", "_1.png"))):
                camera, pose = io.read_camera(out / "views" / f"{path.stem}.json")
                assert pose is not None
                spots = detect(io.read_image(path), radius_px=RADIUS_PX / 4)
                shots.append(Shot(spots, labelled(spots, camera.project(pose.apply(table))[0], 2.0), camera, pose))
            yield Scene(f"DICe {left.stem}", tuple(shots), table)


SETS = {
    "MyPTV ridge, 3 views": ridge, "PIV-E plate, 7 pairs": plate,
    "DICe grid, 14 pairs": grid,
}  # fmt: skip


if __name__ == "__main__":
    main("--quick" in sys.argv, [a for a in sys.argv[1:] if a != "--quick"])
