"""Which centres are better on a real sheet: bundle adjustments of each kind of centre on the same marks.

The DBAT calibration sheet (21 views, 100 discs, 2074 published marks) tells how far a detector is from the published
marks, but not which of them is wrong. A bundle adjustment does: camera (nine parameters), poses and discs are free
(inner constraints), all marks have the same weight; sigma0 is the error of a centre per axis that no camera, pose or
disc explains. The consumer camera with its zoom is not quite the same in every view: `own` is sigma0 if each view has
its own focal length and principal point, which leaves less that is not the centres' fault. All kinds are judged on the
marks that all of them have; the difference between the image of a disc's centre and the centre of its image is left
out for all (0.04 px RMS per axis here; camera and poses take it up, sigma0 is the same to 0.0003 px with it).

The views are colour JPEGs. `grey` is the weighted sum of the colours that `read_grey` gives, `green` one channel of
the same file: this lens images red and blue larger than green (lateral chromatic aberration).

    python benchmarks/centres_real.py [--quick]
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from _real_truth import DATA, SETS, photomodeler_points
from _reference import soft_centroid
from _scoring import pair
from windmark.detection import detect
from windmark.detection.template.refine import refine_template
from windmark.io import read_grey

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

CHANNELS = ("grey", "green")
SIZE = (2272, 1704)
FOCAL_PX = 7.457 / 7.25301 * SIZE[0]  # published: focal length and width of the sensor in mm
CAMERA, POSE, OWN = 9, 6, 3  # fx, fy, cx, cy, k1, k2, p1, p2, k3; turn, shift; of a view: focal length, cx, cy
COLUMNS = ("marks", "sigma0", "robust", "own", "own rob.", "2-D RMS", "per axis", "median", "px/1000", "left", "alike")


@dataclass
class Sheet:
    """Marks (K) as view and disc; camera (9,), poses (V, 6) as turn and shift, discs (P, 3), the views' own (V, 3)."""

    view: Ints
    disc: Ints
    camera: Array
    poses: Array
    xyz: Array
    own: Array

    def take(self, index: NDArray[np.bool_]) -> Sheet:
        """Some of the marks, and only their discs."""
        used, disc = np.unique(self.disc[index], return_inverse=True)
        return Sheet(self.view[index], disc, self.camera.copy(), self.poses.copy(), self.xyz[used], self.own.copy())


def start(view: Ints, name: Ints, marks: Array, points: dict[int, Array]) -> Sheet:
    """From PhotoModeler's points and OpenCV's calibration on the published marks."""
    used, disc = np.unique(name, return_inverse=True)
    xyz = np.array([points[int(k)] for k in used])
    guess = np.array([[FOCAL_PX, 0, SIZE[0] / 2], [0, FOCAL_PX, SIZE[1] / 2], [0, 0, 1]])
    objects = [xyz[disc[view == v]].astype(np.float32) for v in range(view.max() + 1)]
    seen = [marks[view == v].astype(np.float32) for v in range(view.max() + 1)]
    _, k, lens, turns, shifts = cv2.calibrateCamera(
        objects, seen, SIZE, guess, None, flags=cv2.CALIB_USE_INTRINSIC_GUESS
    )
    poses = np.hstack([np.reshape(turns, (-1, 3)), np.reshape(shifts, (-1, 3))])
    camera = np.concatenate([k[[0, 1, 0, 1], [0, 1, 2, 2]], lens.ravel()[:5]])
    return Sheet(view, disc, camera, poses, xyz, np.zeros((len(poses), OWN)))


