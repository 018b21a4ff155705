"""`windmark epipolar`, `windmark simulate --photos` and frames without primaries, as a user runs them."""

import csv
import json

import numpy as np
import pytest

from windmark import io
from windmark.geometry.two_view import epipolar_distance
from windmark.pipeline.simulate_photos import CLICKED, simulate_photos


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    folder = tmp_path_factory.mktemp("photos")
    simulate_photos(folder, 1, 2)
    return folder


def rows(path):
    with open(path, newline="") as stream:
        return list(csv.DictReader(line for line in stream if not line.startswith("#")))


def truth(photos):
    """The markers' true images in both pictures, and which way the second camera is from the first."""
    markers = io.read_markers(photos / "truth" / "markers.csv")
    cams = [io.read_camera(photos / "truth" / "poses" / f"P0{k}.json") for k in (1, 2)]
    return [c.project(p.apply(markers.xyz))[0] for c, p in cams], cams


def run(windmark, photos, clicks, out, *more):
    two = [photos / "photos" / f"P0{k}.tif" for k in (1, 2)]
    return windmark("epipolar", *two, "--matches", clicks, "--radius", "2.7", "-o", out, *more, "--json")


def wrong_matches(photos, table):
    """How many matches of a table are two markers."""
    images, _ = truth(photos)
    xy = np.array([[float(r[c]) for c in ("x_a", "y_a", "x_b", "y_b")] for r in table])
    near = [np.linalg.norm(p[:, None] - t[None], axis=2).argmin(axis=1)
            for p, t in zip((xy[:, :2], xy[:, 2:]), images, strict=True)]  # fmt: skip
    return int((near[0] != near[1]).sum())


@pytest.mark.slow
def test_a_few_clicks_and_a_camera_match_the_pictures(windmark, photos, tmp_path):
    done = run(windmark, photos, photos / "clicks.csv", tmp_path / "out", "-c", photos / "camera.json")
    assert done.code == 0
    assert done.json["wrong_clicks"] == [str(CLICKED)]
    table = rows(tmp_path / "out" / "matches.csv")
    assert len(table) == done.json["matches"] > 60
    assert wrong_matches(photos, table) == 0
    _, ((camera, a), (_, b)) = truth(photos)
    xy = np.array([[float(r[c]) for c in ("x_a", "y_a", "x_b", "y_b")] for r in table])
    off = epipolar_distance(xy[:, :2], xy[:, 2:], camera, camera, b @ a.inverse()).sampson_px
    assert np.sqrt((off**2).mean()) < 0.1
    assert (tmp_path / "out" / "epipolar.png").stat().st_size > 50_000
    assert json.loads((tmp_path / "out" / "geometry.json").read_text())["determined"] is True
    clicked = rows(tmp_path / "out" / "clicks.csv")
    assert [r["wrong"] for r in clicked] == ["0"] * (CLICKED - 1) + ["1"]
    html = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert done.json["not_drawn"] == []
    assert 'data-verdict="good"' in html
    assert html.count('<figure class="wm-photo">') == 2
    assert html.count('class="wm-scene"') == 1
    assert "wrong click (1)" in html
    assert str(photos) not in html
    again = run(windmark, photos, tmp_path / "out" / "labels.csv", tmp_path / "again", "-c", photos / "camera.json")
    assert again.code == 0
    assert again.json["wrong_clicks"] == []


@pytest.mark.slow
def test_without_a_camera_there_is_the_fundamental_matrix_and_no_further_match(windmark, photos, tmp_path):
    done = run(windmark, photos, photos / "clicks.csv", tmp_path / "out")
    assert done.code == 0
    assert done.json["wrong_clicks"] == [str(CLICKED)]
    assert np.linalg.matrix_rank(np.array(done.json["fundamental"]), tol=1e-9) == 2
    assert np.linalg.matrix_rank(np.array(done.json["fundamental_cov"]), tol=1e-25) >= 7
    html = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert done.json["not_drawn"] == []
    assert html.count('<figure class="wm-photo">') == 2
    assert 'class="wm-scene"' not in html  # two pictures without a camera have no places in space
    table = rows(tmp_path / "out" / "matches.csv")
    assert len(table) == done.json["matches"] == done.json["by_hand"] == CLICKED - 1
    assert wrong_matches(photos, table) == 0
    clicked = rows(tmp_path / "out" / "clicks.csv")
    assert [r["name"] for r in clicked if r["checked"] == "0"] == [*done.json["unchecked_clicks"], str(CLICKED)]
    assert 0 < len(done.json["unchecked_clicks"]) < CLICKED - 1
    assert all(float(r["shows_px"]) <= 10 for r in clicked if r["checked"] == "1")
    assert any("unchecked" in note for note in done.json["notes"])
    said = windmark("epipolar", *[photos / "photos" / f"P0{k}.tif" for k in (1, 2)], "--matches", photos / "clicks.csv",
                    "--radius", "2.7", "-o", tmp_path / "said")  # fmt: skip
    assert "only with --camera" in said.out


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_names_of_the_user_stay_in_the_labels(windmark, photos, tmp_path):
    table = rows(photos / "clicks.csv")[:-1]
    text = "name,x_a,y_a,x_b,y_b\n" + "".join(
        f"{'m002' if k else 'tip'}{'' if k < 2 else k},{r['x_a']},{r['y_a']},{r['x_b']},{r['y_b']}\n"
        for k, r in enumerate(table)
    )
    (tmp_path / "named.csv").write_text(text)
    done = run(windmark, photos, tmp_path / "named.csv", tmp_path / "out", "-c", photos / "camera.json")
    assert done.code == 0
    label = [r["name"] for r in rows(tmp_path / "out" / "labels.csv") if r["image"] == "P01"]
    assert {"tip", "m002", "m0022", "m001"} <= set(label)
    assert len(set(label)) == len(label) == done.json["matches"]


