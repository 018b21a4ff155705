"""The dot wall of OpenCSP: 4094 equal dots, 7 to 14 px apart, in five views by hand, linked without labels.

Given are windmark's own spots, the camera's interior parameters, and four dots that somebody named in every view: their
poses, a few tenths of a pixel off, then the links of all others (`associate`), then one self-calibration with the
interior parameters held and the four dots as datum, then the links again with its poses. Truth is the published table.
"linked": dots that are in their track in all the views in which they were detected; "other": tracks of spots that the
table does not have (two places of the lattice).
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from windmark.calibration import Calibration, Free, self_calibrate
from windmark.detection import detect
from windmark.epipolar import Association, associate
from windmark.geometry import Camera, Pose, align
from windmark.io import read_grey
from windmark.registration import pose_from_labels
from windmark.scene import Detections, MarkerSet, View

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
CORNERS = ((-32, -31), (31, -31), (-32, 31), (31, 31))
RADIUS_PX = (1.7, 2.2, 2.9)
GATE_PX = 1.5
"""A spot so near to where the published dot is in the published pose is that dot."""
NAMED_PX = 0.15
"""1 sigma of the named dots' places and of what the camera's model leaves, for the poses' covariance."""
Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Wall:
    """The five views: spots, the dot of each (-1: none), the four named ones, the published table in mm."""

    camera: Camera
    detections: tuple[Detections, ...]
    labels: tuple[Ints, ...]
    named: tuple[Ints, ...]
    corners: Ints
    xyz: Array


def wall(folder: Path = DATA / "opencsp-dotwall-5view") -> Wall:
    """Detect, and look up the truth."""
    given = json.loads((folder / "camera.json").read_text())
    k, (k1, k2, p1, p2) = np.array(given["K"]), given["dist_k1_k2_p1_p2"]
    camera = Camera(
        tuple(given["image_size_wh"]), k[0, 0], aspect=k[1, 1] / k[0, 0], cx=k[0, 2], cy=k[1, 2],
        k1=k1, k2=k2, p1=p1, p2=p2,
    )  # fmt: skip
    table = np.loadtxt(folder / "dots_expected.csv", delimiter=",", skiprows=1)
    xyz = 1e3 * table[:, 2:]
    corners = np.array([np.flatnonzero((table[:, :2] == c).all(axis=1))[0] for c in CORNERS])
    spots, labels, named = [], [], []
    for view in json.loads((folder / "derived_view_poses.json").read_text())["views"]:
        pose = Pose.from_rotvec(np.array(view["rvec"]), 1e3 * np.array(view["tvec_m"]))
        spots.append(detect(read_grey(folder / "images" / view["image"]), radius_px=RADIUS_PX))
        place = camera.project(pose.apply(xyz))[0]
        distance, dot = cKDTree(place).query(spots[-1].xy)
        labels.append(np.where(distance < GATE_PX, dot, -1))
        named.append(cKDTree(spots[-1].xy).query(place[corners])[1])
    return Wall(camera, tuple(spots), tuple(labels), tuple(named), corners, xyz)


def first_poses(data: Wall) -> tuple[Pose, Array]:
    """Pose and covariance of every view from its four named dots."""
    fits = [
        pose_from_labels(
            spots.xy[named], data.xyz[data.corners], data.camera, cov=NAMED_PX**2 * np.tile(np.eye(2), (4, 1, 1))
        )
        for spots, named in zip(data.detections, data.named, strict=True)
    ]
    poses = [fit.cam_from_model for fit in fits]
    return (
        Pose(np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses])),
        np.stack([fit.cov for fit in fits]),
    )


def bundle(data: Wall, found: Association) -> Calibration:
    """All poses and points adjusted, the camera held."""
    names = [f"d{n}" for n in range(len(found))]
    views = [
        View(str(v), "camera", str(v), Pose(found.poses.rotation[v], found.poses.translation[v]))
        for v in range(len(data.detections))
    ]
    result = self_calibrate(
        found.observations, MarkerSet.make(names, found.xyz), {"camera": data.camera}, views, datum=Free(), free=()
    )
    if not isinstance(result, Calibration):
        raise RuntimeError(result.reason)
    return result


def counts(data: Wall, found: Association) -> dict[str, float]:
    """Links right and wrong, dots complete, and coordinates against the table."""
    label = np.array(
        [data.labels[v][s] for v, s in zip(found.tracks.view, found.tracks.detection, strict=True)], dtype=int
    )
    track, dots = found.tracks.track, len(data.xyz)
    votes = np.zeros((len(found), dots + 1), dtype=int)
    np.add.at(votes, (track, np.where(label < 0, dots, label)), 1)
    own = np.where(votes[:, :dots].any(axis=1), votes[:, :dots].argmax(axis=1), dots)
    table = own < dots
    seen = sum(np.bincount(np.unique(each[each >= 0]), minlength=dots) for each in data.labels)
    linked = np.zeros(dots, dtype=int)
    np.maximum.at(linked, own[table], votes[table, own[table]])
    return {
        "tracks": len(found), "links": len(track), "wrong": int((label != own[track])[table[track]].sum()),
        "linked_percent": 100 * float((linked[seen > 0] == seen[seen > 0]).mean()),
        "double": int(table.sum()) - len(np.unique(own[table])), "not_in_table": int((~table).sum()),
        **coordinates(data, found.xyz[table], own[table]),
    }  # fmt: skip


def coordinates(data: Wall, xyz: Array, own: Ints) -> dict[str, float]:
    """RMS difference from the table after a similarity."""
    error = align(xyz, data.xyz[own]).apply(xyz) - data.xyz[own]
    return dict(zip(("rms_x_mm", "rms_y_mm", "rms_z_mm"), np.sqrt((error**2).mean(axis=0)).tolist(), strict=True))


def main(quick: bool = False) -> dict[str, dict[str, float]]:
    """Print one table; return its rows."""
    if not DATA.is_dir():
        print("skipped: the real data are not beside the checkout (shared/data)")
        return {}
    data = wall()
    print(f"spots {[len(d) for d in data.detections]}, dots {len(data.xyz)}")
    print(
        f"{'':26s} {'tracks':>6s} {'links':>6s} {'wrong':>5s} {'linked %':>8s} {'other':>5s}   RMS x, y, z mm       s"
    )
    figures: dict[str, dict[str, float]] = {}
    poses, cov = first_poses(data)
    found: Association | None = None
    for name in ("from four named dots", "with the bundle's poses")[: 1 if quick else 2]:
        if found is not None:
            result = bundle(data, found)
            poses = Pose(
                *(np.stack([getattr(v.cam_from_model, a) for v in result.views]) for a in ("rotation", "translation"))
            )
            cov = result.pose_cov
        start = time.thread_time()
        found = associate(data.detections, data.camera, poses, pose_cov=cov)
        figures[name] = row = {**counts(data, found), "seconds": time.thread_time() - start}
        rms = ", ".join(f"{row[f'rms_{axis}_mm']:.3f}" for axis in "xyz")
        print(
            f"{name:26s} {row['tracks']:6.0f} {row['links']:6.0f} {row['wrong']:5.0f} {row['linked_percent']:8.2f} "
            f"{row['not_in_table']:5.0f}   "
            f"{rms:20s} {row['seconds']:6.1f}"
        )
    return figures


if __name__ == "__main__":
    main("--quick" in sys.argv)
