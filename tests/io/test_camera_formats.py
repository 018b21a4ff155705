"""Cameras of other programs: published formulas, exact round trips, a clear word for what does not fit."""

from __future__ import annotations

import json
import re

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from windmark.geometry import Camera, Pose
from windmark.io import FileError, read_camera, read_camera_file, read_colmap, write_camera, write_colmap

CAMERA = Camera((1280, 800), 1370.4, 1.0001, 643.8, 373.8, k1=-0.08, k2=0.011, p1=1e-4, p2=-2e-4, k3=1e-3)
POSE = Pose.from_rotvec([0.1, -0.9, 0.3], [3.8, 0.52, 11.5])
FORWARD = {"c.yml": None, "c.json": "opencv", "c.cameramodel": None, "c.xml": None, "model": None}


def small(x):
    return st.floats(-x, x)


cameras = st.builds(
    Camera,
    size_px=st.tuples(st.integers(1, 20000), st.integers(1, 20000)),
    focal_px=st.floats(1, 1e6),
    aspect=st.sampled_from([1.0, 1.0001, 0.5]),
    cx=small(1e4), cy=small(1e4), k1=small(1), k2=small(1), p1=st.sampled_from([0.0, 1e-4]), p2=small(0.1),
    k3=st.sampled_from([0.0, -0.1]),
)  # fmt: skip


@pytest.mark.parametrize("name", FORWARD)
@given(camera=cameras)
def test_forward_formats_give_the_camera_back_to_rounding(one_folder, name, camera):
    path = one_folder / name
    write_camera(path, camera, format=FORWARD[name])
    again = read_camera_file(path)
    assert again.camera.size_px == camera.size_px
    assert again.cam_from_model is None
    wanted, got = camera.parameters(), again.camera.parameters()
    # Where an offset is added (COLMAP, Metashape) the rounding is that of the pixel numbers, up to 2e4.
    np.testing.assert_allclose(got, wanted, rtol=1e-14, atol=1e-11)
    np.testing.assert_array_equal(got[4:9], wanted[4:9])


@pytest.mark.parametrize("name", ["c.yml", "c.json", "c.cameramodel", "model"])
def test_poses_come_back(tmp_path, name):
    write_camera(tmp_path / name, CAMERA, POSE, unit="mm", format=FORWARD[name])
    pose = read_camera(tmp_path / name)[1]
    np.testing.assert_allclose(pose.rotation, POSE.rotation, atol=1e-15)
    np.testing.assert_array_equal(pose.translation, POSE.translation)


def opencv(path, rays):
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    matrix, lens = (storage.getNode(key).mat() for key in ("camera_matrix", "distortion_coefficients"))
    storage.release()
    return cv2.projectPoints(rays, np.zeros(3), np.zeros(3), matrix, lens)[0][:, 0]


def colmap(path, rays):
    """COLMAP's OPENCV and FULL_OPENCV camera models, read with its own word order; pixels from the corner."""
    words = (path / "cameras.txt").read_text().splitlines()[1].split()
    assert words[:4] == ["1", "FULL_OPENCV", "1280", "800"]
    fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6 = map(float, words[4:])
    u, v = rays[:, 0] / rays[:, 2], rays[:, 1] / rays[:, 2]
    r2 = u * u + v * v
    radial = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
    x = u * radial + 2 * p1 * u * v + p2 * (r2 + 2 * u * u)
    y = v * radial + 2 * p2 * u * v + p1 * (r2 + 2 * v * v)
    # In COLMAP the centre of the first pixel is (0.5, 0.5), in windmark it is (0, 0).
    return np.stack([fx * x + cx, fy * y + cy], axis=1) - 0.5


def mrcal(path, rays):
    content = eval(path.read_text())  # our own file; a dictionary of lists
    assert content["lensmodel"] == "LENSMODEL_OPENCV5"
    fx, fy, cx, cy, *lens = content["intrinsics"]
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    return cv2.projectPoints(rays, np.zeros(3), np.zeros(3), matrix, np.array(lens))[0][:, 0]


