"""The dot wall of OpenCSP: 4094 equal dots, 7 to 14 px apart, in five views by hand, linked without labels.

Given are windmark's own spots, the camera's interior parameters, and four dots that somebody named in every view: their
poses, a few tenths of a pixel off, then the links of all others (`associate`), then one self-calibration with the
interior parameters held and the four dots as datum, then the links again with its poses. Truth is the published table.
"linked": dots that are in their track in all the views in which they were detected; "other": tracks of spots that the
table does not have (two places of the lattice). "by reconstruct" is the verb that users have.

Then DBAT's calibration sheet, 21 views of 100 discs by hand: the focal length 5 % off, no lens, four labelled corners.
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

from _matching_real_cases import _sheet_truth
from _real_truth import photomodeler_points
from windmark.calibration import Calibration, Free, self_calibrate
from windmark.detection import detect
from windmark.epipolar import Association, associate
from windmark.geometry import Camera, Pose, align
from windmark.io import read_grey
from windmark.registration import pose_from_labels
from windmark.scene import Detections, MarkerSet, Tracks, View
from windmark.tasks.reconstruct import Reconstruction, reconstruct

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
CORNERS = ((-32, -31), (31, -31), (-32, 31), (31, 31))
RADIUS_PX = (1.7, 2.2, 2.9)
GATE_PX = 1.5
"""A spot so near to where the published dot is in the published pose is that dot."""
NAMED_PX = 0.15
"""1 sigma of the named dots' places and of what the camera's model leaves, for the poses' covariance."""
SHEET_CORNERS = ("1001", "1002", "1003", "1004")
FREE = ("focal_px", "aspect", "cx", "cy", "k1", "k2", "p1", "p2")
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


def wall(folder: Path = DATA / "opencsp-dotwall-5view", which: slice = slice(None)) -> Wall:
    """Detect in the views (or ``which`` of them), and look up the truth."""
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
    for view in json.loads((folder / "derived_view_poses.json").read_text())["views"][which]:
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


