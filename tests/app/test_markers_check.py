"""`windmark markers check` as a user runs it."""

import csv

import numpy as np
import pytest
from PIL import Image

import windmark as wm
from windmark.app import markers_pictures
from windmark.app.sphere_maps import Disc, discs
from windmark.geometry import Camera
from windmark.io import write_camera, write_markers
from windmark.scene import MarkerSet
from windmark.tasks.marker_check import Change, CheckSettings, Proposal, advice, check_markers
from windmark.tasks.marker_check.settings import direction_of, spread_directions

UP = np.array([0.0, 0.0, 1.0])
FRONT = ("--view-from", "0,90", "--within", 35, "--views", 36)


def sheet(irregular: bool) -> MarkerSet:
    """20 markers on a flat sheet: a regular grid, or one that is shaken by a fifth of its pitch."""
    xyz = np.stack(np.meshgrid(np.arange(5) * 40.0, np.arange(4) * 40.0, [0.0]), axis=-1).reshape(-1, 3)
    if irregular:
        xyz[:, :2] += np.random.default_rng(3).normal(0, 8, (20, 2))
    return MarkerSet.make([f"P{i:02d}" for i in range(20)], xyz, normal=np.tile(UP, (20, 1)), radius=2.0)


@pytest.fixture
def table(tmp_path):
    def write(irregular=True):
        write_markers(tmp_path / "markers.csv", sheet(irregular))
        return tmp_path / "markers.csv"

    return write


@pytest.mark.parametrize("far", [1e300, 1e150, 1e19])
def test_coordinates_that_nothing_can_be_reckoned_with_are_no_fault(windmark, tmp_path, far):
    """They ended it in a figure that matplotlib could not draw, or in a pose that was not finite: exit code 3."""
    markers = sheet(irregular=True)
    markers.xyz[3, 1] = far
    write_markers(tmp_path / "far.csv", markers)
    done = windmark("markers", "check", tmp_path / "far.csv", "--unit", "mm", "-o", tmp_path / "out")
    assert done.code == 2
    assert f"far.csv: line 5: y is '{far!r}'; expected a finite number of at most 1e+18" in done.err
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_good_layout_is_said_to_be_good_and_everything_is_written(windmark, table, tmp_path):
    out = tmp_path / "out"
    done = windmark("markers", "check", table(), "--unit", "mm", *FRONT, "-o", out)
    assert done.code == 0, done.err
    lines = done.out.splitlines()
    assert lines[0].startswith("markers.csv: 20 markers, identifiable: 100.0 % of 36 views identified, none wrongly")
    assert "  nothing to change" in lines
    assert lines[-1] == f"report: {out / 'check.html'}"
    assert {p.name for p in out.iterdir()} == {
        "check.html", "summary.json", "directions.csv", "directions.png", "pose.png", "layout.png", "manifest.json",
    }  # fmt: skip
    page = (out / "check.html").read_text()
    assert page.count('src="data:image/') == 3
    assert "http" not in page
    with open(out / "directions.csv") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 12
    assert all(float(row["identified"]) == 1 and int(row["views"]) == 3 for row in rows)
    assert all(0 < float(row["sigma_surface_px"]) < 0.2 for row in rows)
    for name in ("directions.png", "pose.png", "layout.png"):
        with Image.open(out / name) as picture:
            assert min(picture.size) > 400
            assert np.ptp(np.asarray(picture.convert("L"))) > 200


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_regular_sheet_is_refused_with_a_layout_that_passes(windmark, table, tmp_path, monkeypatch):
    # The whole of it: tests/tasks/test_marker_check.py.
    for name, value in (("VERIFIED", 24), ("TRIED", 10), ("RIVALS", 12), ("DRAWN", 64)):
        monkeypatch.setattr(advice, name, value)
    out = tmp_path / "out"
    done = windmark("markers", "check", table(irregular=False), "--unit", "mm", *FRONT[:-1], 24, "-o", out, "--json")
    assert done.code == 1
    assert "not identifiable: 0.0 % of" in done.err
    record = done.json
    assert record["identifiable"] is False
    assert record["symmetries"][0]["motion"] == "half a turn about the axis (0, 0, 1)"
    assert record["symmetries"][0]["pairs"]["P00"] == "P19"
    proposal = record["proposals"][0]
    assert proposal["identified_before"] == 0
    assert proposal["identified_after"] >= 0.98
    assert proposal["wrong_after"] == 0
    proposed, given = wm.read_markers(out / "markers-proposed.csv"), sheet(irregular=False)
    for change in proposal["changes"]:
        k = proposed.name.tolist().index(change["marker"])
        np.testing.assert_allclose(proposed.xyz[k], change["to"])
        assert change["words"].startswith(change["kind"])
    kept = ~np.isin(given.name, [c["marker"] for c in proposal["changes"]])
    np.testing.assert_array_equal(proposed.xyz[:20][kept], given.xyz[kept])


