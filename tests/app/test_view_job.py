"""The viewer's work: what a click writes, what a run again changes, the grid and the picture from a point of view."""

import io as byte_io
import shutil
import time

import numpy as np
import pytest
from PIL import Image
from viewing import viewing

from windmark.app.viewer.pov import NUMBERS, camera_at
from windmark.geometry import Camera, PoV
from windmark.io import read_grey, write_camera
from windmark.pipeline.project import read_project

pytestmark = pytest.mark.slow

PROJECT = """\
# The one picture of this test.
title = "One <b>wing</b>"
length_unit = "mm"
[[camera]]
file = "camera.json"
[[image]]
file = "wind-off.tif"   # taken before the run
[markers]
file = "markers.csv"
roles = ["model"]
[grid]
file = "model.grid"
[detect]
radius_px = 4.0
"""


@pytest.fixture(scope="module")
def original(virtual_test, tmp_path_factory):
    folder = tmp_path_factory.mktemp("viewed")
    for name in ("camera.json", "wind-off.tif", "markers.csv", "model.grid"):
        shutil.copy(virtual_test[0] / name, folder)
    (folder / "project.toml").write_text(PROJECT)
    return folder / "project.toml"


@pytest.fixture(scope="module")
def module_viewer(original):
    with viewing(original) as client:
        assert client.state()["problem"] == ""
        yield client


@pytest.fixture
def viewer(module_viewer, original):
    """With the project as it was, and no edit."""
    original.write_text(PROJECT)
    module_viewer.session.edits = []
    return module_viewer


def matched(viewer):
    """Marker name -> spot."""
    (item,) = viewer.session.shown.result.images
    match, names = item.registered.matching, viewer.session.shown.result.markers.name
    return {str(names[m]): int(d) for m, d in zip(match.marker, match.detection, strict=True)}


def spare(viewer):
    (item,) = viewer.session.shown.result.images
    return next(k for k in range(len(item.detections)) if k not in matched(viewer).values())


def test_the_first_run_writes_nothing(viewer, original):
    assert viewer.session.shown.number == 1
    assert not (original.parent / "results").exists()
    _, page, _ = viewer.raw("GET", "/")
    assert b"nothing was written" in page
    assert b"One &lt;b&gt;wing&lt;/b&gt;" in page
    assert b"sigma " in page
    assert str(original.parent).encode() not in page
    assert viewer.server.token.encode() not in page


def test_a_name_is_written_and_comments_stay(viewer, original):
    name, spot = next(iter(matched(viewer).items()))
    status, said = viewer.ask("/name", image="wind-off", spot=spot, marker=name)
    assert status == 200
    assert said["edits"] == [f"wind-off: spot {spot} is {name}"]
    assert said["images"]["wind-off"] == {"labels": {name: spot}, "excluded": []}
    xy = viewer.session.shown.result.images[0].detections.xy[spot]
    np.testing.assert_allclose(read_project(original).image[0].labels[name], xy, atol=0.0051)
    text = original.read_text()
    assert [line for line in text.splitlines() if "labels" not in line] == PROJECT.splitlines()


def test_a_spot_has_one_meaning(viewer, original):
    spot = spare(viewer)
    one, other = list(matched(viewer))[:2]

    def entry():
        return read_project(original).image[0]

    assert viewer.ask("/name", image="wind-off", spot=spot, marker=one)[0] == 200
    assert viewer.ask("/name", image="wind-off", spot=spot, marker=other)[0] == 200
    assert list(entry().labels) == [other]
    status, said = viewer.ask("/exclude", image="wind-off", spot=spot)
    assert (status, said["images"]["wind-off"]) == (200, {"labels": {}, "excluded": [spot]})
    status, said = viewer.ask("/exclude", image="wind-off", spot=spot)
    assert (status, "already" in said["error"]) == (422, True)
    assert viewer.ask("/name", image="wind-off", spot=spot, marker=one)[0] == 200
    assert (list(entry().labels), entry().exclude) == ([one], ())
    home = matched(viewer)[one]
    assert viewer.ask("/name", image="wind-off", spot=home, marker=one)[1]["edits"][-1].endswith(
        f"spot {home} is {one}, which was spot {spot}"
    )
    assert list(entry().labels) == [one]
    assert viewer.ask("/name", image="wind-off", spot=spot, marker=one)[0] == 200
    assert viewer.ask("/free", image="wind-off", spot=spot)[0] == 200
    assert (entry().labels, entry().exclude) == ({}, ())
    status, said = viewer.ask("/free", image="wind-off", spot=spot)
    assert (status, "says nothing" in said["error"]) == (422, True)
    assert original.read_text() == PROJECT