def metashape(path, rays):
    """The frame camera of Metashape's manual; pixels from the corner, offsets from the middle."""
    from xml.etree import ElementTree

    c = {child.tag: child.text for child in ElementTree.parse(path).getroot()}
    c = {key: float(text) for key, text in c.items() if key != "projection"}
    x, y = rays[:, 0] / rays[:, 2], rays[:, 1] / rays[:, 2]
    r = np.hypot(x, y)
    radial = 1 + c["k1"] * r**2 + c["k2"] * r**4 + c["k3"] * r**6
    xd = x * radial + c["p1"] * (r**2 + 2 * x**2) + 2 * c["p2"] * x * y
    yd = y * radial + c["p2"] * (r**2 + 2 * y**2) + 2 * c["p1"] * x * y
    u = c["width"] * 0.5 + c["cx"] + xd * c["f"] + xd * c["b1"]
    v = c["height"] * 0.5 + c["cy"] + yd * c["f"]
    return np.stack([u, v], axis=1) - 0.5


PUBLISHED = {"c.yml": opencv, "c.json": opencv, "model": colmap, "c.cameramodel": mrcal, "c.xml": metashape}


@pytest.mark.parametrize("name", PUBLISHED)
def test_what_is_written_projects_as_the_format_says(tmp_path, name):
    """The file's numbers, put into the published formula, show every point where windmark's camera shows it."""
    write_camera(tmp_path / name, CAMERA, format=FORWARD[name])
    rays = np.random.default_rng(1).uniform([-0.5, -0.3, 1], [0.5, 0.3, 1], (200, 3)) * 7.0
    wanted, valid = CAMERA.project(rays)
    assert valid.all()
    np.testing.assert_allclose(PUBLISHED[name](tmp_path / name, rays), wanted, atol=1e-9)


# --- COLMAP ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("7 SIMPLE_PINHOLE 640 480 900 320.5 240.5", Camera((640, 480), 900.0, 1.0, 320.0, 240.0)),
        ("7 PINHOLE 640 480 900 450 320.5 240.5", Camera((640, 480), 900.0, 0.5, 320.0, 240.0)),
        ("7 SIMPLE_RADIAL 640 480 900 320.5 240.5 -0.1", Camera((640, 480), 900.0, 1.0, 320.0, 240.0, k1=-0.1)),
        ("7 RADIAL 640 480 900 320.5 240.5 -0.1 .02", Camera((640, 480), 900.0, 1.0, 320.0, 240.0, k1=-0.1, k2=0.02)),
        (
            "7 OPENCV 640 480 900 450 320.5 240.5 -0.1 .02 .003 .004",
            Camera((640, 480), 900.0, 0.5, 320.0, 240.0, -0.1, 0.02, 0.003, 0.004),
        ),
        (
            "7 FULL_OPENCV 640 480 900 450 320.5 240.5 -0.1 .02 .003 .004 .05 0 0 0",
            Camera((640, 480), 900.0, 0.5, 320.0, 240.0, -0.1, 0.02, 0.003, 0.004, 0.05),
        ),
    ],
)
def test_colmap_models(tmp_path, line, expected):
    """Each model is read, and is the one that is written for such a camera."""
    (tmp_path / "cameras.txt").write_text(f"# Camera list\n{line}\n")
    for place in (tmp_path, tmp_path / "cameras.txt"):
        np.testing.assert_array_equal(read_camera(place)[0].parameters(), expected.parameters())
    write_colmap(tmp_path / "again", {7: expected})
    words = (tmp_path / "again" / "cameras.txt").read_text().splitlines()[1].split()
    assert words[1] == line.split()[1]
    assert list(map(float, words[4:])) == list(map(float, line.split()[4:]))


