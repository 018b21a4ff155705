"""`windmark pov --label`: three markers leave poses, a fourth decides, a wrong one leaves none."""

import numpy as np
import pytest

from windmark import io
from windmark.geometry import Camera, Pose
from windmark.scene import MarkerSet

CAMERA = Camera((1280, 800), 1500.0, k1=-0.05)
POSE = Pose.look_at([100.0, 200, 1500], [200, 300, 0], [0, 1, 0])
XYZ = np.array([[0.0, 100, 0], [420, 80, 10], [180, 520, -20], [330, 380, 60]])


@pytest.fixture
def case(tmp_path):
    io.write_camera(tmp_path / "camera.json", CAMERA)
    io.write_markers(tmp_path / "markers.csv", MarkerSet.make(["A", "B", "C", "D"], XYZ))
    xy = CAMERA.project(POSE.apply(XYZ))[0]
    labels = [f"{name}={x:.4f},{y:.4f}" for name, (x, y) in zip("ABCD", xy, strict=True)]
    return tmp_path, labels


def call(windmark, case, labels, *more):
    options = [w for label in labels for w in ("--label", label)]
    place = case[0]
    return windmark("pov", place / "camera.json", "-m", place / "markers.csv", "--unit", "mm", *options, *more)


def test_three_list_and_a_fourth_decides(windmark, case):
    three = call(windmark, case, case[1][:3], "--json")
    assert three.code == 0
    assert not three.json["decided"]
    assert len(three.json["candidates"]) >= 2
    four = call(windmark, case, case[1], "--json", "-o", case[0] / "found.json")
    assert four.code == 0
    assert four.json["decided"]
    assert four.json["candidates"][0]["further"][0]["residual_px"] < 0.01
    assert np.degrees(io.read_camera(case[0] / "found.json")[1].angle_to(POSE)) < 1e-3
    said = call(windmark, case, case[1]).out
    assert "D decides: pose 1" in said
    assert "D off by" in said


def test_a_wrong_label_is_a_no_and_nothing_is_written(windmark, case):
    wrong = [*case[1][:3], "D=100,100"]
    done = call(windmark, case, wrong, "-o", case[0] / "found.json")
    assert done.code == 1
    assert "wrong label" in done.err
    assert not (case[0] / "found.json").exists()
    undecided = call(windmark, case, case[1][:3], "-o", case[0] / "found.json")
    assert undecided.code == 1
    assert "next: give a fourth --label" in undecided.err


def test_wrong_usage(windmark, case):
    for labels, more, words in (
        (case[1][:2], (), "got 2"), (["A=1"], (), "NAME=x,y"), ([*case[1][:3], "Z=1,2"], (), "no marker Z"),
        (case[1], ("--rx", 3), "no numbers"),
    ):  # fmt: skip
        done = call(windmark, case, labels, *more)
        assert done.code == 2
        assert words in done.err
    flat = windmark("pov", case[0] / "camera.json", "--label", "A=1,2", "--unit", "mm")
    assert flat.code == 2
    assert "--markers" in flat.err