@pytest.mark.parametrize(("path", "said", "words"), [
    ("/name", {"spot": 0, "marker": "W0l"},
     "'W0l' is no marker of the table with the roles that take part, did you mean W"),
    ("/name", {"spot": 0, "marker": "T01"}, "is no marker"),  # the wall's, whose role takes no part
    ("/name", {"spot": 0}, "'None' is no marker"),
    ("/name", {"spot": 10_000, "marker": "W01"}, "has no spot 10000"),
    ("/name", {"spot": -1, "marker": "W01"}, "has no spot -1"),
    ("/exclude", {"spot": True}, "has no spot True"),
    ("/exclude", {"spot": "0"}, "has no spot 0; it has"),
    ("/exclude", {"spot": 0, "image": "other"}, "no image 'other'"),
    ("/exclude", {"spot": 0, "run": 7}, "earlier run"),
    ("/explain", {"image": None}, "no image"),
])  # fmt: skip
def test_what_cannot_be_is_refused_in_words(viewer, original, path, said, words):
    status, answer = viewer.ask(path, **{"image": "wind-off", **said})
    assert status == 422
    assert words in answer["error"]
    assert original.read_text() == PROJECT


def test_a_project_that_was_broken_by_hand_is_said_and_not_touched(viewer, original):
    original.write_text(PROJECT + "[detct]\n")
    status, answer = viewer.ask("/exclude", image="wind-off", spot=0)
    assert status == 422
    assert "detct" in answer["error"]
    assert "detct" in viewer.state()["unread"]
    assert original.read_text() == PROJECT + "[detct]\n"


def test_rejected_candidates_have_reasons(viewer):
    status, said = viewer.ask("/explain", image="wind-off")
    assert status == 200
    spots = viewer.session.shown.result.images[0].detections.xy
    assert len(said["rejected"]) > 10
    for x, y, _, _, reason in said["rejected"]:
        assert len(reason) > 5
        assert np.linalg.norm(spots - [x, y], axis=1).min() > 1.0


def pov_of(viewer, **changed):
    from windmark.app.viewer.pov import first_pov

    result = viewer.session.shown.result
    p = first_pov(result.images[0], result)
    numbers = dict(zip(NUMBERS, (p.rx_deg, p.ry_deg, p.rz_deg, p.dx, p.dy, p.dz, p.fov_deg), strict=True))
    return {name: value + changed.get(name, 0.0) for name, value in numbers.items()}


def test_at_the_runs_pose_the_grid_is_where_the_run_has_it(viewer):
    status, seen = viewer.ask("/grid", image="wind-off", **pov_of(viewer))
    (item,) = viewer.session.shown.result.images
    assert status == 200
    assert seen["nodes"] == item.nodes.visible.sum()
    assert seen["rms"] < 0.05
    at = {name: (x, y) for name, x, y in seen["markers"]}
    for name, spot in matched(viewer).items():
        np.testing.assert_allclose(at[name], item.detections.xy[spot], atol=0.1)


