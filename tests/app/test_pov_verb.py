"""`windmark pov`: printed, converted, compared and drawn, from a file, from numbers and from a direction."""

from __future__ import annotations

import numpy as np
import pytest

from windmark import io
from windmark.app.report import measured
from windmark.geometry import Camera, Pose, PoV

CAMERA = Camera((1280, 800), 1500.0, k1=-0.05)
POSE = Pose.look_at([100.0, 200, 1500], [200, 300, 0], [0, 1, 0])
NUMBERS = ("--rx", 180, "--ry", 0, "--rz", 0, "--dx", -200, "--dy", 300, "--dz", 2400, "--fov", 30)


@pytest.fixture
def file(tmp_path):
    io.write_camera(tmp_path / "c.json", CAMERA, POSE, unit="mm", pose_cov=np.diag([1e-8] * 3 + [1e-4] * 3))
    return tmp_path / "c.json"


def test_a_camera_file_in_figures_and_lines(windmark, file):
    done = windmark("pov", file, "--json")
    assert done.code == 0, done.err
    pov = POSE.to_pov(1500.0, 1280)
    assert done.json["pov"] == pytest.approx(vars(pov))
    np.testing.assert_allclose(done.json["station"], [100, 200, 1500])
    np.testing.assert_allclose(done.json["direction"], POSE.rotation[2])
    assert done.json["length_unit"] == "mm"
    assert done.json["sigma"]["ry_deg"] == pytest.approx(np.degrees(1e-4))
    lines = windmark("pov", file).out
    assert f"{measured(pov.dz, done.json['sigma']['dz'])[0]} mm  sigma" in lines
    assert "station in the model's frame: (100, 200, 1500) mm" in lines


def test_numbers_become_a_camera_file_of_any_format(windmark, tmp_path):
    for name in ("top.json", "top.yml", "top.cameramodel"):
        done = windmark("pov", *NUMBERS, "--size", "640x400", "--unit", "mm", "-o", tmp_path / name)
        assert done.code == 0, done.err
        camera, pose = io.read_camera(tmp_path / name)
        assert camera.fov_deg == pytest.approx(30)
        np.testing.assert_allclose(pose.center, [200, 300, 2400])
    again = windmark("pov", tmp_path / "top.json", "--json").json["pov"]
    assert again == pytest.approx(vars(PoV(180, 0, 0, -200, 300, 2400, 30)))


def test_numbers_replace_those_of_a_file_and_keep_its_lens(windmark, file, tmp_path):
    done = windmark("pov", file, "--dz", 900, "--fov", 20, "-o", tmp_path / "new.json", "--json")
    assert done.code == 0, done.err
    camera, pose = io.read_camera(tmp_path / "new.json")
    assert camera.fov_deg == pytest.approx(20)
    assert camera.k1 == CAMERA.k1
    np.testing.assert_allclose(pose.translation, [*POSE.translation[:2], 900])
    np.testing.assert_allclose(pose.rotation, POSE.rotation, atol=1e-14)
    assert done.json["sigma"] is None


def test_two_cameras_are_compared(windmark, file, tmp_path, virtual_test):
    turned = Pose.from_rotvec([0, 0, np.radians(2.0)], [0, 0, 0]) @ POSE
    moved = Pose(turned.rotation, -turned.rotation @ (POSE.center + np.array([3, 0, 4])))
    io.write_camera(tmp_path / "b.json", CAMERA, moved, unit="mm")
    done = windmark("pov", file, tmp_path / "b.json", "-m", virtual_test[0] / "markers.csv", "--json")
    assert done.code == 0, done.err
    off = done.json["difference"]
    assert off["angle_deg"] == pytest.approx(2.0)
    assert off["viewing_direction_deg"] == pytest.approx(0.0, abs=1e-5)  # a roll
    assert off["station_distance"] == pytest.approx(5.0)
    assert off["shift_px"]["largest"] > off["shift_px"]["rms"] > 1
    io.write_camera(tmp_path / "i.json", CAMERA, POSE, unit="in")
    done = windmark("pov", file, tmp_path / "i.json")
    assert done.code == 2
    assert "its pose is in in" in done.err
    assert "c.json is mm; expected the same" in done.err


def test_a_direction_frames_the_model_as_a_view_of_a_job_does(windmark, virtual_test, tmp_path):
    from windmark.pipeline.simulate import zones_of

    folder, test = virtual_test
    volumes = [a for n, z in zones_of(test.mesh).items() if n != "wall" for a in ("--volume", f"{n}={','.join(z)}")]
    picture = tmp_path / "p.png"
    done = windmark("pov", "--direction", "0,0,-1", "--up", "0,1,0", "-g", folder / "model.grid", *volumes,
                    "--unit", "mm", "--size", "300x200", "-o", tmp_path / "top.json", "--picture", picture,
                    "--json")  # fmt: skip
    assert done.code == 0, done.err
    seen = done.json["model"]
    assert seen["in_image"] == seen["points"] == seen["in_front"]
    assert io.read_image(picture).shape[2] >= 3
    used = np.isin(test.mesh.volume, ["wing", "body"])
    nodes = test.mesh.vertices[np.unique(test.mesh.triangles[used])]
    camera, pose = io.read_camera(tmp_path / "top.json")
    xy, _ = camera.project(pose.apply(nodes))
    assert xy.min() > 0
    assert (xy.max(axis=0) < [300, 200]).all()


