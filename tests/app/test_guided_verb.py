"""`windmark detect --near` and `--camera --markers`: looking only where markers are expected."""

import numpy as np
import pytest

from windmark import io
from windmark.scene import Detections


@pytest.fixture
def posed(virtual_test, tmp_path):
    """The virtual test's folder and its camera with the pose of the first image, written to a file."""
    folder, test = virtual_test
    shot = test.shots[0]
    io.write_camera(tmp_path / "posed.json", test.cameras["cam1"], shot.perfect.cam_from_tunnel, unit="mm")
    return folder, test, tmp_path / "posed.json"


def near_truth(table, names, truth, markers):
    """Distance of every named spot to the true centre of its marker's ellipse."""
    index = [markers.name.tolist().index(name) for name in names]
    return np.hypot(*(table.xy - truth.ellipse_xy[index]).T)


def test_from_camera_and_markers_every_visible_marker_is_found_by_name(windmark, posed, tmp_path):
    folder, test, camera = posed
    truth = test.shots[0].perfect.markers
    done = windmark(
        "detect", folder / "wind-off.tif", "-c", camera, "-m", folder / "markers.csv", "-o", tmp_path / "d.csv",
        "--explain", tmp_path / "e.csv", "--picture", tmp_path / "p.png",
    )  # fmt: skip
    assert done.code == 0
    names = io.read_detection_names(tmp_path / "d.csv")["wind-off.tif"]
    wall = test.markers.role != "model"
    assert set(test.markers.name[truth.visible & wall]) <= set(names)
    error = near_truth(io.read_detections(tmp_path / "d.csv")["wind-off.tif"], names, truth, test.markers)
    fixed = np.isin(names, test.markers.name[wall])
    assert error[fixed].max() < 0.3
    assert not set(names) & set(test.markers.name[~truth.facing])
    header, *rows = (tmp_path / "e.csv").read_text().splitlines()
    assert header == "image,name,x,y,depth,depth_sigma,correlation,log10_nfa,reason"
    assert f"{len(names)} of {len(names) + len(rows)} expected markers" in done.out
    assert io.read_image(tmp_path / "p.png").std() > 5


def test_near_the_detections_of_a_frame_before(windmark, virtual_test, tmp_path):
    folder, _ = virtual_test
    windmark("detect", folder / "wind-off.tif", "-r", 4, "-o", tmp_path / "first.csv")
    record = windmark(
        "detect", folder / "wind-off.tif", "--near", tmp_path / "first.csv", "-o", tmp_path / "second.csv", "--json"
    ).json["images"]["wind-off.tif"]
    first = io.read_detections(tmp_path / "first.csv")["wind-off.tif"]
    assert record["expected"] == len(first)
    assert record["found"] >= 0.9 * len(first)
    assert set(record["answer"]) >= {"found"}
    second = io.read_detections(tmp_path / "second.csv")["wind-off.tif"]
    assert np.hypot(*(second.xy[:, None] - first.xy).transpose(2, 0, 1)).min(axis=1).max() < 0.6


def test_names_are_handed_on(windmark, posed, tmp_path):
    folder, _, camera = posed
    windmark("detect", folder / "wind-off.tif", "-c", camera, "-m", folder / "markers.csv", "-o", tmp_path / "a.csv")
    windmark("detect", folder / "wind-off.tif", "--near", tmp_path / "a.csv", "-o", tmp_path / "b.csv")
    names = [io.read_detection_names(tmp_path / f"{k}.csv")["wind-off.tif"] for k in "ab"]
    assert names[0] == names[1]


def test_what_cannot_be_used_is_said(windmark, posed, tmp_path):
    folder, _, camera = posed
    image = folder / "wind-off.tif"
    for options, word in (
        (("--near", tmp_path / "none.csv"), "none.csv"),
        (("--camera", camera), "belong together"),
        (("--near", camera, "--camera", camera, "--markers", folder / "markers.csv"), "either"),
        (("--camera", folder / "camera.json", "--markers", folder / "markers.csv"), "no pose"),
        (("--camera", camera, "--markers", folder / "markers.csv", "--merit-map", tmp_path / "m.png"), "merit-map"),
        (("--bayer", "RGB"), "bayer"),
        (("--channel", "red"), "without colours"),
    ):
        done = windmark("detect", image, "-o", tmp_path / "d.csv", *options)
        assert done.code == 2, options
        assert word in done.err
        assert not (tmp_path / "d.csv").exists()
    bare = Detections.make([[50.0, 50.0]])
    io.write_detections(tmp_path / "bare.csv", {"a.tif": bare, "b.tif": bare})
    assert "2 images" in windmark("detect", image, "--near", tmp_path / "bare.csv").err
    io.write_detections(tmp_path / "bare.csv", bare)
    assert "neither axes nor radius" in windmark("detect", image, "--near", tmp_path / "bare.csv").err


def test_none_found_is_an_answer(windmark, tmp_path):
    io.write_image(tmp_path / "flat.png", np.random.default_rng(0).integers(90, 99, (60, 60)).astype(np.uint8))
    io.write_detections(tmp_path / "near.csv", Detections.make([[30.0, 30.0]], radius_px=3.0))
    done = windmark("detect", tmp_path / "flat.png", "--near", tmp_path / "near.csv", "-o", tmp_path / "d.csv")
    assert done.code == 1
    assert "1 nothing there" in done.err


def test_a_raw_mosaic(windmark, tmp_path):
    """Neutral dots under red light on a Bayer sensor: detected where they are."""
    image = np.full((80, 80), 200.0)
    y, x = np.mgrid[:80, :80]
    for cx, cy in ((20.3, 20.0), (55.5, 24.2), (22.0, 57.7), (58.1, 60.4)):
        image *= 1 - 0.6 * np.clip(4.0 - np.hypot(x - cx, y - cy), 0, 1)
    image[::2, 1::2] *= 0.5
    image[1::2, ::2] *= 0.5
    image[1::2, 1::2] *= 0.3
    io.write_image(tmp_path / "raw.png", image.round().astype(np.uint8))
    done = windmark("detect", tmp_path / "raw.png", "-r", 3.5, "--bayer", "RGGB", "-o", tmp_path / "d.csv")
    assert done.code == 0
    xy = io.read_detections(tmp_path / "d.csv")["raw.png"].xy
    assert len(xy) == 4
    assert np.hypot(*(xy - [20.3, 20.0]).T).min() < 0.1