def test_elsewhere_it_is_what_the_camera_projects(viewer):
    result = viewer.session.shown.result
    (item,) = result.images
    numbers = pov_of(viewer, rx=3.0, ry=-4.0, rz=20.0, dx=30.0, dy=-20.0, dz=100.0, fov=2.0)
    _, seen = viewer.ask("/grid", image="wind-off", **numbers)
    pov = PoV(*numbers.values())
    camera = camera_at(item.camera, pov)
    assert camera.fov_deg == pytest.approx(pov.fov_deg)
    assert (camera.k1, camera.cx, camera.aspect) == (item.camera.k1, item.camera.cx, item.camera.aspect)
    expected = camera.project(pov.pose.apply(result.markers.xyz))[0]
    index = {str(n): k for k, n in enumerate(result.markers.name)}
    assert len(seen["markers"]) > 5
    for name, x, y in seen["markers"]:
        np.testing.assert_allclose([x, y], expected[index[name]], atol=0.0051)
    nodes = camera.project(pov.pose.apply(result.mesh.vertices))[0]
    starts = [piece.split("l")[0].split() for piece in seen["path"].split("M")[1:]]
    assert len(starts) > 20
    for x, y in starts:
        assert np.nanmin(np.linalg.norm(nodes - [float(x), float(y)], axis=1)) < 0.1
    assert seen["rms"] > 10


def test_a_fisheye_keeps_its_own_field_of_view():
    camera = Camera((1000, 800), 400.0, k1=0.01, lens="fisheye")
    pov = PoV(0, 0, 0, 0, 0, 1, 200.0)
    assert camera_at(camera, pov).fov_deg == pytest.approx(200.0)
    assert camera_at(camera, PoV(0, 0, 0, 0, 0, 1, camera.fov_deg)).focal_px == pytest.approx(400.0)


@pytest.mark.parametrize(("changed", "words"), [
    ({"rx": None}, "rx must be a number"), ({"dz": "1"}, "dz must be a number"), ({"fov": 0.0}, "fov must be above 0"),
    ({"fov": True}, "fov must be a number"), ({"fov": 190.0}, "between 0 and 180"),
])  # fmt: skip
def test_a_point_of_view_that_is_none_is_refused(viewer, changed, words):
    status, said = viewer.ask("/grid", image="wind-off", **{**pov_of(viewer), **changed})
    assert status == 422
    assert words in said["error"]


def test_a_camera_that_looks_away_sees_nothing(viewer):
    numbers = {**pov_of(viewer), "dz": -pov_of(viewer)["dz"]}
    status, seen = viewer.ask("/grid", image="wind-off", **numbers)
    assert (status, seen["nodes"], seen["markers"], seen["path"], seen["rms"]) == (200, 0, [], "", None)
    status, said = viewer.ask("/export", image="wind-off", kind="png", **numbers)
    assert status == 422
    assert "nothing" in said["error"]


def test_the_virtual_view_is_written_as_values_and_as_a_picture(viewer, tmp_path):
    (item,) = viewer.session.shown.result.images
    run = {"run": 1, "image": "wind-off", **pov_of(viewer)}
    status, content, headers = viewer.raw("POST", "/export", {**run, "kind": "tiff"})
    assert (status, headers["Content-Type"]) == (200, "image/tiff")
    (tmp_path / "view.tif").write_bytes(content)
    values = read_grey(tmp_path / "view.tif")
    assert values.dtype == np.float32
    # From the picture's own place a perfect camera shows the same, but for the lens: grey levels where it is looked at.
    names = matched(viewer)
    marker = viewer.session.shown.result.markers
    k = [str(n) for n in marker.name].index(next(iter(names)))
    from windmark.pipeline.views import perfect_camera

    x, y = perfect_camera(item.camera.size_px, item.camera.fov_deg).project(
        item.cam_from_model.apply(marker.xyz[k]))[0].round().astype(int)  # fmt: skip
    u, v = item.detections.xy[names[str(marker.name[k])]].round().astype(int)
    assert values[y, x] == pytest.approx(float(item.image[v, u]), abs=12)
    status, content, _ = viewer.raw("POST", "/export", {**run, "kind": "png"})
    picture = np.asarray(Image.open(byte_io.BytesIO(content)))
    assert picture.shape == (*values.shape, 2)
    np.testing.assert_array_equal(picture[..., 1] > 0, np.isfinite(values))
    status, said = viewer.ask("/export", image="wind-off", kind="exe", **pov_of(viewer))
    assert (status, "png or tiff" in said["error"]) == (422, True)
    status, said = viewer.ask("/export", image="wind-off", kind="png", **{**pov_of(viewer), "fov": 175.0})
    assert (status, "170" in said["error"]) == (422, True)


