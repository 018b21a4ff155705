"""The signs of the backward lens, on a published bundle: DBAT's camera in mm, its marks and PhotoModeler's points."""

from __future__ import annotations

import csv
from xml.etree import ElementTree

import numpy as np
import pytest

from windmark.adjust import refine_pose
from windmark.geometry import Pose
from windmark.io import read_camera_file


@pytest.fixture(scope="module")
def bundle(shared_data):
    """Published camera, per image start pose, points and marks (0-based pixels)."""
    folder = shared_data / "dbat-camcal"
    camera = ElementTree.parse(folder / "dbat_camera.xml").getroot().find("cameras/camera")
    with open(folder / "photomodeler_3dpts.txt", newline="") as stream:
        points = {int(row[0]): [float(v) for v in row[3:6]] for row in csv.reader(stream) if row and row[0].isdigit()}
    lines = [line.split(",") for line in (folder / "dbat_camera_stations.txt").read_text().splitlines()]
    poses = {int(w[1]): pose(*map(float, w[2:8])) for w in lines if len(w) > 8 and w[0].strip().isdigit()}
    marks = np.genfromtxt(folder / "markpts.txt", delimiter=",", comments="#")
    marks[:, 2:4] -= 0.5  # DBAT counts from the corner of the first pixel
    views = [(poses[k], marks[marks[:, 0] == k]) for k in sorted(poses)]
    return camera, [(p, np.array([points[int(i)] for i in m[:, 1]]), m[:, 2:4]) for p, m in views]


def pose(x, y, z, omega, phi, kappa):
    """Photogrammetric angles (camera z backwards, y up) as cam_from_model."""
    turns = [Pose.from_rotvec(v, np.zeros(3)).rotation.T for v in ([omega, 0, 0], [0, phi, 0], [0, 0, kappa])]
    rotation = np.diag([1.0, -1.0, -1.0]) @ turns[2] @ turns[1] @ turns[0]
    return Pose(rotation, -rotation @ np.array([x, y, z]))


def table(camera, signs=(1, 1, 1)):
    """The published camera as a table of Australis' parameters; DBAT's principal point is from the top-left corner."""

    def numbers(tag):
        return [float(v) for v in camera.find(tag).text.split(",")]

    (w, h), (width, height), (px, py) = numbers("sensor"), numbers("image"), numbers("pp")
    k, p = numbers("K"), numbers("P")
    lines = [f"width {width:.0f}", f"height {height:.0f}", f"pixel_x {w / width!r}", f"pixel_y {h / height!r}"]
    lines += [f"C {numbers('cc')[0]!r} mm", f"XP {px - w / 2!r} mm", f"YP {h / 2 - py!r} mm"]
    lines += [f"K{n} {signs[0] * value!r}" for n, value in enumerate(k, start=1)]
    lines += [f"P{n} {signs[n] * value!r}" for n, value in enumerate(p, start=1)]
    return "\n".join(lines)


def sigma0(camera, views):
    """Per coordinate, every pose refined, camera and points as published."""
    residuals = [refine_pose(camera, start, xyz, xy).residuals_px.ravel() for start, xyz, xy in views]
    total = np.concatenate(residuals)
    return float(np.sqrt(total @ total / (len(total) - 6 * len(views))))


def test_dbats_camera_in_mm(bundle, tmp_path):
    """0.140 px with the published signs (its bundle, with other points: 0.1615), 0.163 to 0.203 with turned ones."""
    camera, views = bundle
    values = {}
    for signs in ((1, 1, 1), (1, -1, 1), (1, 1, -1), (1, -1, -1)):
        (tmp_path / "dbat.txt").write_text(table(camera, signs))
        content = read_camera_file(tmp_path / "dbat.txt")
        values[signs] = sigma0(content.camera, views)
    right = values.pop((1, 1, 1))
    assert right < 0.145
    assert min(values.values()) > 1.1 * right