def test_colmap_model_of_several_cameras_and_images(tmp_path):
    cameras = {3: CAMERA, 5: Camera((640, 480), 900.0)}
    images = {"a.tif": (5, POSE), "b.tif": (3, POSE.inverse()), "c.tif": (3, Pose.from_rotvec([0, 3.1, 0], [1, 2, 3]))}
    write_colmap(tmp_path / "m", cameras, images)
    model = read_colmap(tmp_path / "m")
    assert list(model.cameras) == [3, 5]
    assert {name: number for name, (number, _) in model.images.items()} == {"a.tif": 5, "b.tif": 3, "c.tif": 3}
    for name, (_, pose) in images.items():
        np.testing.assert_allclose(model.images[name][1].rotation, pose.rotation, atol=1e-15)
        np.testing.assert_array_equal(model.images[name][1].translation, pose.translation)
    camera, pose = read_camera(tmp_path / "m", which="a.tif")
    assert camera.focal_px == 900
    np.testing.assert_allclose(pose.rotation, POSE.rotation, atol=1e-15)
    content = read_camera_file(tmp_path / "m", which="3")
    assert content.camera.focal_px == CAMERA.focal_px
    assert content.note == "3 poses in images.txt not taken: name an image to take its own"
    with pytest.raises(FileError, match=r"several cameras \(3, 5\); choose one of them, or an image"):
        read_camera(tmp_path / "m")
    with pytest.raises(FileError, match=r"no image or camera 'z'; expected one of the cameras 3, 5 or 3 images \(a"):
        read_camera(tmp_path / "m", which="z")


def test_colmap_quaternion_and_lines_of_points(tmp_path):
    """A quarter turn about z, by hand; the second line of an image holds its points."""
    write_colmap(tmp_path, {1: CAMERA})
    half = np.sqrt(0.5)
    text = f"# a comment\n1 {half} 0 0 {half} 1 2 3 1 one.tif\n10.5 20.5 -1 3 4 7\n2 1 0 0 0 0 0 5 1 two words.tif\n"
    (tmp_path / "images.txt").write_text(text)
    images = read_colmap(tmp_path).images
    np.testing.assert_allclose(images["one.tif"][1].apply([1, 0, 0]), [1, 3, 3], atol=1e-15)
    np.testing.assert_allclose(images["two words.tif"][1].apply([1, 0, 0]), [1, 0, 5], atol=1e-15)


@pytest.mark.parametrize(
    ("cameras", "images", "message"),
    [
        (
            "1 FOV 640 480 9 9 1 1 0",
            "",
            "line 1: the lens model is FOV; expected one of",
        ),
        ("1 PINHOLE 640 480 9 9 1", "", "line 1: 3 parameters of PINHOLE; expected fx fy cx cy"),
        ("1 PINHOLE 640 480 9 9 1 nan", "", "line 1: not finite numbers"),
        ("1 PINHOLE 640 480 9 9 1 2e18", "", r"line 1: not finite numbers of at most 1e\+18: "),
        ("1 PINHOLE 640 480 9 -9 1 1", "", "line 1, PINHOLE': the focal lengths are 9 and -9"),
        ("1 PINHOLE 640 480 9 9 1 1\n1 PINHOLE 640 480 9 9 1 1", "", "line 2: camera 1 is there twice"),
        ("1 OPENCV_FISHEYE 640 480 9 9 1 1 0 0 0", "", "line 1: 7 parameters of OPENCV_FISHEYE; expected"),
        ("1 PINHOLE 640 480 9 9 1 1", "1 1 0 0 0 0 0 0 2 a\n\n", "images.txt: line 1: camera 2 is not in cameras.txt"),
        ("1 PINHOLE 640 480 9 9 1 1", "1 2 0 0 0 0 0 0 1 a\n\n", "line 1: the quaternion has length 2; expected 1"),
        ("1 PINHOLE 640 480 9 9 1 1", "1 1 0 0 0 0 0 1 a\n\n", "line 1: not an image; expected IMAGE_ID QW"),
        (
            "1 PINHOLE 640 480 9 9 1 1",
            "1 1 0 0 0 0 0 0 1 a\n2 1 0 0 0 0 0 0 1 b",
            "line 2: expected the line of the image's points",
        ),
    ],
)
def test_faults_of_colmap(tmp_path, cameras, images, message):
    (tmp_path / "cameras.txt").write_text(cameras + "\n")
    if images:
        (tmp_path / "images.txt").write_text(images)
    with pytest.raises(FileError, match=message):
        read_colmap(tmp_path)