@pytest.mark.parametrize(
    ("angles", "words"),
    [
        ((20, 90, 270), "only rz - rx is defined; rx = 0 is chosen"),
        ((20, -90, 10), "only rz + rx is defined"),
        ((20, 89.95, 10), "rx and rz turn about nearly one axis"),
        ((20, 110, 10), "rx, ry, rz = 20, 110, 10 deg are another name of the angles below"),
    ],
)
def test_singular_angles_are_said_and_kept(windmark, tmp_path, angles, words):
    options = [v for n, a in zip(("--rx", "--ry", "--rz"), angles, strict=True) for v in (n, a)]
    done = windmark("pov", *options, "--dx", 0, "--dy", 0, "--dz", 500, "--fov", 40, "--unit", "mm", "-o",
                    tmp_path / "s.json", "--picture", tmp_path / "s.png")  # fmt: skip
    assert done.code == 0, done.err
    assert words in done.out
    pose = io.read_camera(tmp_path / "s.json")[1]
    np.testing.assert_allclose(pose.rotation, PoV(*angles, 0, 0, 500).pose.rotation, atol=1e-14)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "expected a camera file, the numbers"),
        ((*NUMBERS[:-1], 0), "--fov must be between 0 and 180 degrees, got 0"),
        ((*NUMBERS[:-1], 180), "--fov must be between 0 and 180 degrees, got 180"),
        ((*NUMBERS[:-1], "nan"), "--fov must be a finite number"),
        (NUMBERS[:-2], "needs all seven numbers; missing: --fov"),
        ((*NUMBERS, "-o", "x.json"), "nothing says the length unit; give --unit"),
        ((*NUMBERS, "--unit", "furlong"), "--unit must be one of in, ft, mm, cm, m"),
        ((*NUMBERS, "--size", "big"), "--size must be WIDTHxHEIGHT"),
        (("{file}", "--unit", "in"), "its pose is in mm, --unit is in; expected the same"),
        (("{file}", "{file}", "{file}"), "expected one camera file, or two"),
        (("{file}", "--direction", "0,0,1", "--up", "0,1,0"), "--direction stands alone"),
        (("--direction", "0,0,1"), "--direction and --up belong together"),
        (("--direction", "0,0,1", "--up", "0,1,0"), "give its --grid or --markers"),
        (("--direction", "0,0,1", "--up", "0,0,2", "-m", "{markers}"), "up is parallel"),
        (("--direction", "0,0", "--up", "0,0,2", "-m", "{markers}"), "--direction: expected three numbers"),
        (("{file}", "--volume", "wing"), "--volume says what of the --grid"),
        (("{lens}",), "has no pose"),
        (("{text}",), "not a camera file"),
    ],
)
def test_what_is_no_point_of_view_is_refused(windmark, file, tmp_path, virtual_test, arguments, words):
    (tmp_path / "t.json").write_text("{}")
    known = {"file": file, "markers": virtual_test[0] / "markers.csv", "lens": virtual_test[0] / "camera.json",
             "text": tmp_path / "t.json"}  # fmt: skip
    done = windmark("pov", *(str(a).format(**known) for a in arguments))
    assert done.code == 2
    assert words in done.err


def test_a_model_behind_the_camera_is_said_and_drawn(windmark, virtual_test, tmp_path):
    numbers = [*NUMBERS]
    numbers[numbers.index("--dz") + 1] = -2400
    done = windmark("pov", *numbers, "-m", virtual_test[0] / "markers.csv", "--picture", tmp_path / "p.png", "--json")
    assert done.code == 0, done.err
    assert done.json["model"]["in_front"] == 0
    assert "whole model is behind" in windmark("pov", *numbers, "-m", virtual_test[0] / "markers.csv").out


def test_the_covariance_of_a_pose_goes_along_where_it_can(windmark, file, tmp_path):
    done = windmark("convert", file, tmp_path / "again.json")
    assert done.code == 0, done.err
    kept = io.read_camera_file(tmp_path / "again.json").pose_cov
    np.testing.assert_array_equal(kept, np.diag([1e-8] * 3 + [1e-4] * 3))
    done = windmark("convert", file, tmp_path / "metres.json", "--to-unit", "m")
    assert done.code == 0, done.err
    kept = io.read_camera_file(tmp_path / "metres.json").pose_cov
    np.testing.assert_allclose(np.diag(kept), [1e-8] * 3 + [1e-10] * 3)
    done = windmark("convert", file, tmp_path / "again.yml")
    assert "left out: the pose's covariance, which opencv cannot hold" in done.out
