"""Camera files: exact round trips, other programs' formats, and a clear word for what does not fit."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from windmark.geometry import PARAMETERS, Camera, Pose
from windmark.geometry.camera import LENS_PARAMETERS
from windmark.io import FileError, atomic, read_camera, read_camera_file, write_camera
from windmark.io.cameras.opencv_text import parse_yaml

CAMERA = Camera(
    (1280, 800), 1370.4, 1.0001, 643.8, 373.8, k1=-0.08, k2=0.011, p1=1e-4, p2=-2e-5, k3=1e-3, tilt_x=0.01, tilt_y=-0.02
)
POSE = Pose.from_rotvec([0.1, -2.9, 0.3], [3.8, 0.52, 11.5])


def small(x):
    return st.floats(-x, x)


cameras = st.builds(
    Camera,
    size_px=st.tuples(st.integers(1, 20000), st.integers(1, 20000)),
    focal_px=st.floats(1, 1e6),
    aspect=st.floats(0.5, 2),
    cx=small(1e4), cy=small(1e4), k1=small(1), k2=small(1), p1=small(0.1), p2=small(0.1), k3=small(1),
    tilt_x=small(0.5), tilt_y=small(0.5),
)  # fmt: skip
POV_KEYS = ("rx_deg", "ry_deg", "rz_deg", "dx", "dy", "dz")
poses = st.builds(
    Pose.from_rotvec, st.tuples(small(3), small(3), small(3)), st.tuples(small(1e4), small(1e4), small(1e4))
)


def same_camera(a, b):
    assert a.size_px == b.size_px
    np.testing.assert_array_equal(a.parameters(), b.parameters())


@given(camera=cameras, pose=poses, unit=st.sampled_from(["in", "ft", "mm", "cm", "m"]))
def test_own_format_gives_back_every_bit(one_folder, camera, pose, unit):
    path = one_folder / "c.json"
    write_camera(path, camera, pose, unit=unit)
    again = read_camera_file(path)
    same_camera(again.camera, camera)
    np.testing.assert_array_equal(again.cam_from_model.rotation, pose.rotation)
    np.testing.assert_array_equal(again.cam_from_model.translation, pose.translation)
    assert (again.length_unit, again.format) == (unit, "windmark")


@pytest.mark.parametrize("size", [11, 15])
def test_a_sheared_camera_comes_back(tmp_path, size):
    root = np.random.default_rng(1).normal(size=(size, size))
    sheared = replace(CAMERA, shear=-2.3e-4, cov=root @ root.T)
    write_camera(tmp_path / "c.json", sheared)
    again = read_camera(tmp_path / "c.json")[0]
    assert again.parameters().tolist() == sheared.parameters().tolist()
    # k4 to k6 have no place beside Brown's lens.
    own = [k for k, p in enumerate(PARAMETERS) if p in LENS_PARAMETERS["brown"]]
    np.testing.assert_array_equal(again.cov[np.ix_(own, own)], sheared.cov[np.ix_(own, own)])


def test_a_skew_in_a_camera_matrix_is_a_shear(tmp_path):
    """As MATLAB and Kalibr have it: [u v 1] = K [x y 1]."""
    (tmp_path / "c.yml").write_text(PLAIN_YAML.replace("- - 900.0\n  - 0.0", "- - 900.0\n  - 0.3"))
    camera = read_camera(tmp_path / "c.yml")[0]
    assert camera.shear == 0.3 / 900
    ideal = replace(camera, k1=0.0, k2=0.0, p1=0.0, p2=0.0, k3=0.0)
    point = np.array([0.2, -0.1, 1.0])
    np.testing.assert_allclose(ideal.project(point)[0], (ideal.matrix @ point)[:2], rtol=1e-14)
    assert ideal.matrix[0, 1] == pytest.approx(0.3)


def test_covariance_and_no_pose(tmp_path):
    cov = np.random.default_rng(0).normal(size=(11, 11))
    cov[3, :] = cov[:, 3] = np.nan  # not determined
    write_camera(tmp_path / "c.json", CAMERA.with_parameters(CAMERA.parameters(), cov))
    camera, pose = read_camera(tmp_path / "c.json")
    np.testing.assert_array_equal(camera.cov[:11, :11], cov)
    assert not camera.cov[11:].any()
    assert pose is None


@given(camera=cameras, pose=poses)
def test_opencv_yaml_round_trip(one_folder, camera, pose):
    path = one_folder / "c.yml"
    write_camera(path, camera, pose, unit="mm")
    again = read_camera_file(path)
    assert again.camera.size_px == camera.size_px
    np.testing.assert_allclose(again.camera.parameters(), camera.parameters(), rtol=1e-15)
    np.testing.assert_allclose(again.cam_from_model.rotation, pose.rotation, atol=1e-13)
    np.testing.assert_array_equal(again.cam_from_model.translation, pose.translation)
    assert (again.length_unit, again.format) == ("mm", "opencv")


def test_writing_is_explicit(tmp_path):
    with pytest.raises(ValueError, match="unit must say the length unit of the pose, got None"):
        write_camera(tmp_path / "c.json", CAMERA, POSE)
    with pytest.raises(ValueError, match="unit must be one of in, ft, mm, cm, m, got 'inch'"):
        write_camera(tmp_path / "c.json", CAMERA, POSE, unit="inch")
    with pytest.raises(ValueError, match=r"must end in \.json \(windmark\), \.yml \(opencv\).*; got .*c\.cam"):
        write_camera(tmp_path / "c.cam", CAMERA)
    with pytest.raises(ValueError, match=r"format must be one of windmark, opencv, colmap, .*, got 'nasa'"):
        write_camera(tmp_path / "c.json", CAMERA, format="nasa")
    with pytest.raises(ValueError, match=r"single one, got a batch \(2,\)"):
        write_camera(tmp_path / "c.json", CAMERA, Pose.exp(np.zeros((2, 6))), unit="in")
    assert not list(tmp_path.iterdir())


def test_interrupted_writing_leaves_the_old_camera(tmp_path, monkeypatch):
    path = tmp_path / "c.json"
    write_camera(path, CAMERA)
    before = path.read_bytes()
    monkeypatch.setattr(atomic.os, "replace", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        write_camera(path, CAMERA, POSE, unit="in")
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["c.json"]


def test_unit_and_size_expected_by_the_caller(tmp_path):
    path = tmp_path / "c.json"
    write_camera(path, CAMERA, POSE, unit="in")
    read_camera(path, unit="in", size_px=(1280, 800))
    with pytest.raises(FileError, match="key 'length_unit': 'in'; expected 'mm'"):
        read_camera(path, unit="mm")
    with pytest.raises(FileError, match=r"a camera of \(1280, 800\) px; expected \(640, 400\)"):
        read_camera(path, size_px=(640, 400))
    with pytest.raises(ValueError, match="unit must be one of"):
        read_camera(path, unit="inches")


# --- own JSON, edited by hand ----------------------------------------------------------------


@pytest.fixture
def edited(tmp_path):
    def edit(change):
        path = tmp_path / "c.json"
        write_camera(path, CAMERA, POSE, unit="in")
        content = json.loads(path.read_text())
        change(content)
        path.write_text(json.dumps(content))
        return path

    return edit


def set_key(*keys, to):
    def change(content):
        for key in keys[:-1]:
            content = content[key]
        content[keys[-1]] = to

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (set_key("focal", to=1), "key 'focal': unknown key; known are windmark, version, size_px, focal_px"),
        (set_key("cam_from_model", "rvec", to=[0, 0, 0]), r"key 'cam_from_model\.rvec': unknown key"),
        (set_key("cam_from_model", "pov", "fov", to=1), r"key 'cam_from_model\.pov\.fov': unknown key"),
        (set_key("windmark", to="registration"), "key 'windmark': 'registration'; expected 'camera'"),
        (set_key("version", to=2), "key 'version': 2; this windmark reads version 1"),
        (lambda c: (c.pop("focal_px"), c["cam_from_model"]["pov"].pop("fov_deg")), "key 'focal_px': missing"),
        (lambda c: c.pop("size_px"), "key 'size_px': missing"),
        (set_key("focal_px", to="1370"), "key 'focal_px': not finite numbers; expected a finite number"),
        (set_key("focal_px", to=[1370]), "key 'focal_px': the shape is"),
        (set_key("focal_px", to=None), "key 'focal_px': not finite"),
        (set_key("focal_px", to=-1), "focal_px and aspect must be > 0"),
        (set_key("k1", to=True), "key 'k1': not finite numbers"),
        (set_key("size_px", to=[1280.5, 800]), "key 'size_px': .* is no image size"),
        (set_key("size_px", to=[1280]), r"key 'size_px': the shape is \(1,\)"),
        (set_key("length_unit", to="inch"), "key 'length_unit': 'inch'; expected one of in, ft, mm, cm, m"),
        (lambda c: c.pop("length_unit"), "key 'length_unit': missing, and the pose has lengths"),
        (set_key("cam_from_model", "rotation", to=np.diag([1, 1, -1]).tolist()), "rotation is mirrored"),
        (
            set_key("cam_from_model", "rotation", to=(np.eye(3) * 1e9).tolist()),
            "not a rotation; expected an orthonormal",
        ),
        (set_key("cam_from_model", "rotation", to=(np.eye(3) * 1e300).tolist()), r"1e\+300 is too large; expected"),
        (set_key("focal_px", to=1e19), r"'focal_px': 1e\+19 is too large; expected a finite number of at most 1e\+18"),
        (set_key("cam_from_model", "rotation", to=[[1, 0], [0, 1]]), r"the shape is \(2, 2\); expected 3 x 3"),
        (set_key("cam_from_model", "translation", to=[1, 2, "3"]), r"key 'cam_from_model\.translation'"),
        (set_key("cam_from_model", "pov", "fov_deg", to=0), r"pov\.fov_deg': 0; expected an angle between 0 and 180"),
        (set_key("cam_from_model", "pov", "fov_deg", to=180), r"pov\.fov_deg': 180; expected an angle between"),
        (set_key("cam_from_model", "pov", "rx_deg", to=None), r"pov\.rx_deg': not finite numbers; expected a finite"),
        (set_key("cam_from_model", "covariance", to=[1, 2]), r"cam_from_model\.covariance': the shape is \(2,\)"),
        (set_key("as_written", to={"pose": 3}), "key 'as_written': unusable; expected texts named focal, fov"),
        (lambda c: c["cam_from_model"].pop("rotation"), "incomplete, translation alone; expected rotation and"),
        (set_key("cam_from_model", to={}), "incomplete; expected rotation and translation, or pov"),
        (set_key("cam_from_model", to=[1, 2]), "key 'cam_from_model': not an object"),
        (set_key("covariance", to={"matrix": []}), r"covariance\.parameters': expected names out of focal_px"),
        (set_key("covariance", to={"parameters": ["k1", "k1"], "matrix": [[1, 0], [0, 1]]}), "each once"),
    ],
)
def test_faults_of_own_format(edited, change, message):
    with pytest.raises(FileError, match=message):
        read_camera(edited(change))


def test_a_point_of_view_typed_by_hand(edited):
    def change(content):
        pov = content["cam_from_model"]["pov"]
        del pov["fov_deg"]
        content["cam_from_model"] = {"pov": pov}
        content["note"] = "from the drawing"

    _, pose = read_camera(edited(change))
    np.testing.assert_allclose(pose.rotation, POSE.rotation, atol=1e-14)
    np.testing.assert_allclose(pose.translation, POSE.translation)
    with pytest.raises(FileError, match=r"cam_from_model\.pov\.dz': missing"):
        read_camera(edited(set_key("cam_from_model", to={"pov": dict.fromkeys(POV_KEYS[:5], 0)})))


TURNED = Pose.from_rotvec([0.2, -2.8, 0.1], [3.0, 0.5, 12.0])


def pov_of(pose):
    return {k: v for k, v in vars(pose.to_pov()).items() if k != "fov_deg"}


def both_poses(content):
    content["cam_from_model"]["rotation"] = TURNED.rotation.tolist()
    content["cam_from_model"]["pov"]["dx"] = 4.5


def rounded(content):
    """As a program does that keeps seven digits."""
    place = content["cam_from_model"]
    place["rotation"] = [[float(f"{v:.9g}") for v in row] for row in place["rotation"]]
    place["pov"] |= {k: float(f"{v:.9g}") for k, v in place["pov"].items()}
    content["focal_px"] += 1e-5


def test_an_edited_pose_or_point_of_view_is_taken_and_said(edited):
    content = read_camera_file(edited(lambda c: c["cam_from_model"]["pov"].update(pov_of(TURNED))))
    np.testing.assert_allclose(content.cam_from_model.rotation, TURNED.rotation, atol=1e-14)
    assert "the numbers of pov were edited" in content.note
    content = read_camera_file(edited(set_key("cam_from_model", "translation", to=[1, 2, 3])))
    assert content.cam_from_model.translation.tolist() == [1, 2, 3]
    assert "rotation or translation was edited" in content.note
    tiny = POSE.to_pov().rx_deg + 1e-9  # less than any tolerance
    content = read_camera_file(edited(set_key("cam_from_model", "pov", "rx_deg", to=tiny)))
    assert content.cam_from_model.to_pov().rx_deg == pytest.approx(tiny, abs=1e-12)
    assert content.cam_from_model.to_pov().rx_deg != pytest.approx(POSE.to_pov().rx_deg, abs=5e-10)
    untouched = read_camera_file(edited(rounded))
    assert untouched.note == ""
    np.testing.assert_allclose(untouched.cam_from_model.translation, POSE.translation, rtol=1e-8)


def test_an_edited_field_of_view_or_focal_length_is_taken_and_said(edited):
    content = read_camera_file(edited(set_key("cam_from_model", "pov", "fov_deg", to=20)))
    assert content.camera.fov_deg == pytest.approx(20)
    assert "fov_deg was edited: it is taken (20 deg), not focal_px (1370.4 px)" in content.note
    np.testing.assert_array_equal(content.cam_from_model.rotation, POSE.rotation)
    content = read_camera_file(edited(set_key("focal_px", to=2000.0)))
    assert content.camera.focal_px == 2000
    assert "focal_px or size_px was edited" in content.note
    content = read_camera_file(edited(lambda c: c.pop("focal_px")))
    assert content.camera.focal_px == pytest.approx(CAMERA.focal_px)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (both_poses, r"'cam_from_model\.pov': another pose \(rx_deg .*dx 4\.5.*\) than rotation and .* \(rx_deg"),
        (
            lambda c: (c.pop("as_written"), c["cam_from_model"]["pov"].update(dx=4.5)),
            "another pose .* expected the same one, or only one of the two",
        ),
        (
            lambda c: (c.pop("as_written"), c.update(focal_px=1371.0)),
            r"fov_deg': 50\.06.*, which is a focal length of 1370\.4 px, but focal_px is 1371",
        ),
        (
            lambda c: (c.update(focal_px=1371.0), c["cam_from_model"]["pov"].update(fov_deg=20.0)),
            "which is a focal length of .* px, but focal_px is 1371",
        ),
    ],
)
def test_two_poses_or_focal_lengths_that_disagree_are_refused_with_both_values(edited, change, message):
    with pytest.raises(FileError, match=message):
        read_camera(edited(change))


def test_the_covariance_of_a_pose_is_kept_until_the_pose_is_edited(tmp_path):
    cov = np.diag([1e-8, 2e-8, 3e-8, 1e-4, 2e-4, 3e-4])
    path = tmp_path / "c.json"
    write_camera(path, CAMERA, POSE, unit="mm", pose_cov=cov)
    np.testing.assert_array_equal(read_camera_file(path).pose_cov, cov)
    content = json.loads(path.read_text())
    content["cam_from_model"]["pov"]["dx"] = 0.0
    path.write_text(json.dumps(content))
    assert read_camera_file(path).pose_cov is None
    with pytest.raises(ValueError, match=r"pose_cov must be \(6, 6\)"):
        write_camera(path, CAMERA, POSE, unit="mm", pose_cov=cov[:3, :3])


def test_left_out_parameters_have_their_natural_value(tmp_path):
    (tmp_path / "c.json").write_text('{"windmark": "camera", "version": 1, "size_px": [640, 480], "focal_px": 900}')
    camera, pose = read_camera(tmp_path / "c.json")
    same_camera(camera, Camera((640, 480), 900.0))
    assert pose is None


def test_names_of_parameters_carry_their_units(tmp_path):
    write_camera(tmp_path / "c.json", CAMERA)
    keys = list(json.loads((tmp_path / "c.json").read_text()))
    named = {"cx": "cx_px", "cy": "cy_px", "tilt_x": "tilt_x_rad", "tilt_y": "tilt_y_rad"}
    expected = [named.get(p, p) for p in PARAMETERS[:11]]
    assert keys == ["windmark", "version", "size_px", *expected]


# --- other programs --------------------------------------------------------------------------

OPENCV_YAML = """%YAML:1.0
---
calibration_time: "Fri 01 Mar 2024: #7"
image_width: 640
image_height: 480
# camera_matrix: in a comment
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 900., 0., 3.2e+02, 0.,
       901., 240., 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -0.1, 0.01, 1e-3,
       -2e-3, 0. ]
