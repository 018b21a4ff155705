"""The main job with a rig: images of one instant registered together, and what is said of it."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest
from test_packing import page_text

from windmark import io
from windmark.pipeline.simulate_cameras import simulate_cameras

pytestmark = pytest.mark.usefixtures("all_undrawn")

CAMERAS = ("cam1", "cam2", "cam3")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Three cameras, small pictures; a project without a grid."""
    folder = tmp_path_factory.mktemp("rig")
    test = simulate_cameras(folder, 3, 3, size_px=(800, 640), nodes=4000)
    text = (folder / "project.toml").read_text(encoding="utf-8")
    grid, detect, merge = (text.index(part) for part in ("[grid]", "[detect]", "# All images of one time point"))
    (folder / "project.toml").write_text(text[:grid] + text[detect:merge], encoding="utf-8")
    return folder, test


@pytest.fixture
def copy(made, tmp_path):
    """A copy of the test that may be spoilt."""
    folder = tmp_path / "rig"
    shutil.copytree(made[0], folder, ignore=shutil.ignore_patterns("results"))
    return folder


def edit(folder, old, new):
    text = (folder / "project.toml").read_text(encoding="utf-8")
    assert old in text
    (folder / "project.toml").write_text(text.replace(old, new), encoding="utf-8")


def spoil(folder, camera, change):
    path = folder / f"{camera}.tif"
    image = io.read_image(path)
    io.write_image(path, change(image).astype(image.dtype))


def off_px(folder, camera, test):
    """Largest distance of a marker's image by the pose found from that by the true one."""
    found, truth = io.read_camera(folder / "results" / camera / "camera.json"), test.cam_from_tunnel[camera]
    markers = test.markers.xyz[test.markers.role == "model"]
    (there, _), (true, _) = (found[0].project(pose.apply(markers)) for pose in (found[1], truth))
    return np.linalg.norm(there - true, axis=1).max()


def images(done):
    return {i["name"]: i for i in done.json["images"]}


@pytest.mark.slow
def test_all_cameras_of_an_instant_are_one(made, windmark):
    folder, test = made
    done = windmark("run", folder / "project.toml", "--json")
    assert done.code == 0, done.err
    (instant,) = done.json["instants"]
    assert instant["cameras"] == list(CAMERAS)
    assert instant["registered"]
    assert instant["left_out"] == {}
    for k, name in enumerate(CAMERAS):
        record = images(done)[name]["registration"]
        assert record["matched"] == instant["matched"][k] > 20
        assert record["log10_nfa"] == instant["log10_nfa"]
        assert off_px(folder, name, test) < 0.05
        # The scale is open to one camera only.
        assert "scale" not in [u["what"] for u in record["unchecked"]]
    rotation = np.array(instant["rig_from_model"]["rotation"])
    np.testing.assert_allclose(rotation, test.cam_from_tunnel["cam1"].rotation, atol=1e-4)
    page = (folder / "results" / "report.html").read_text(encoding="utf-8")
    assert "Registered together with the other cameras of the rig" in page


def test_the_cameras_files_may_say_where_they_are(copy, made, windmark):
    test = made[1]
    edit(copy, 'file = "rig.json"', "")
    for name in CAMERAS:
        camera = io.read_camera(copy / f"{name}.json")[0]
        io.write_camera(copy / f"{name}.json", camera, test.cam_from_tunnel[name], unit="mm")
    done = windmark("run", copy / "project.toml", "--json")
    assert done.code == 0, done.err
    assert done.json["instants"][0]["registered"]
    pose = done.json["instants"][0]["rig_from_model"]
    np.testing.assert_allclose(pose["rotation"], np.eye(3), atol=1e-4)  # they are those of the tunnel
    np.testing.assert_allclose(pose["translation"], np.zeros(3), atol=0.1)
    page = (copy / "results" / "report.html").read_text(encoding="utf-8")
    assert "(at most its place in the rig is used)" in page


def test_a_camera_that_sees_no_marker_has_no_pose_unless_it_is_trusted(copy, made, windmark):
    spoil(copy, "cam2", lambda image: np.full_like(image, 300))
    done = windmark("run", copy / "project.toml", "--json")
    assert "nothing checks that it is where the rig says" in images(done)["cam2"]["problem"]
    assert not (copy / "results" / "cam2" / "camera.json").exists()
    assert images(done)["cam1"]["problem"] is None
    edit(copy, "[rig]", '[rig]\ntrust = ["cam2"]')
    done = windmark("run", copy / "project.toml")
    assert "cam2: 0 of 0 spots are markers" in done.out
    assert "unchecked: whether its camera is where the rig says (0 of its spots are markers)" in done.out
    page = page_text(copy / "results" / "report.html")
    assert "This picture cannot tell:</p><ul><li>whether its camera is where the rig says" in page
    assert off_px(copy, "cam2", made[1]) < 0.1