# --- mrcal -----------------------------------------------------------------------------------

MRCAL = """{
    'lensmodel':  'LENSMODEL_OPENCV8',

    # intrinsics are fx,fy,cx,cy,distortion0,distortion1,....
    'intrinsics': [ 900, 901, 320, 240, -0.1, 0.01, 0.001, -0.002, 0.05, 0, 0, 0,],
    'valid_intrinsics_region': [ [ 0, 0 ], [ 0, 10 ], ],
    # extrinsics are rt_fromref
    'extrinsics': [ 0, 0, 1.5707963267948966, 1, 2, 3,],
    'imagersize': [ 640, 480,],
    'icam_intrinsics': 0,
    'optimization_inputs': b'abc'
}
"""


def test_mrcal(tmp_path):
    for name in ("extrinsics", "rt_cam_ref"):
        (tmp_path / "c.cameramodel").write_text(MRCAL.replace("'extrinsics'", f"'{name}'"))
        content = read_camera_file(tmp_path / "c.cameramodel")
        expected = Camera((640, 480), 900.0, 901 / 900, 320.0, 240.0, -0.1, 0.01, 0.001, -0.002, 0.05)
        np.testing.assert_array_equal(content.camera.parameters(), expected.parameters())
        np.testing.assert_allclose(content.cam_from_model.apply([1, 0, 0]), [1, 3, 3], atol=1e-15)
        assert (content.length_unit, content.format) == (None, "mrcal")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "OPENCV8",
            "SPLINED_STEREOGRAPHIC_order=3",
            "key 'lensmodel': 'LENSMODEL_SPL.*; expected one of LENS",
        ),
        ("OPENCV8", "OPENCV12", r"key 'intrinsics': the shape is \(12,\); expected 16"),
        ("0, 0, 0,]", "0, 0,]", r"key 'intrinsics': the shape is \(11,\); expected 12"),
        ("900, 901", "nan, 901", "a value is no plain number"),
        ("900, 901", "'900', 901", "key 'intrinsics': not finite numbers"),
        ("'imagersize'", "'size'", "key 'imagersize': missing"),
        ("1.5707963267948966, ", "", r"key 'extrinsics': the shape is \(5,\)"),
        ("[ 640, 480,]", "[ 640, 480,", "line .*not an mrcal camera model"),
        ("900, 901", "print(1), 901", "a value is no plain number"),
    ],
)
def test_faults_of_mrcal(tmp_path, old, new, message):
    assert old in MRCAL
    (tmp_path / "c.cameramodel").write_text(MRCAL.replace(old, new))
    with pytest.raises(FileError, match=message):
        read_camera(tmp_path / "c.cameramodel")


# --- Metashape -------------------------------------------------------------------------------

METASHAPE = """<?xml version="1.0" encoding="UTF-8"?>
<calibration>
  <projection>frame</projection>
  <width>5280</width>
  <height>3956</height>
  <f>3713.08</f>
  <cx>-21.1253</cx>
  <cy>-11.5535</cy>
  <k1>0.0202373</k1>
  <p1>0.000877708</p1>
  <p2>-0.000343606</p2>
  <b1>2.5</b1>
  <date>2024-05-15T00:00:00Z</date>
</calibration>
"""


def test_metashape(tmp_path):
    (tmp_path / "c.xml").write_text(METASHAPE)
    content = read_camera_file(tmp_path / "c.xml")
    expected = Camera(
        (5280, 3956), 3715.58, 3713.08 / 3715.58, 2640 - 21.1253 - 0.5, 1978 - 11.5535 - 0.5, k1=0.0202373,
        p1=-0.000343606, p2=0.000877708,
    )  # fmt: skip
    np.testing.assert_allclose(content.camera.parameters(), expected.parameters(), rtol=1e-15)
    assert (content.cam_from_model, content.format) == (None, "metashape")