def project(sheet: Sheet) -> tuple[Array, Array]:
    """Images (K, 2) and their derivatives (K, 2, P) by camera, poses, discs and what the views have for their own."""
    f, c = sheet.camera[:2], sheet.camera[2:4]
    points_at = CAMERA + sheet.poses.size
    own_at = points_at + sheet.xyz.size
    xy, jacobian = np.empty((len(sheet.view), 2)), np.zeros((len(sheet.view), 2, own_at + sheet.own.size))
    for v, (pose, own) in enumerate(zip(sheet.poses, sheet.own, strict=True)):
        mine = np.flatnonzero(sheet.view == v)
        disc = sheet.disc[mine]
        k = np.diag([*(f * (1 + own[0])), 1.0])
        k[:2, 2] = c + own[1:]
        image, by = cv2.projectPoints(sheet.xyz[disc], pose[:3], pose[3:], k, sheet.camera[4:])
        xy[mine], by = image[:, 0], by.reshape(len(mine), 2, -1)  # by turn, shift, fx fy, cx cy, lens
        jacobian[mine, :, :CAMERA] = by[:, :, POSE:]
        jacobian[mine, :, CAMERA + POSE * v : CAMERA + POSE * (v + 1)] = by[:, :, :POSE]
        jacobian[mine, :, own_at + OWN * v] = by[:, :, POSE : POSE + 2] @ f
        jacobian[mine, :, own_at + OWN * v + 1 : own_at + OWN * (v + 1)] = by[:, :, POSE + 2 : POSE + 4]
        by_point = by[:, :, 3:6] @ cv2.Rodrigues(pose[:3])[0]
        for axis in range(3):
            jacobian[mine, :, points_at + 3 * disc + axis] = by_point[:, :, axis]
    return xy, jacobian


def bundle(sheet: Sheet, marks: Array, own: bool) -> Array:
    """Residuals (K, 2) of the adjusted sheet as sigmas: larger by what the unknowns took. Gauss-Newton."""
    ends = np.cumsum([CAMERA, sheet.poses.size, sheet.xyz.size, sheet.own.size])[: 4 if own else 3]
    for _ in range(20):
        xy, jacobian = project(sheet)
        a = jacobian[:, :, : ends[-1]].reshape(-1, ends[-1])
        scale = np.sqrt((a**2).sum(axis=0))
        a = a / scale
        datum = inner_constraints(sheet, ends) / scale
        datum /= np.linalg.norm(datum, axis=1)[:, None]
        step = np.linalg.solve(a.T @ a + datum.T @ datum, a.T @ (marks - xy).ravel())
        change = np.split(step / scale, ends[:-1])
        for values, more in zip((sheet.camera, sheet.poses, sheet.xyz, sheet.own), change, strict=False):
            values += more.reshape(values.shape)
        if np.abs(a @ step).max() < 1e-6:  # px
            redundancy = a.shape[0] - a.shape[1] + len(datum)
            return (marks - project(sheet)[0]) * np.sqrt(marks.size / redundancy)
    raise RuntimeError("the bundle adjustment did not converge in 20 steps")


def inner_constraints(sheet: Sheet, ends: Ints) -> Array:
    """Rows (7 or 10, P): shifts, turns and scale of all discs together; the mean of the views' own."""
    centred, unit = sheet.xyz - sheet.xyz.mean(axis=0), np.eye(3)
    moves = [np.broadcast_to(e, centred.shape) for e in unit] + [np.cross(e, centred) for e in unit] + [centred]
    rows = np.zeros((len(moves) + (OWN if len(ends) > 3 else 0), ends[-1]))
    rows[: len(moves), ends[1] : ends[2]] = np.reshape(moves, (len(moves), -1))
    if len(ends) > 3:
        rows[len(moves) :, ends[2] :] = np.tile(np.eye(OWN), len(sheet.own))
    return rows


def centres(image: NDArray, marks: Array, radius_px: tuple[float, ...], gate_px: float = 3.0) -> dict[str, Array]:
    """Centres (N, 2) of the marked discs by each method, NaN where it has none."""
    found = detect(image, radius_px=radius_px)
    pairs = pair(found.xy, marks, gate_px)
    xy, radius = found.xy[pairs.found], found.radius_px[pairs.found]
    linear = np.where(image <= 10.31, image / 12.92, 255 * ((image / 255 + 0.055) / 1.055) ** 2.4)  # sRGB undone
    soft = [soft_centroid(image, p, r, "dark") for p, r in zip(marks[pairs.true], radius, strict=True)]
    bowl = detect(image, radius_px=radius_px, refine="bowl").xy
    own = pair(bowl, marks, gate_px)
    additive = refine_template(image, xy, radius, photometry="additive").xy
    return {
        "template": _placed(len(marks), pairs.true, xy),
        "template, additive": _placed(len(marks), pairs.true, additive),
        "template, sRGB undone": _placed(len(marks), pairs.true, refine_template(linear, xy, radius).xy),
        "bowl": _placed(len(marks), own.true, bowl[own.found]),
        "soft centroid": _placed(len(marks), pairs.true, np.array(soft)),
    }


