"""OpenCV itself writes and reads the files that windmark exchanges with it."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.io import read_camera, write_camera

MATRIX = np.array([[1370.401138555427, 0, 643.8], [0, 1369.9, 373.813], [0, 0, 1]])
LENS = np.array([[-0.08, 0.01, 1e-4, -2e-5, 1e-3]])


@pytest.mark.parametrize("extension", ["yml", "xml", "json"])
@pytest.mark.parametrize("column", [True, False])
def test_reads_what_opencv_writes(tmp_path, extension, column):
    path = tmp_path / f"c.{extension}"
    rng = np.random.default_rng(1)
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("calibration_time", "Fri 10 Jan 2020 10:11:12 # AM")
    storage.write("image_width", 1280)
    storage.write("image_height", 800)
    storage.write("camera_matrix", MATRIX)
    storage.write("distortion_coefficients", LENS.T if column else LENS)
    storage.write("rvec", np.array([0.1, 0.2, 0.3]))
    storage.write("tvec", np.array([[1.0, 2, 3]]))
    storage.writeComment("a set of 6-tuples")
    storage.write("extrinsic_parameters", rng.random((3, 6)))
    storage.startWriteStruct("names", cv2.FileNode_SEQ)
    for value in ("a:b", "2", 3.5):
        storage.write("", value)
    storage.endWriteStruct()
    storage.startWriteStruct("statistics", cv2.FileNode_MAP)
    storage.write("rms", 0.3)
    storage.write("operator", "x y")
    storage.endWriteStruct()
    storage.write("image_points", rng.random((4, 5, 2)).astype(np.float32))
    storage.release()
    camera, pose = read_camera(path)
    np.testing.assert_array_equal(camera.matrix, MATRIX)
    np.testing.assert_array_equal([camera.k1, camera.k2, camera.p1, camera.p2, camera.k3], LENS[0])
    np.testing.assert_array_equal(pose.translation, [1, 2, 3])
    np.testing.assert_allclose(pose.rotation, cv2.Rodrigues(np.array([0.1, 0.2, 0.3]))[0], atol=1e-15)


@pytest.mark.parametrize("tilt", [0.0, 0.02])
def test_opencv_reads_what_is_written_and_projects_alike(tmp_path, tilt):
    camera = Camera((1280, 800), 1370.4, 0.999, 643.8, 373.8, -0.08, 0.01, 1e-4, -2e-5, 1e-3, tilt, -tilt)
    pose = Pose.from_rotvec([0.1, -0.2, 0.3], [1, 2, 30])
    write_camera(tmp_path / "c.yml", camera, pose, unit="in")
    storage = cv2.FileStorage(str(tmp_path / "c.yml"), cv2.FILE_STORAGE_READ)
    matrix, lens, rvec, tvec = (
        storage.getNode(key).mat() for key in ("camera_matrix", "distortion_coefficients", "rvec", "tvec")
    )
    assert storage.getNode("image_width").real() == 1280
    assert storage.getNode("length_unit").string() == "in"
    storage.release()
    xyz = np.random.default_rng(2).uniform(-5, 5, (50, 3))
    theirs = cv2.projectPoints(xyz, rvec, tvec, matrix, lens)[0][:, 0]
    ours, valid = camera.project(pose.apply(xyz))
    assert valid.all()
    np.testing.assert_allclose(ours, theirs, atol=1e-9)