@pytest.mark.slow
def test_a_camera_that_is_elsewhere_is_named(copy, windmark):
    rig = json.loads((copy / "rig.json").read_text())
    rig["cam_from_rig"]["cam3"]["translation"][0] += 15
    (copy / "rig.json").write_text(json.dumps(rig))
    done = windmark("run", copy / "project.toml", "--json")
    assert done.json["failed"] == ["cam3"]
    assert images(done)["cam3"]["problem"].startswith("left out, it contradicts cam1 and cam2")
    assert done.json["instants"][0]["cameras"] == ["cam1", "cam2"]
    edit(copy, "[rig]", '[rig]\ncameras = ["cam1", "cam3"]')
    done = windmark("run", copy / "project.toml", "--json")  # of two nobody knows which; the third is alone
    assert done.json["failed"] == ["cam1", "cam3"]
    assert "not registered together with cam3" in images(done)["cam1"]["problem"]
    assert "which of them is wrong is not clear" in images(done)["cam3"]["problem"]


def test_bright_markers_where_dark_ones_give_no_pose(copy, windmark):
    for name in CAMERAS:
        spoil(copy, name, lambda image: 4095 - image)
    done = windmark("run", copy / "project.toml", "--json")
    assert done.json["failed"] == []
    assert {i["polarity"] for i in done.json["images"]} == {"bright"}


def test_an_image_that_cannot_be_read_stops_no_other(copy, windmark):
    io.write_image(copy / "cam1.tif", np.zeros((20, 30), np.uint16))
    edit(copy, 'file = "cam2.tif"', 'file = "cam2.tif"\nlabels = { W01 = [1, 1] }')
    edit(copy, "[rig]", '[rig]\ntrust = ["cam1", "cam2"]')
    done = windmark("run", copy / "project.toml", "--json")
    assert "is 30 x 20 pixels" in images(done)["cam1"]["problem"]
    assert "label W01: no spot within" in images(done)["cam2"]["problem"]
    assert images(done)["cam3"]["problem"] is None
    assert done.json["failed"] == ["cam1", "cam2"]


@pytest.mark.parametrize("change", ["unit", "name", "pose"])
def test_a_rig_that_says_too_little_is_refused(copy, windmark, change):
    path = copy / "rig.json"
    if change == "unit":
        path.write_text(path.read_text().replace('"mm"', '"in"'))
        words = "its poses are in in, length_unit of"
    elif change == "name":
        path.write_text(path.read_text().replace('"cam3"', '"third"'))
        words = "has no camera cam3; it has cam1, cam2, third"
    else:
        edit(copy, 'file = "rig.json"', "")
        words = "cam1.json: has no pose; expected where the camera is in the rig"
    done = windmark("run", copy / "project.toml")
    assert done.code == 2
    assert words in done.err
    assert not (copy / "results").exists()


def test_labels_that_are_facts(made, copy, windmark):
    """A wrong label is a contradiction; as a fact it is never overruled, and nothing fits it."""
    folder, test = made
    first = io.read_camera(folder / "cam1.json")[0]
    markers = test.markers
    names, xyz = markers.name.tolist(), markers.xyz
    spot, _ = first.project(test.cam_from_tunnel["cam1"].apply(xyz[names.index("W05")]))
    common = ("register", folder / "cam1.tif", "-m", folder / "markers.csv", "-c", folder / "cam1.json", "-r", "2.5",
              "--unit", "mm", "--roles", "model", "-o", copy / "out", "--json")  # fmt: skip
    right = windmark(*common, "--label", f"W05={spot[0]},{spot[1]}", "--binding")
    assert right.code == 0, right.err
    assert "W05" in right.json["images"][0]["registration"]["labels"]
    assert [u["what"] for u in right.json["images"][0]["registration"]["unchecked"]].count("scale") == 1
    wrong = [windmark(*common, "--label", f"W20={spot[0]},{spot[1]}", *more) for more in ((), ("--binding",))]
    assert [w.code for w in wrong] == [1, 1]
    causes = [w.json["images"][0]["registration"]["cause"] for w in wrong]
    assert causes[0] == "labels"
    assert causes[1] != "labels"
    assert windmark(*common, "--binding").code == 2