def _placed(count: int, index: Ints, xy: Array) -> Array:
    out = np.full((count, 2), np.nan)
    out[index] = xy
    return out


def measure(folder: Path, radius_px: tuple[float, ...], every: int) -> tuple[Sheet, dict[str, Array]]:
    """The marks of every so manyth view, all kinds of centres of them (K, 2)."""
    table = np.loadtxt(folder / "markpts.txt", delimiter=",", comments="#")
    images = sorted((folder / "images").iterdir())[::every]
    parts, view = [], []
    for v, path in enumerate(images):
        mine = table[table[:, 0] == 1 + every * v]
        marks = mine[:, 2:4] - 0.5
        part = {"name": mine[:, 1], "published": marks}
        for channel in CHANNELS:
            one = centres(read_grey(path, channel=channel), marks, radius_px)
            part |= {f"{channel}: {key}": xy for key, xy in one.items()}
        parts.append(part)
        view.append(np.full(len(mine), v))
    kinds = {key: np.concatenate([p[key] for p in parts]) for key in parts[0]}
    name, points = kinds.pop("name").astype(int), photomodeler_points(folder / "photomodeler_3dpts.txt")
    return start(np.concatenate(view), name, kinds["published"], points), kinds


def main(quick: bool = False) -> dict[str, object]:
    """Adjust, print one table, return its numbers: kind of centres -> column."""
    one = SETS["DBAT sheet"]
    if not (DATA / one.folder).is_dir():
        print("skipped: the DBAT sheet is not beside the checkout (../shared/data)")
        return {"skipped": "no data"}
    sheet, kinds = measure(DATA / one.folder, one.radius_px, 3 if quick else 1)
    common = np.all([np.isfinite(xy).all(axis=1) for xy in kinds.values()], axis=0)
    published, sheet = kinds["published"][common], sheet.take(common)
    outward = published - np.array(SIZE) / 2
    everything, results, reference = np.ones(len(published), dtype=bool), {}, np.zeros_like(published)
    print(f"{common.sum()} of {len(common)} marks, {len(sheet.poses)} views")
    print(f"{'':30s}" + "".join(f"{name:>9s}" for name in COLUMNS))
    for key, every_xy in kinds.items():
        xy = every_xy[common]
        shared, v = (bundle(sheet.take(everything), xy, own) for own in (False, True))
        reference = v if key == "published" else reference
        off = xy - published
        values = (
            int(np.isfinite(every_xy).all(axis=1).sum()), _rms(shared), _robust(shared), _rms(v), _robust(v),
            np.sqrt(2) * _rms(off), _rms(off), np.median(np.hypot(*off.T)),
            1000 * (off * outward).sum() / (outward**2).sum(), _rms(v - reference),
            (v * reference).sum() / np.sqrt((v**2).sum() * (reference**2).sum()),
        )  # fmt: skip
        results[key] = dict(zip(COLUMNS, map(float, values), strict=True))
        print(f"{key:30s}{values[0]:9d}" + "".join(f"{value:9.4f}" for value in values[1:]), flush=True)
    print(
        "sigma0: error per axis that the bundle leaves, px, and own: if each view has its own focal length and "
        "principal point;\nrobust: from the median. To the published marks: 2-D RMS, RMS per axis, 2-D median, outward "
        "px per 1000 px from the\nmiddle; left: RMS per axis of the difference of the residuals (own), which no camera "
        "explains; alike: their correlation"
    )
    return results


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _robust(values: Array) -> float:
    return float(1.4826 * np.median(np.abs(values)))


if __name__ == "__main__":
    main("--quick" in sys.argv[1:])
