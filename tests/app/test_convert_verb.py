"""`windmark convert`: cameras between programs."""

import json

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.io import read_camera_file, write_camera

CAMERA = Camera((1280, 800), 1370.4, 1.0, 643.8, 373.8, k1=-0.08, k2=0.011, p1=1e-4, p2=-2e-4)
POSE = Pose.from_rotvec([0.1, -0.9, 0.3], [3.8, 0.52, 11.5])


@pytest.fixture
def own(tmp_path):
    write_camera(tmp_path / "own.json", CAMERA, POSE, unit="in")
    return tmp_path / "own.json"


@pytest.mark.parametrize("name", ["c.yml", "c.cameramodel", "model"])
def test_there_and_back(windmark, own, tmp_path, name):
    done = windmark("convert", own, tmp_path / name)
    assert done.code == 0
    assert "own.json (windmark): 1280 x 800 px, focal length 1370.400 px, with pose" in done.out
    assert "read back, it shows the same rays within" in done.out
    record = windmark("convert", tmp_path / name, tmp_path / "again.json", "--unit", "in", "--json").json
    assert record["read_back_largest_px"] < 1e-9
    again = read_camera_file(tmp_path / "again.json")
    np.testing.assert_allclose(again.camera.parameters(), CAMERA.parameters(), rtol=1e-14)
    np.testing.assert_allclose(again.cam_from_model.rotation, POSE.rotation, atol=1e-14)
    assert again.length_unit == "in"


def test_opencv_json_by_name_of_the_format(windmark, own, tmp_path):
    assert windmark("convert", own, tmp_path / "cv.json", "--to", "opencv").code == 0
    assert read_camera_file(tmp_path / "cv.json").format == "opencv"


def test_backward_lens_says_its_misfit(windmark, own, tmp_path):
    done = windmark("convert", own, tmp_path / "c.txt", "--no-pose", "--pixel-mm", "0.0074")
    assert done.code == 0
    assert "left out: the pose, as asked for" in done.out
    done = windmark("convert", tmp_path / "c.txt", tmp_path / "again.json", "--from", "australis", "--json")
    assert done.json["notes"][0].startswith("lens refitted from a backward model: RMS")
    assert done.json["to"] == "windmark"


def test_the_covariance_is_missed(windmark, tmp_path):
    write_camera(tmp_path / "own.json", CAMERA.with_parameters(CAMERA.parameters(), np.eye(11)))
    done = windmark("convert", tmp_path / "own.json", tmp_path / "c.xml")
    assert "left out: the covariance, which metashape cannot hold" in done.out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["c.xml"], "metashape holds no pose"),
        (["c.txt", "--no-pose"], "pixel_mm must give the pixels' pitch"),
        (["c.dat"], "path must end in"),
        (["c.xml", "--to", "nasa"], "format must be one of"),
        (["c.xml", "--from", "colmap"], "this is windmark; expected colmap, as --from says"),
        (["c.xml", "--from", "cmap"], "--from must be one of windmark, opencv"),
        (["c.yml", "--unit", "mm"], "the length unit is in; expected mm, as --unit says"),
        (["c.yml", "--size", "1280"], "--size must be WIDTHxHEIGHT"),
        (["c.yml", "--size", "640x480"], "expected (640, 480), as --size says"),
        (["c.txt", *["--pixel-mm", "1"] * 3], "--pixel-mm must be given once, or for x and y"),
    ],
)
def test_refusals(windmark, own, tmp_path, arguments, message):
    done = windmark("convert", own, tmp_path / arguments[0], *arguments[1:])
    assert done.code == 2
    assert message in done.err
    assert [p.name for p in tmp_path.iterdir()] == ["own.json"]


def without_unit(windmark, own, path):
    """A file of mrcal's, which says no unit, as windmark writes it into a comment."""
    windmark("convert", own, path)
    assert read_camera_file(path).length_unit == "in"
    path.write_text(path.read_text().replace("; lengths in in", ""))
    assert read_camera_file(path).length_unit is None


def test_a_pose_without_a_unit(windmark, own, tmp_path):
    without_unit(windmark, own, tmp_path / "c.cameramodel")
    done = windmark("convert", tmp_path / "c.cameramodel", tmp_path / "c.json")
    assert done.code == 2
    assert "does not say the pose's length unit: give --unit, or --no-pose" in done.err


def test_a_pose_in_another_unit(windmark, own, tmp_path):
    done = windmark("convert", own, tmp_path / "mm.json", "--to-unit", "mm")
    assert "scaled by 25.4, into mm" in done.out
    again = read_camera_file(tmp_path / "mm.json")
    assert again.length_unit == "mm"
    np.testing.assert_allclose(again.cam_from_model.translation, 25.4 * POSE.translation, rtol=1e-15)
    without_unit(windmark, own, tmp_path / "c.cameramodel")
    done = windmark("convert", tmp_path / "c.cameramodel", tmp_path / "c.json", "--to-unit", "mm")
    assert done.code == 2
    assert "give --unit" in done.err


def test_a_camera_in_millimetres_is_doubtful(windmark, tmp_path):
    matrix, size = [[16, 0, 2.4], [0, 16, 1.5], [0, 0, 1]], [960, 600]
    (tmp_path / "mm.json").write_text(json.dumps({"K": matrix, "dist": [0, 0, 0, 0], "image_size": size}))
    done = windmark("convert", tmp_path / "mm.json", tmp_path / "c.json")
    assert done.code == 0
    assert done.out.count("sees 177 degrees across a picture of 960 x 600 px, as no lens does") == 2  # note, verdict
    assert "doubtful" in done.out