@pytest.mark.parametrize(
    ("text", "code", "message"),
    [
        ("x_a,y_a,x_b,y_b\n1,2,3\n", 2, "line 2"),
        ("x_a,y_a,x_b,y_b\n1,2,,4\n", 2, "a place is missing"),
        ("x_a,y_a,x_b,y_b\n1,2,x,4\n", 2, "'x'"),
        ("image,name,x,y\nP09,a,1,2\n", 2, "'P09' is none of P01, P02"),
        ("image,name,x,y\nP01,a,1,2\nP01,a,3,4\n", 2, "a is there before"),
        ("image,name,x,y\nP01,a,1,2\nP02,b,3,4\n", 2, "no name is in both"),
        ("name,x\na,1\n", 2, "has no column image"),
        ("name,x_a,y_a,x_b,y_b\na,1,2,3,4\na,5,6,7,8\n", 2, "the name a is there before"),
        ("x_a,y_a,x_b,y_b\n", 1, "0 matches"),
    ],
)
def test_bad_tables_are_refused(windmark, photos, tmp_path, text, code, message):
    (tmp_path / "clicks.csv").write_text(text)
    done = run(windmark, photos, tmp_path / "clicks.csv", tmp_path / "out", "-c", photos / "camera.json")
    assert done.code == code, done.err
    assert message in done.err
    assert not (tmp_path / "out").exists()


def test_pictures_that_are_exchanged_are_refused(windmark, photos, tmp_path):
    table = rows(photos / "clicks.csv")
    swapped = "x_a,y_a,x_b,y_b\n" + "\n".join(f"{r['x_b']},{r['y_b']},{r['x_a']},{r['y_a']}" for r in table)
    (tmp_path / "clicks.csv").write_text(swapped + "\n")
    done = run(windmark, photos, tmp_path / "clicks.csv", tmp_path / "out", "-c", photos / "camera.json")
    assert done.code in (1, 2)


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_two_pictures_with_poses_say_frame_unit_and_sigma(windmark, photos, tmp_path):
    two = [photos / "photos" / f"P0{k}.tif" for k in (1, 2)]
    common = ("reconstruct", *two, "-c", photos / "camera.json", "--radius", "2.7", "--poses",
              photos / "truth" / "poses")  # fmt: skip
    done = windmark(*common, "--free-frame", "--unit", "mm", "-o", tmp_path / "posed", "--json")
    assert done.code == 0
    assert "given poses" in done.json["frame"]
    assert done.json["length_unit"] == "mm"
    markers = io.read_markers(tmp_path / "posed" / "markers.csv")
    true = io.read_markers(photos / "truth" / "markers.csv")
    gap = np.linalg.norm(markers.xyz[:, None] - true.xyz[None], axis=2).min(axis=1)
    assert np.median(gap) < 0.6  # the rendered grid is coarse: markers lie on its facets
    assert gap.max() < 3
    known = windmark(*common, "-p", photos / "primary.csv", "--unit", "mm", "-o", tmp_path / "known")
    assert known.code == 0
    assert "1 sigma of 0.0" in known.out
    assert "their table gives none" in known.out
    assert "their table gives none" in (tmp_path / "known" / "report.html").read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_free_scale_is_in_every_header(windmark, photos, tmp_path):
    two = [photos / "photos" / f"P0{k}.tif" for k in (1, 2)]
    common = ("reconstruct", *two, "-c", photos / "camera.json", "--radius", "2.7", "--free-frame")
    labels = _labels(windmark, photos, tmp_path)
    done = windmark(*common, "--labels", labels, "-o", tmp_path / "free", "--json")
    assert done.code == 0, done.err
    assert done.json["length_unit"] == "free"
    assert (tmp_path / "free" / "markers.csv").read_text().startswith("# length_unit: free")
    assert json.loads((tmp_path / "free" / "poses.json").read_text())["length_unit"] == "free"
    assert json.loads((tmp_path / "free" / "views" / "P01.json").read_text())["length_unit"] == "free"
    assert "length_unit: free" in (tmp_path / "free" / "report.html").read_text(encoding="utf-8")
    posed = windmark(*common, "--unit", "mm", "--poses", tmp_path / "free" / "views", "-o", tmp_path / "no")
    assert posed.code == 2  # lengths without a unit are not taken for millimetres
    assert "'free'" in posed.err


def _labels(windmark, photos, tmp_path):
    """Matches of the two pictures as labels."""
    done = run(windmark, photos, photos / "clicks.csv", tmp_path / "epi", "-c", photos / "camera.json")
    assert done.code == 0
    return tmp_path / "epi" / "labels.csv"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ((), "give --primary"),
        (("--free-frame", "-p", "p.csv"), "one of the two"),
        (("--free-frame", "--unit", "mm"), "the scale is free"),
        (("--free-frame", "--distance", "A,B,10,0.1", "--unit", "mm"), "--labels must say where"),
        (("-p", "p.csv", "--unit", "mm", "--distance", "A,B,10,0.1"), "is for --free-frame"),
        (("-p", "p.csv"), "--unit must be one of"),
    ],
)
def test_options_that_do_not_fit(windmark, photos, options, message):
    done = windmark("reconstruct", photos / "photos" / "P01.tif", "-c", photos / "camera.json", *options)
    assert done.code == 2
    assert message in done.err


def test_simulate_refuses_what_makes_no_sense(windmark, tmp_path):
    assert windmark("simulate", tmp_path / "a", "--photos", "1").code == 2
    assert windmark("simulate", tmp_path / "a", "--photos", "4", "--deforming", "5").code == 2
    assert windmark("simulate", tmp_path / "a", "--clocks").code == 2
