"""Rational and fisheye lenses in camera files: what a format can hold comes back, what it cannot is refused."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from windmark.errors import UsageError
from windmark.geometry import Camera
from windmark.io import read_camera, write_camera

FISHEYE = Camera((1400, 1050), 505.0, 1.01, 702.0, 520.0, k1=-0.012, k2=2e-3, k3=-5e-4, k4=4e-5, lens="fisheye")
RATIONAL = Camera(
    (1400, 1050), 880.0, 1.01, 706.0, 518.0, 0.62, 0.09, 1e-4, -2e-4, 2e-3, k4=0.95, k5=0.25, k6=0.012, lens="rational"
)


@pytest.mark.parametrize(
    ("name", "camera"),
    [
        ("c.json", FISHEYE), ("c.json", RATIONAL), ("c.yml", FISHEYE), ("c.yml", RATIONAL), ("colmap", FISHEYE),
        ("colmap", RATIONAL), ("c.cameramodel", RATIONAL),
    ],
)  # fmt: skip
def test_a_wide_camera_comes_back(tmp_path, name, camera):
    write_camera(tmp_path / name, camera)
    again = read_camera(tmp_path / name)[0]
    assert (again.lens, again.size_px) == (camera.lens, camera.size_px)
    np.testing.assert_allclose(again.parameters(), camera.parameters(), rtol=1e-14)


def test_our_own_file_keeps_the_covariance_of_all_coefficients(tmp_path):
    for size in (14, 15):
        root = np.random.default_rng(0).normal(size=(size, size))
        write_camera(tmp_path / "c.json", RATIONAL.with_parameters(RATIONAL.parameters(), root @ root.T))
        again = read_camera(tmp_path / "c.json")[0].cov
        np.testing.assert_array_equal(again[:size, :size], root @ root.T)
        assert not again[size:].any()


def test_opencv_reads_a_fisheye_as_it_is(tmp_path):
    write_camera(tmp_path / "c.yml", FISHEYE)
    store = cv2.FileStorage(str(tmp_path / "c.yml"), cv2.FILE_STORAGE_READ)
    k, d = store.getNode("camera_matrix").mat(), store.getNode("distortion_coefficients").mat()
    assert store.getNode("distortion_model").string() == "equidistant"
    xyz = np.array([[[0.3, -2.0, 1.0]], [[1.0, 1.0, 3.0]]])
    seen = cv2.fisheye.projectPoints(xyz, np.zeros(3), np.zeros(3), k, d.ravel())[0][:, 0]
    np.testing.assert_allclose(FISHEYE.project(xyz[:, 0])[0], seen, atol=1e-9)


@pytest.mark.parametrize(
    ("model", "parameters", "expected"),
    [
        ("SIMPLE_RADIAL_FISHEYE", "300 320.5 240.5 -0.01", (300.0, 1.0, -0.01, 0.0, 0.0)),
        ("RADIAL_FISHEYE", "300 320.5 240.5 -0.01 0.002", (300.0, 1.0, -0.01, 0.002, 0.0)),
        ("OPENCV_FISHEYE", "300 303 320.5 240.5 -0.01 0.002 0 3e-4", (300.0, 1.01, -0.01, 0.002, 3e-4)),
    ],
)
def test_colmaps_fisheyes(tmp_path, model, parameters, expected):
    (tmp_path / "cameras.txt").write_text(f"1 {model} 640 480 {parameters}\n")
    camera = read_camera(tmp_path)[0]
    assert (camera.lens, camera.cx, camera.cy) == ("fisheye", 320.0, 240.0)
    np.testing.assert_allclose([camera.focal_px, camera.aspect, camera.k1, camera.k2, camera.k4], expected)


@pytest.mark.parametrize(
    ("name", "camera", "message"),
    [
        ("c.cameramodel", FISHEYE, r"mrcal's OPENCV models cannot hold this lens; .* got a fisheye lens"),
        ("c.xml", FISHEYE, "Metashape's frame camera cannot hold this lens"),
        ("c.xml", RATIONAL, "Metashape's frame camera cannot hold this lens; expected k1 k2 p1 p2 k3, got a rational"),
        ("c.yml", Camera((10, 10), 5.0, tilt_x=0.1, lens="fisheye"), "OpenCV's fisheye model cannot hold sensor tilts"),
    ],
)  # fmt: skip
def test_what_a_format_cannot_hold_is_refused(tmp_path, name, camera, message):
    with pytest.raises(UsageError, match=message):
        write_camera(tmp_path / name, camera)