per_view: { a:1, b:[ 2, .Nan ], c: "x, y" }
list:
   - 1
   - { q: 2 }
   - k: 3
     l: it's
- stray
"""
OPENCV_YAML = OPENCV_YAML.replace("- stray\n", "")

ROS_YAML = """image_width: 640
image_height: 480
camera_name: narrow
camera_matrix:
  rows: 3
  cols: 3
  data: [900, 0, 320, 0, 901, 240, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.1, 0.01, 0.001, -0.002, 0]}
projection_matrix:
  rows: 3
  cols: 4
  data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]
"""

PLAIN_YAML = """K:
- - 900.0
  - 0.0
  - 320.0
- [0.0, 901.0, 240.0]
- [0, 0, 1]
dist: [-0.1, 0.01, 0.001, -0.002]
image_size: [640, 480]
"""

PLAIN_JSON = """{"cameraMatrix": [[900, 0, 320], [0, 901, 240], [0, 0, 1]],
// a comment as OpenCV writes it
"distCoeffs": [[-0.1, 0.01, 0.001, -0.002, 0, 0, 0, 0]], "image_width": 640, "image_height": 480}"""

OPENCV_XML = """<?xml version="1.0"?>
<opencv_storage>
<image_width>640</image_width><image_height>480</image_height>
<camera_matrix type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt>
  <data>900. 0. 320. 0. 901. 240. 0. 0. 1.</data></camera_matrix>