def counts(data: Wall, tracks: Tracks, xyz: Array) -> dict[str, float]:
    """Links right and wrong, dots complete, and coordinates against the table."""
    label = np.array([data.labels[v][s] for v, s in zip(tracks.view, tracks.detection, strict=True)], dtype=int)
    track, dots = tracks.track, len(data.xyz)
    votes = np.zeros((len(xyz), dots + 1), dtype=int)
    np.add.at(votes, (track, np.where(label < 0, dots, label)), 1)
    own = np.where(votes[:, :dots].any(axis=1), votes[:, :dots].argmax(axis=1), dots)
    table = own < dots
    seen = sum(np.bincount(np.unique(each[each >= 0]), minlength=dots) for each in data.labels)
    linked = np.zeros(dots, dtype=int)
    np.maximum.at(linked, own[table], votes[table, own[table]])
    return {
        "tracks": len(xyz), "links": len(track), "wrong": int((label != own[track])[table[track]].sum()),
        "linked_percent": 100 * float((linked[seen > 0] == seen[seen > 0]).mean()),
        "double": int(table.sum()) - len(np.unique(own[table])), "not_in_table": int((~table).sum()),
        **coordinates(data, xyz[table], own[table]),
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
        figures[name] = row = {
            **counts(data, found.tracks, found.xyz), "seconds": time.thread_time() - start
        }  # fmt: skip
        _said(name, row)
    figures["by reconstruct"] = by_reconstruct(data)
    figures["sheet"] = sheet()
    return figures


def by_reconstruct(data: Wall) -> dict[str, float]:
    """The wall by the verb; the four dots are known to 0.02 mm."""
    named = MarkerSet.make([f"c{k}" for k in range(4)], data.xyz[data.corners], sigma=np.full((4, 3), 0.02))
    labels = {str(v): {int(s): f"c{k}" for k, s in enumerate(spots)} for v, spots in enumerate(data.named)}
    start = time.thread_time()
    result = reconstruct(data.detections, data.camera, named, labels=labels)
    if not isinstance(result, Reconstruction):
        raise RuntimeError(result.reason)
    row = {**counts(data, result.tracks, result.markers.xyz), "seconds": time.thread_time() - start}
    _said("by reconstruct", row)
    return row


def sheet() -> dict[str, float]:
    """DBAT's sheet by the verb, against the published coordinates (mm) and focal length."""
    folder = DATA / "dbat-camcal"
    points = photomodeler_points(folder / "photomodeler_3dpts.txt")
    names, exact = [str(i) for i in sorted(points)], 1e3 * np.array([points[i] for i in sorted(points)])
    marks = np.loadtxt(folder / "markpts.txt", delimiter=",", comments="#")
    published = 7.457 / 7.25301 * 2272
    spots, truth, labels = [], [], {}
    for view, path in enumerate(sorted((folder / "images").iterdir())):
        true, _ = _sheet_truth(marks[marks[:, 0] == view + 1], names, exact, published)
        found = detect(read_grey(path, channel="green"), radius_px=(10.0, 13.0, 17.5, 23.0))
        distance, disc = cKDTree(true).query(found.xy)
        # JPEG and fringes of colour leave 0.1 px beyond the noise.
        spots.append(Detections.make(found.xy, cov=found.cov + 0.1**2 * np.eye(2)))
        truth.append(np.where(distance < 3, disc, -1))
        corners = [names.index(k) for k in SHEET_CORNERS]
        near, spot = cKDTree(found.xy).query(true[corners])
        labels[str(view)] = {int(s): k for s, k, d in zip(spot, SHEET_CORNERS, near, strict=True) if d < 5}
    known = [names.index(k) for k in SHEET_CORNERS]
    primary = MarkerSet.make(SHEET_CORNERS, exact[known], sigma=np.full((4, 3), 0.01))
    start = time.thread_time()
    result = reconstruct(spots, Camera((2272, 1704), 1.05 * published), primary, labels=labels, free=FREE)
    seconds = time.thread_time() - start
    if not isinstance(result, Reconstruction):
        raise RuntimeError(result.reason)
    track, own = result.tracks, np.empty(len(result.markers), int)
    label = np.array([truth[v][s] for v, s in zip(track.view, track.detection, strict=True)])
    for k in range(len(own)):
        own[k] = np.bincount(label[track.track == k] + 1).argmax() - 1
    error = align(result.markers.xyz, exact[own]).apply(result.markers.xyz) - exact[own]
    focal, sigma = result.cameras["camera"].focal_px, result.calibration.sigma("camera", "focal_px")
    row = {
        "views": sum(v.cam_from_model is not None for v in result.views), "points": len(np.unique(own)),
        "wrong": int((label != own[track.track]).sum()), "links": len(label), "focal_px": focal, "focal_sigma": sigma,
        "published_px": published, "seconds": seconds,
        **dict(zip(("rms_x_mm", "rms_y_mm", "rms_z_mm"), np.sqrt((error**2).mean(axis=0)).tolist(), strict=True)),
    }  # fmt: skip
    print(f"sheet: {row['views']} views, {row['points']} points, {row['wrong']} of {row['links']} links wrong, RMS "
          f"{row['rms_x_mm']:.3f}, {row['rms_y_mm']:.3f}, {row['rms_z_mm']:.3f} mm, focal length {focal:.2f} +- "
          f"{sigma:.2f} px (published {published:.2f}), {seconds:.1f} s")  # fmt: skip
    return row


def _said(name: str, row: dict[str, float]) -> None:
    rms = ", ".join(f"{row[f'rms_{axis}_mm']:.3f}" for axis in "xyz")
    print(f"{name:26s} {row['tracks']:6.0f} {row['links']:6.0f} {row['wrong']:5.0f} {row['linked_percent']:8.2f} "
          f"{row['not_in_table']:5.0f}   {rms:20s} {row['seconds']:6.1f}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main("--quick" in sys.argv)