@pytest.mark.usefixtures("undrawn")
def test_options_reach_the_check(windmark, table, tmp_path):
    write_camera(tmp_path / "camera.json", Camera((800, 600), 1500.0))
    record = windmark(
        "markers", "check", table(), "--unit", "in", "-c", tmp_path / "camera.json", "--view-from", "30,60",
        "--within", 20, "--views", 24, "--hidden", 10, "--false", 20, "--noise-px", 0.1, "--no-advice", "--seed", 4,
        "-o", tmp_path / "out", "--json",
    ).json  # fmt: skip
    assert record["camera"] == {"size_px": [800, 600], "focal_px": 1500.0}
    assert record["length_unit"] == "in"
    wanted = {"view_from": [30.0, 60.0], "within_deg": 20.0, "views": 24, "hidden_percent": 10.0, "seed": 4,
              "false_percent": 20.0, "noise_px": 0.1, "advise": False}  # fmt: skip
    assert {key: record["settings"][key] for key in wanted} == wanted


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_grid_and_roles_of_a_whole_test(windmark, virtual_test, tmp_path):
    folder, _ = virtual_test
    done = windmark("markers", "check", folder / "markers.csv", "--unit", "mm", "-c", folder / "camera.json", "-g",
                    folder / "model.grid", "--role", "model", "--view-from", "0,90", "--within", 8, "--views", 24,
                    "-o", tmp_path / "out", "--json")  # fmt: skip
    assert done.code == 0, done.err
    assert done.json["markers"] == 34
    # Those below the wing and under the body are hidden.
    rows = list(csv.DictReader((tmp_path / "out" / "directions.csv").read_text().splitlines()))
    assert {row["in_sight"] for row in rows} == {"29"}


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("--view-from", "up"), "--view-from"), (("--view-from", "0,95"), "view_from"), (("--views", 5), "views"),
        (("--unit", "furlong"), "--unit"), (("--camera", "missing.json"), "missing.json"),
        (("--role", "rivet"), "roles"),
    ],
)  # fmt: skip
def test_wrong_usage_is_named_and_nothing_is_written(windmark, table, tmp_path, arguments, word):
    done = windmark("markers", "check", table(), "--unit", "mm", "-o", tmp_path / "out", *arguments)
    assert done.code == 2
    assert word in done.err
    assert not (tmp_path / "out").exists()


def test_a_table_that_is_none(windmark, tmp_path):
    (tmp_path / "bad.csv").write_text("name,x,y\nA,1,2\n")
    done = windmark("markers", "check", tmp_path / "bad.csv", "--unit", "mm", "-o", tmp_path / "out")
    assert done.code == 2
    assert "bad.csv" in done.err


def test_the_layout_picture_shows_partners_and_new_places():
    settings = CheckSettings(view_from=(0, 90), within_deg=30, views=24, advise=False)
    check = check_markers(sheet(irregular=False), "mm", settings=settings)
    old = check.stage.markers.xyz[7]
    changes = (
        Change("P07", old + np.array([9.0, 5, 0]), UP, old, ("P08",)),
        Change("NEW01", old + np.array([20.0, 0, 0]), UP, None, ("P07", "P08")),
    )  # fmt: skip
    check.proposals.append(Proposal(changes, 0.0, 1.0, (0.5, 1.0), check.campaign, check.stage))
    face, side = markers_pictures.layout_picture(check).axes
    onto = check.symmetries[0].onto
    links = {tuple(map(tuple, line.get_xydata())) for line in face.lines if len(line.get_xydata()) == 2}
    xyz = check.stage.markers.xyz
    assert {(tuple(xyz[i, :2]), tuple(xyz[onto[i], :2])) for i in range(20)} <= links
    new = {tuple(line.get_xydata()[0]) for line in face.lines if len(line.get_xydata()) == 1}
    assert {tuple(change.place[:2]) for change in changes} <= new
    assert "NEW01" in [text.get_text() for text in face.texts]
    assert face.get_xlabel() == "x, mm"
    assert side.get_ylabel() == "z, mm"


@pytest.mark.parametrize("settings", [CheckSettings(), CheckSettings(view_from=(200, 10), within_deg=60)])
def test_maps_are_equal_area_and_their_raster_is_their_inverse(settings):
    for disc in discs(settings):
        np.testing.assert_allclose(np.cross(disc.right, disc.up), disc.middle, atol=1e-12)
        pixel, on = disc.raster()
        side = np.linspace(-disc.radius, disc.radius, on.shape[0])
        place = disc.place(pixel[on])
        np.testing.assert_allclose(place, np.stack(np.meshgrid(side, side), axis=-1)[on], atol=1e-9)
        # As many of evenly spread directions in each half of the disc's area.
        spread = spread_directions(4000, disc.middle, disc.reach_deg)
        inner = np.linalg.norm(disc.place(spread), axis=1) < disc.radius / np.sqrt(2)
        assert inner.mean() == pytest.approx(0.5, abs=0.01)
        assert disc.within(spread).all()


def test_a_direction_is_where_its_labels_say():
    above, below = discs(CheckSettings())
    np.testing.assert_allclose(above.place(direction_of(90, 0)), [0, np.sqrt(2)], atol=1e-12)
    np.testing.assert_allclose(below.place(direction_of(90, 0)), [0, -np.sqrt(2)], atol=1e-12)
    assert isinstance(above, Disc)


def test_help_has_an_example(windmark):
    done = windmark("markers", "check", "--help")
    assert done.code == 0
    assert "Example: windmark markers check" in done.out


@pytest.mark.parametrize("x", ["1", "1e-320"])
def test_markers_at_one_place_are_bad_data_and_no_fault(windmark, tmp_path, x):
    rows = "".join(f"m{k},{x},{x},{x}\n" for k in range(20))
    (tmp_path / "m.csv").write_text(f"name,x,y,z\n{rows}")
    done = windmark("markers", "check", tmp_path / "m.csv", "--unit", "mm", "-o", tmp_path / "out")
    assert done.code == 2, done.err
    assert "they are all at one place" in done.err


def test_without_its_pictures_the_check_is_there(windmark, table, tmp_path, no_pictures):
    done = windmark("markers", "check", table(), "--unit", "mm", *FRONT, "-o", tmp_path / "out", "--json")
    no_pictures(done, 3, tmp_path / "out" / "check.html")
    assert (tmp_path / "out" / "directions.csv").exists()