def test_a_picture_of_known_pose_is_shown_with_its_grid_and_has_no_spots(original, tmp_path, viewer):
    folder = shutil.copytree(original.parent, tmp_path / "known", ignore=shutil.ignore_patterns("results"))
    (item,) = viewer.session.shown.result.images
    write_camera(folder / "camera.json", item.camera, item.cam_from_model, unit="mm")
    text = PROJECT.replace('"camera.json"', '"camera.json"\npose = "known"').split("[markers]")[0]
    (folder / "project.toml").write_text(text + '[grid]\nfile = "model.grid"\n')
    with viewing(folder / "project.toml") as other:
        _, page, _ = other.raw("GET", "/")
        assert b"visible grid lines" in page
        status, seen = other.ask("/grid", image="wind-off", **pov_of(other))
        assert (status, seen["nodes"]) == (200, item.nodes.visible.sum())
        for path in ("/exclude", "/sight"):
            status, said = other.ask(path, image="wind-off", spot=0)
            assert (status, "none was found or looked for" in said["error"]) == (422, True)
        assert other.ask("/explain", image="wind-off")[0] == 422


def test_run_again_writes_the_results_and_says_what_changed(original, tmp_path, windmark):
    folder = shutil.copytree(original.parent, tmp_path / "again", ignore=shutil.ignore_patterns("results"))
    path = folder / "project.toml"
    path.write_text(PROJECT)
    with viewing(path) as viewer:
        names = matched(viewer)
        name, spot = next(iter(names.items()))
        assert viewer.ask("/exclude", image="wind-off", spot=spot)[0] == 200
        assert viewer.ask("/run")[0] == 200
        for way in ("/run", "/exclude"):  # one at a time, and the project is not changed under its hands
            status, said = viewer.ask(way, image="wind-off", spot=spot)
            assert (status, "at work" in said["error"]) == (422, True)
        state = viewer.wait()
        assert (state["run"], state["problem"], state["edits"]) == (2, "", [])
        (change,) = viewer.session.shown.changed
        assert name in change.lost
        assert change.gained == change.moved == ()
        assert 0 < change.angle_deg < 0.1
        assert (len(change.before.names), len(change.after.names)) == (len(names), len(names) - len(change.lost))
        _, page, _ = viewer.raw("GET", "/")
        assert b"What changed" in page
        assert f"gone: {name}".encode() in page
        assert b"The result folder results has this run" in page
        status, said = viewer.ask("/exclude", image="wind-off", spot=0, run=1)  # a page of the first run
        assert (status, "earlier run" in said["error"]) == (422, True)
        # A run that fails leaves the page and the results as they were, and says why.
        before = (folder / "results" / "manifest.json").read_bytes()
        path.write_text(path.read_text().replace("markers.csv", "gone.csv"))
        assert viewer.ask("/run")[0] == 200
        state = viewer.wait()
        assert "gone.csv" in state["problem"]
        assert state["run"] == 2
        assert (folder / "results" / "manifest.json").read_bytes() == before
        path.write_text(path.read_text().replace("gone.csv", "markers.csv"))
    done = windmark("verify", folder / "results", "--json")
    assert done.code == 0, done.err


def test_what_is_at_work_stops_when_the_viewer_ends(original, tmp_path):
    folder = shutil.copytree(original.parent, tmp_path / "ended", ignore=shutil.ignore_patterns("results"))
    with viewing(folder / "project.toml", run=False) as viewer:
        viewer.session.start(write=True)
        time.sleep(0.2)
    assert viewer.session.shown is None
    assert not (folder / "results").exists()
    assert sorted(p.name for p in folder.iterdir()) == sorted(
        p.name for p in original.parent.iterdir() if p.name != "results"
    )