def test_a_skew_of_metashape(tmp_path):
    """u = width / 2 + cx + (f + b1) x + b2 y, by the formula of its manual."""
    (tmp_path / "c.xml").write_text(METASHAPE.replace("<b1>2.5</b1>", "<b1>2.5</b1><b2>-0.8</b2>"))
    camera = read_camera(tmp_path / "c.xml")[0]
    x, y = 0.3, -0.2
    r2 = x * x + y * y
    dx = x * (1 + 0.0202373 * r2) + 0.000877708 * (r2 + 2 * x * x) - 2 * 0.000343606 * x * y
    dy = y * (1 + 0.0202373 * r2) - 0.000343606 * (r2 + 2 * y * y) + 2 * 0.000877708 * x * y
    u, v = 2640 - 21.1253 + 3715.58 * dx - 0.8 * dy, 1978 - 11.5535 + 3713.08 * dy
    np.testing.assert_allclose(camera.project([x, y, 1.0])[0], [u - 0.5, v - 0.5], rtol=1e-13)
    write_camera(tmp_path / "again.xml", camera)
    again = read_camera(tmp_path / "again.xml")[0]
    np.testing.assert_allclose(again.parameters(), camera.parameters(), rtol=1e-14)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("frame<", "fisheye<", "key 'projection': 'fisheye'; expected 'frame'"),
        ("<b1>2.5</b1>", "<b2>skew</b2>", "key 'b2': 'skew' is no number"),
        ("<b1>2.5</b1>", "<k4>0.1</k4>", r"key 'k4': k4 \(r\^8\) is 0.1"),
        ("<b1>2.5</b1>", "<p3>0.1</p3>", "key 'p3'"),
        ("<f>3713.08</f>", "", "key 'f': missing"),
        ("<f>3713.08</f>", "<fx>1</fx>", "key 'fx': a PhotoScan file of before version 1.2"),
        ("3713.08", "NaN", "key 'f': not finite"),
        ("3713.08", "long", "key 'f': 'long' is no number"),
        ("3713.08", "-1", "key 'f': the focal lengths are 1.5 and -1"),
        ("5280", "0", "key 'width': .* is no image size"),
        ("</calibration>", "", "not XML"),
        ("calibration>", "document>", "the XML's root is <document>; expected .*; export the calibration itself"),
    ],
)
def test_faults_of_metashape(tmp_path, old, new, message):
    assert old in METASHAPE
    (tmp_path / "c.xml").write_text(METASHAPE.replace(old, new))
    with pytest.raises(FileError, match=message):
        read_camera(tmp_path / "c.xml")


# --- what cannot be held ---------------------------------------------------------------------


@pytest.mark.parametrize("name", ["c.cameramodel", "c.xml", "model"])
def test_tilts_are_refused_where_the_format_lacks_them(tmp_path, name):
    with pytest.raises(ValueError, match=r"cannot hold sensor tilts; expected zeros, got tilt_x 0.01"):
        write_camera(tmp_path / name, Camera((640, 480), 900.0, tilt_x=0.01))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["c.cameramodel", "model", "c.yml"])
def test_shear_is_refused_where_the_format_or_its_program_lacks_it(tmp_path, name):
    with pytest.raises(ValueError, match=r"cannot hold a shear; expected zero, got 0.001"):
        write_camera(tmp_path / name, Camera((640, 480), 900.0, shear=0.001))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["c.txt", "c.xml"])
def test_poses_are_refused_where_the_format_lacks_them(tmp_path, name):
    with pytest.raises(ValueError, match="holds no pose"):
        write_camera(tmp_path / name, CAMERA, POSE, unit="mm")


def test_choosing_from_a_file_of_one_camera(tmp_path):
    write_camera(tmp_path / "c.xml", CAMERA)
    with pytest.raises(FileError, match="not a COLMAP model, so there is no 'left' to choose"):
        read_camera(tmp_path / "c.xml", which="left")


@pytest.mark.parametrize("name", ["c.yml", "c.cameramodel", "c.xml", "cameras.txt"])
def test_empty_files(tmp_path, name):
    (tmp_path / name).write_text("\n")
    with pytest.raises(FileError, match="the file is empty"):
        read_camera(tmp_path / name)


def test_a_folder_without_a_model(tmp_path):
    with pytest.raises(FileError, match=r"a folder without cameras\.txt; expected .* \(binary models: colmap"):
        read_camera(tmp_path)


