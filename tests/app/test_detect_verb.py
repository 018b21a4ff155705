"""`windmark detect`: the options beyond the radius."""

import shutil

import numpy as np
import pytest

from windmark import io


@pytest.fixture
def shot(virtual_test):
    return virtual_test[0] / "wind-off.tif"


def spots(table):
    return next(iter(io.read_detections(table).values())).xy


def test_without_a_radius_it_says_what_it_took(windmark, shot, tmp_path):
    done = windmark("detect", shot, "-o", tmp_path / "d.csv")
    assert done.code == 0
    assert "radius taken" in done.out
    assert len(spots(tmp_path / "d.csv")) >= 25
    record = windmark("detect", shot, "-o", tmp_path / "d.csv", "--json").json["images"]["wind-off.tif"]
    assert "radius taken" in record["radius_estimate"]
    assert record["radius_px"]


def test_no_radius_prevails(windmark, tmp_path):
    io.write_image(tmp_path / "flat.png", np.full((40, 40), 9, np.uint8))
    done = windmark("detect", tmp_path / "flat.png", "-o", tmp_path / "d.csv", "--merit-map", tmp_path / "m.png")
    assert done.code == 1
    assert "no radius prevails" in done.err


def test_an_image_without_markers_has_a_reason(windmark, tmp_path):
    io.write_image(tmp_path / "flat.png", np.full((40, 40), 9, np.uint8))
    done = windmark("detect", tmp_path / "flat.png", "-r", 3, "-o", tmp_path / "d.csv")
    assert done.code == 1
    assert "no marker of radius 3 px (dark or bright) was found: all pixels that can be used are equal" in done.err
    noise = np.random.default_rng(0).integers(90, 110, (80, 80)).astype(np.uint8)
    io.write_image(tmp_path / "noise.png", noise)
    done = windmark("detect", tmp_path / "noise.png", "-r", 2, "-o", tmp_path / "d.csv", "--json")
    assert done.code == 1
    assert done.json["images"]["noise.png"]["why_none"]


@pytest.mark.slow
def test_explain_picture_and_merit_map(windmark, shot, tmp_path):
    done = windmark(
        "detect", shot, "-r", 4, "-o", tmp_path / "d.csv", "--explain", tmp_path / "e.csv",
        "--picture", tmp_path / "p.png", "--merit-map", tmp_path / "m.png",
    )  # fmt: skip
    assert done.code == 0
    lines = (tmp_path / "e.csv").read_text().splitlines()
    assert lines[0] == "image,x,y,radius,merit,depth,quality,reason"
    assert f"{len(lines) - 1} candidates rejected" in done.out
    for name in ("p.png", "m.png"):
        picture = io.read_image(tmp_path / name)
        assert min(picture.shape[:2]) > 300
        assert picture.std() > 5


def test_mask_and_region(windmark, shot, tmp_path):
    windmark("detect", shot, "-r", 4, "-o", tmp_path / "all.csv")
    every = spots(tmp_path / "all.csv")
    x0, y0 = np.quantile(every, 0.4, axis=0).astype(int)
    x1, y1 = every.max(axis=0).astype(int) + 20
    windmark("detect", shot, "-r", 4, "-o", tmp_path / "roi.csv", "--roi", f"{x0},{y0},{x1},{y1}")
    mask = np.zeros(io.read_grey(shot).shape, np.uint8)
    mask[y0 : y1 + 1, x0 : x1 + 1] = 255
    io.write_image(tmp_path / "mask.png", mask)
    windmark("detect", shot, "-r", 4, "-o", tmp_path / "mask.csv", "--mask", tmp_path / "mask.png")
    inside = spots(tmp_path / "roi.csv")
    np.testing.assert_array_equal(inside, spots(tmp_path / "mask.csv"))
    assert 0 < len(inside) < len(every)
    assert (inside > np.array([x0, y0]) - 2).all()


@pytest.mark.parametrize("roi", ["1,2,3", "a,b,c,d", "5,5,5,9", "-1,0,5,5", "100000,0,100010,5"])
def test_a_wrong_region_is_named(windmark, shot, tmp_path, roi):
    done = windmark("detect", shot, "-r", 4, "-o", tmp_path / "d.csv", f"--roi={roi}")
    assert done.code == 2
    assert "--roi" in done.err
    assert not list(tmp_path.iterdir())


def test_a_mask_of_another_size_is_named(windmark, shot, tmp_path):
    io.write_image(tmp_path / "mask.png", np.ones((10, 12), np.uint8))
    done = windmark("detect", shot, "-r", 4, "-o", tmp_path / "d.csv", "--mask", tmp_path / "mask.png")
    assert done.code == 2
    assert "12 x 10" in done.err


def test_the_mask_of_a_project(windmark, virtual_test, tmp_path):
    """Markers outside the mask of [detect] are not detected; a mask that is absent is named."""
    source, _ = virtual_test
    for name in ("camera.json", "markers.csv", "wind-off.tif"):
        shutil.copy(source / name, tmp_path / name)
    mask = np.ones(io.read_grey(source / "wind-off.tif").shape, np.uint8)
    mask[:, : mask.shape[1] // 3] = 0
    io.write_image(tmp_path / "mask.png", mask)
    (tmp_path / "project.toml").write_text(
        'title = "t"\nlength_unit = "mm"\n[[camera]]\nfile = "camera.json"\n[[image]]\nfile = "wind-off.tif"\n'
        '[markers]\nfile = "markers.csv"\n[detect]\nradius_px = 4\nmask = "mask.png"\n'
    )
    assert windmark("run", tmp_path / "project.toml").code == 0
    found = spots(tmp_path / "results" / "wind-off" / "detections.csv")
    assert len(found) >= 6
    assert found[:, 0].min() > mask.shape[1] // 3 - 2
    (tmp_path / "mask.png").unlink()
    done = windmark("run", tmp_path / "project.toml")
    assert done.code == 2
    assert "detect.mask" in done.err