<distortion_coefficients type_id="opencv-matrix"><rows>1</rows><cols>4</cols><dt>d</dt>
  <data>-0.1 0.01 0.001 -0.002</data></distortion_coefficients>
</opencv_storage>
"""


@pytest.mark.parametrize("text", [OPENCV_YAML, ROS_YAML, PLAIN_YAML, PLAIN_JSON, OPENCV_XML])
def test_opencv_and_ros(tmp_path, text):
    path = tmp_path / "camera.txt"  # the content tells the format
    path.write_text(text)
    camera, pose = read_camera(path)
    same_camera(camera, Camera((640, 480), 900.0, 901 / 900, 320.0, 240.0, k1=-0.1, k2=0.01, p1=0.001, p2=-0.002))
    assert pose is None


def test_yaml_values():
    content = parse_yaml("f", OPENCV_YAML)
    assert content["calibration_time"] == "Fri 01 Mar 2024: #7"
    assert content["per_view"]["a"] == 1
    assert np.isnan(content["per_view"]["b"][1])
    assert content["per_view"]["c"] == "x, y"
    assert content["list"] == [1, {"q": 2}, {"k": 3, "l": "it's"}]


@pytest.mark.parametrize("turn", ["rvec: [0.1, 0.2, 0.3]", "R: [{}]"])
def test_opencv_pose(tmp_path, turn):
    expected = Pose.from_rotvec([0.1, 0.2, 0.3], [1, 2, 3])
    rounded = ", ".join(f"{v:.5f}" for v in expected.rotation.ravel())
    (tmp_path / "c.yml").write_text(f"{PLAIN_YAML}{turn.format(rounded)}\ntvec:\n- [1]\n- [2]\n- [3]\n")
    pose = read_camera(tmp_path / "c.yml")[1]
    np.testing.assert_allclose(pose.rotation, expected.rotation, atol=1e-5)
    np.testing.assert_allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-14)
    assert pose.translation.tolist() == [1, 2, 3]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("- [0, 0, 1]", "- [0, 0, 2]", "key 'K': not a camera matrix"),
        ("- [0, 0, 1]", "", r"key 'K': the shape is \(2, 3\); expected 3 x 3"),
        ("901.0", "-901.0", "key 'K': the focal lengths are 900 and -901"),
        ("-0.002]", "-0.002, 0, 0, 0, 0, 0, 1, 0, 0]", "key 'dist': s2 not zero"),
        ("-0.002]", "-0.002, 0, 0]", "key 'dist': 6 coefficients; expected 4, 5, 8, 12 or 14"),
        ("-0.002]", "x]", "key 'dist': not numbers"),
        ("-0.002]", ".nan]", "key 'dist': not finite numbers"),
        ("image_size: [640, 480]\n", "", "no image size; expected the keys image_width and image_height"),
        ("dist: ", "fish: ", "no distortion coefficients; expected one of the keys distortion_coefficients"),
        ("K:", "matrix:", "not a camera file: it has matrix, dist, image_size"),
        ("image_size:", "distortion_model: mei\nimage_size:", "'mei'; expected plumb_bob"),
        ("image_size:", "xi: 0.9\nimage_size:", "key 'xi': 0.9: an omnidirectional lens"),
        ("-0.002]", "-0.002, 0]\nfisheye_model: 1", "key 'dist': 5 coefficients of a fisheye lens; expected 4"),
        ("image_size:", "rvec: [0, 0, 0]\nimage_size:", "key 'rvec': a rotation without a translation"),
        ("image_size:", "R: [2,0,0,0,2,0,0,0,2]\nT: [0,0,0]\nimage_size:", "key 'R': .*must be orthonormal"),
        ("dist: [", "dist: {rows: 2, cols: 4, data: [", "not closed"),
        ("dist: [", "dist: [[", "not closed"),
        ("dist: [-0.1,", "dist: [-0.1", "key 'dist'"),
        ("- [0, 0, 1]", "- [0, 0, 1]]", "line 6: not OpenCV YAML: something follows"),
        ("dist:", "  dist:", "not OpenCV YAML"),
        ("dist:", "K: 1\ndist:", "line 7: not OpenCV YAML: the key 'K' is there more than once"),
        ("dist:", "just words\ndist:", "line 7: not OpenCV YAML: expected 'key: value'"),
    ],
)
def test_faults_of_other_formats(tmp_path, old, new, message):
    assert old in PLAIN_YAML
    (tmp_path / "c.yml").write_text(PLAIN_YAML.replace(old, new))
    with pytest.raises(FileError, match=message):
        read_camera(tmp_path / "c.yml")


def test_tilted_sensor_of_opencv(tmp_path):
    (tmp_path / "c.yml").write_text(PLAIN_YAML.replace("-0.002]", "-0.002, 0,0,0,0, 0,0,0,0, 0.01,-0.02]"))
    camera, _ = read_camera(tmp_path / "c.yml")
    assert (camera.tilt_x, camera.tilt_y) == (0.01, -0.02)


def test_size_from_the_caller(tmp_path):
    (tmp_path / "c.yml").write_text(PLAIN_YAML.replace("image_size: [640, 480]\n", ""))
    assert read_camera(tmp_path / "c.yml", size_px=(640, 480))[0].size_px == (640, 480)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the file is empty"),
        ("hello\n", "not OpenCV YAML: expected 'key: value'"),
        ("{}", "not a camera file: it has ;|not a camera file: it has"),
        ("[1, 2]", "not a camera file: it has no keys"),
        ('{"a": 1', "line 1: not JSON"),
        ("<a>", "not XML"),
        ("<a/>", "the XML's root is <a>; expected OpenCV's <opencv_storage>"),
        ("<opencv_storage/>", "no camera matrix"),
        ("# only a comment\n", "expected keys and values"),
        ("- " * 200 + "1", "nested too deep"),
        ("a: " + "[" * 100_000, "not closed"),
        ("K: !!binary |\n  abcd\n", "packed"),
    ],
)
def test_not_a_camera(tmp_path, text, message):
    (tmp_path / "c").write_text(text)
    with pytest.raises(FileError, match=message):
        read_camera(tmp_path / "c")


# --- NASA --------------------------------------------------------------------------------------

NASA = {
    "uPSP_cameraMatrix": [[1370.4, 0, 3.8], [0, 1370.4, -26.2], [0, 0, 1]],
    "distCoeffs": [[-0.08, 0, 0, 0, 0]],
    "rmat": POSE.rotation.tolist(),
    "tvec": POSE.translation.tolist(),
    "sensor_resolution": [800, 1280, 1],
    "sensor_size": [0.88, 1.41],
}


def test_nasa(tmp_path):
    (tmp_path / "c.json").write_text(json.dumps(NASA))
    content = read_camera_file(tmp_path / "c.json")
    same_camera(content.camera, Camera((1280, 800), 1370.4, 1.0, 3.8 + 640, -26.2 + 400, k1=-0.08))
    np.testing.assert_allclose(content.cam_from_model.rotation, POSE.rotation, atol=1e-15)
    assert (content.length_unit, content.format) == (None, "nasa")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c.pop("tvec"), "key 'tvec': missing"),
        (lambda c: c.pop("sensor_resolution"), "no key sensor_resolution"),
        (set_key("sensor_resolution", to=[800]), r"key 'sensor_resolution': \[800\]; expected"),
        (set_key("sensor_resolution", to=[0, 1280]), "is no image size"),
        (set_key("uPSP_cameraMatrix", to=[[1, 0, 0], [0.1, 1, 0], [0, 0, 1]]), "not a camera matrix"),
        (set_key("rmat", to=np.diag([1, 1, -1]).tolist()), "key 'rmat': .*is mirrored"),
    ],
)
def test_faults_of_nasa_files(tmp_path, change, message):
    content = json.loads(json.dumps(NASA))
    change(content)
    (tmp_path / "c.json").write_text(json.dumps(content))
    with pytest.raises(FileError, match=message):
        read_camera(tmp_path / "c.json")


def test_nasa_size_from_the_caller(tmp_path):
    content = {k: v for k, v in NASA.items() if k != "sensor_resolution"}
    (tmp_path / "c.json").write_text(json.dumps(content))
    assert read_camera(tmp_path / "c.json", size_px=(1280, 800))[0].cx == 643.8


@pytest.mark.slow
@given(
    data=st.one_of(
        st.text(), st.builds(lambda a, b: PLAIN_YAML[:a] + b + PLAIN_YAML[a:], st.integers(0, 120), st.text())
    )
)
def test_any_text_gives_a_camera_or_a_file_error(one_folder, data):
    path = one_folder / "c.yml"
    path.write_text(data, encoding="utf-8", errors="replace")
    try:
        camera, _ = read_camera(path)
    except FileError:
        return
    assert np.isfinite(camera.parameters()).all()


def opencv_file(folder, matrix, size=(960, 600), **more):
    """An OpenCV camera as JSON, written by hand."""
    path = folder / "cv.json"
    path.write_text(json.dumps({"K": matrix, "dist": [0, 0, 0, 0, 0], "image_size": size, **more}))
    return path


@pytest.mark.parametrize(
    ("matrix", "size", "word"),
    [
        ([[16, 0, 2.4], [0, 16, 1.5], [0, 0, 1]], (960, 600), "a focal length of 16 px sees 177 degrees"),
        ([[1.6, 0, 0.5], [0, 1.6, 0.5], [0, 0, 1]], (960, 600), "parts of the width"),
        ([[1.5e7, 0, 4e5], [0, 1.5e7, 3e5], [0, 0, 1]], (960, 600), "as no lens does"),
        ([[1500, 0, 4800], [0, 1500, 300], [0, 0, 1]], (960, 600), "4800, 300 px, is outside of the picture"),
        ([[1500, 0, 480], [0, 1500, 300], [0, 0, 1]], (600, 960), "width and height of the size are exchanged"),
    ],
)
def test_numbers_that_are_hardly_pixels_are_said(tmp_path, matrix, size, word):
    content = read_camera_file(opencv_file(tmp_path, matrix, size))
    assert word in content.note
    assert content.camera.cx == matrix[0][2]  # taken all the same: a part that was cut out may have it


@pytest.mark.parametrize(
    "camera",
    [
        Camera((960, 600), 1500.0, cx=500.0, cy=310.0), Camera((1920, 1080), 900.0, k1=-0.3),
        Camera((960, 600), 280.0, lens="fisheye"), Camera((640, 640), 60000.0), Camera((480, 640), 700.0, cx=250.0),
        Camera((128, 128), 3000.0), Camera((1600, 400), 1500.0),
    ],
)  # fmt: skip
def test_real_cameras_are_not_doubted(tmp_path, camera):
    write_camera(tmp_path / "c.json", camera)
    assert read_camera_file(tmp_path / "c.json").note == ""


def test_a_size_with_height_before_width_is_named(tmp_path):
    matrix = [[1500, 0, 480], [0, 1500, 300], [0, 0, 1]]
    path = opencv_file(tmp_path, matrix, (600, 960), image_width=960, image_height=600)
    with pytest.raises(FileError, match=r"height before width; expected \(width, height\)"):
        read_camera_file(path)
    path = opencv_file(tmp_path, matrix, (960, 640), image_width=960, image_height=600)
    with pytest.raises(FileError, match="expected the same"):
        read_camera_file(path)