TEXTS = {"c.yml": {}, "cv.json": {"format": "opencv"}, "c.cameramodel": {}, "c.xml": {}, "m": {},
         "c.txt": {"pixel_mm": 0.0074}}  # fmt: skip
JUNK = ("nan", "inf", "-1", "0", "1e400", "1e300", '"x"', "[", "]", "{", "}", ",", "\n", "<a>", "#", "'", "9" * 40, ":")


@pytest.mark.parametrize("name", TEXTS)
def test_damaged_files_are_read_or_refused_but_never_crash(tmp_path, name):
    write_camera(tmp_path / name, CAMERA, **TEXTS[name])
    file = tmp_path / "m" / "cameras.txt" if name == "m" else tmp_path / name
    text, rng = file.read_text(), np.random.default_rng(4)
    refused = 0
    for _ in range(60):
        first, length = rng.integers(len(text)), rng.integers(12)
        junk = JUNK[rng.integers(len(JUNK))]
        file.write_text(text[:first] + junk + text[first + length :])
        try:
            read_camera(tmp_path / name)
        except FileError as error:
            refused += str(file.parent) in str(error)
    assert refused > 15


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"K": [[1600, 0, 480], [0, 1600, 300], [0, 0, 1]]}, "'K': another value than camera_matrix has"),
        ({"dist": [0.1, 0, 0, 0, 0]}, "'dist': another value than distortion_coefficients has"),
        ({"image_size": [480, 300]}, "'image_size': (480, 300) beside image_width and image_height of (960, 600)"),
        ({"rvec": [180, 30, 2], "tvec": [0, 0, 900]}, "'rvec': a turn by 182.5 radians"),
        ({"distortion_model": "plumb_bob", "camera_type": "KANNALA_BRANDT8"}, "'camera_type': 'KANNALA_BRANDT8'"),
        ({"K": [[1500, 0, 480], [0, 1500, 300], [0, 0, 1]], "type": "Basler", "R": np.eye(3).tolist(),
          "rvec": [0, 0, 0], "tvec": [0, 0, 9]}, ""),
    ],
)  # fmt: skip
def test_an_opencv_file_that_contradicts_itself_is_refused(tmp_path, more, said):
    content = {
        "image_width": 960, "image_height": 600, "camera_matrix": [[1500, 0, 480], [0, 1500, 300], [0, 0, 1]],
        "distortion_coefficients": [0, 0, 0, 0, 0],
    }  # fmt: skip
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(content | more))
    if not said:
        assert read_camera(path)[0].focal_px == 1500
        return
    with pytest.raises(FileError, match=re.escape(said)):
        read_camera_file(path)


@pytest.mark.parametrize("key", ["camera_type: KANNALA_BRANDT8", "model: fisheye", "calibration_type: Fisheye"])
def test_other_programs_words_for_a_fisheye_lens(tmp_path, key):
    path = tmp_path / "camera.yml"
    write_camera(path, Camera((960, 600), 500.0, k1=0.1))
    text = path.read_text().replace("[ 0.1, 0.0, 0.0, 0.0, 0.0 ]", "[ 0.1, 0.0, 0.0, 0.0 ]")
    path.write_text(text.replace("cols: 5", "cols: 4") + f"{key}\n")
    assert read_camera_file(path).camera.lens == "fisheye"


@pytest.mark.parametrize(("name", "tag"), [("c.xml", "f"), ("cv.xml", "image_width")])
def test_an_element_that_is_there_twice_is_refused(tmp_path, name, tag):
    path = tmp_path / name
    if name == "c.xml":
        write_camera(path, Camera((960, 600), 1500.0))
    else:
        path.write_text("<opencv_storage><image_width>960</image_width></opencv_storage>")
    text = path.read_text()
    element = re.search(f"<{tag}>.*?</{tag}>", text)[0]
    path.write_text(text.replace(element, element + element.replace("5", "6").replace("96", "97")))
    with pytest.raises(FileError, match=f"<{tag}> is there 2 times"):
        read_camera_file(path)
