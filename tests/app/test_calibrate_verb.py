"""`windmark calibrate` as a user types it: results, refusals, wrong usage."""

import re
import shutil

import networks
import numpy as np
import pytest

from windmark import io
from windmark.geometry import Camera, Pose
from windmark.scene import MarkerCovariance, MarkerSet, Mesh, structured_triangles

PACKED = r'base64,[A-Za-z0-9+/=]+|<script type="text/plain".*?</script>'
"""Data, in which any letters may stand beside each other."""

SIZE = "1500x1000"


def write_matches(path, view, point, xy):
    io.write_table(path, {
        "image": np.array([f"v{v:02d}" for v in view]), "name": np.array([f"m{p:02d}" for p in point]),
        "x": xy[:, 0], "y": xy[:, 1],
    })  # fmt: skip


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plate")
    case = networks.make(71, points=40, views=14)
    net, rng = case.network, np.random.default_rng(1)
    xy = net.xy.copy()
    bad = rng.choice(len(xy), 6, replace=False)
    xy[bad] += rng.choice([-20, 20], (6, 2))
    io.write_markers(folder / "rough.csv", MarkerSet.make([f"m{k:02d}" for k in range(40)], case.start.points))
    write_matches(folder / "matches.csv", net.view, net.point, xy)
    return case, bad, folder


@pytest.fixture
def plate(made, tmp_path):
    """Rough markers and matches of 14 pictures, six of them wrong; the network they come from."""
    case, bad, folder = made
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    return case, bad, tmp_path


def call(windmark, folder, *more, size=True, matches="matches.csv", focal=1500):
    """By default with a focal length: to find one from nothing is half of the time."""
    sized = ("--size", SIZE) if size and "--size" not in more else ()
    known = ("--focal", focal) if size and focal and "--focal" not in more else ()
    out = () if "-o" in more else ("-o", folder / "out")
    return windmark("calibrate", folder / matches, "-m", folder / "rough.csv", "--unit", "mm", *sized, *known, *out,
                    *more)  # fmt: skip


def test_it_writes_everything(windmark, plate):
    case, bad, folder = plate
    done = call(windmark, folder, "--datum", "free", focal=None)
    assert done.code == 0
    assert "14 views, 40 markers" in done.out
    assert "6 left out" in done.out
    camera, _ = io.read_camera(folder / "out" / "camera.json")
    true = case.truth.cameras[0]
    assert abs(camera.focal_px - true.focal_px) < 4 * np.sqrt(camera.cov[0, 0])
    table = io.read_table(
        folder / "out" / "residuals.csv", required=(), known=("image", "name", "x", "y", "dx", "dy", "test", "used")
    )
    assert sorted(np.flatnonzero(table.numbers("used") == 0)) == sorted(bad)
    page = (folder / "out" / "report.html").read_text()
    for words in ("Free network", "sigma0", "Half of the pictures", "Gross errors", "m07", "focal_px"):
        assert words in page
    assert page.count('src="data:image/') == 7
    assert "http" not in re.sub(PACKED, "", page)


@pytest.mark.slow
def test_json_and_comparison_with_another_set(windmark, plate, without_pictures):
    case, _, folder = plate
    net = case.network
    for k in (0, 1):
        mine = net.view % 2 == k
        write_matches(folder / f"set{k}.csv", net.view[mine], net.point[mine], net.xy[mine])
    with without_pictures():
        assert call(windmark, folder, "--datum", "free", "-o", folder / "first", matches="set0.csv").code == 0
    done = call(windmark, folder, "--datum", "free", "--against", folder / "first", "--json", matches="set1.csv")
    assert done.code == 0
    assert done.json["against"]["markers"] == 40
    assert 0.6 < done.json["against"]["ratio"] < 1.5
    assert done.json["cameras"]["camera"]["focal_px"]["sigma"] > 0
    page = (folder / "out" / "report.html").read_text()
    assert "Against another set of pictures" in page
    assert page.count('src="data:image/') == 8


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_known_markers_with_a_joint_covariance(windmark, plate):
    case, _, folder = plate
    names, xyz = [f"m{k:02d}" for k in range(40)], case.start.points.copy()
    xyz[:5] = case.truth.points[:5] + np.array([0.3, -0.2, 0.1])  # all shifted alike, as the survey's covariance allows
    io.write_markers(folder / "rough.csv", MarkerSet.make(names, xyz))
    shared = np.tile(0.3 * np.eye(3), (5, 1))
    known = MarkerCovariance(names[:5], 0.01**2 * np.eye(15) + shared @ shared.T, "mm")
    io.write_marker_covariance(folder / "survey.csv", known)
    done = call(windmark, folder, "--datum", "weighted", "--control-cov", folder / "survey.csv", "--json")
    assert done.code == 0
    assert done.json["warnings"] == []
    assert "m00, m01, m02, m03, m04 are known together, with their correlations" in " ".join(done.json["datum"])
    assert min(done.json["marker_sigma_rms"]) > 0.29
    for options, words in (
        (("--datum", "free"), "--control-cov is for --datum weighted"),
        (("--datum", "weighted:m00,m01,m09"), "at least three markers with a sigma"),
    ):
        done = call(windmark, folder, *options, "--control-cov", folder / "survey.csv")
        assert done.code == 2
        assert words in done.err
    io.write_marker_covariance(folder / "other.csv", MarkerCovariance(["m00", "zz"], np.eye(6)))
    done = call(windmark, folder, "--datum", "weighted", "--control-cov", folder / "other.csv")
    assert (done.code, "names 'zz', which the table of markers does not have" in done.err) == (2, True)


@pytest.mark.slow
def test_the_grid_tells_how_discs_are_bent(windmark, plate, undrawn, monkeypatch):
    """A table of discs on a dome: the adjustment has its curvature. A board is flat."""
    from windmark.app import calibrate_verb

    folder, given, solve = plate[2], [], calibrate_verb._from_table
    monkeypatch.setattr(calibrate_verb, "_from_table", lambda *a: (given.append(a[2]), solve(*a))[1])
    rough = io.read_markers(folder / "rough.csv")
    names, size = rough.name, np.ptp(rough.xyz[:, :2])
    x, y = np.meshgrid(np.linspace(-size, size, 41), np.linspace(-size, size, 41))
    dome = np.column_stack([x.ravel(), y.ravel(), -(x**2 + y**2).ravel() / (20 * size)])
    io.write_mesh(folder / "dome.stl", Mesh.make(dome, structured_triangles(41, 41)))
    on = np.column_stack([rough.xyz[:, :2], -(rough.xyz[:, :2] ** 2).sum(axis=1) / (20 * size)])
    up = np.column_stack([on[:, :2] / (10 * size), np.ones(len(on))])
    done = call(windmark, folder, "--datum", "free", "-g", folder / "dome.stl")
    assert done.code != 0
    assert "none of the table has a normal and a radius" in done.err
    table = MarkerSet.make(names, on, radius=size / 60, normal=up)
    io.write_markers(folder / "rough.csv", table)
    done = call(windmark, folder, "--datum", "free", "-g", folder / "dome.stl")
    assert "off its surface" not in done.err
    bend = np.linalg.eigvalsh(given[0].curvature)
    np.testing.assert_allclose(bend[:, 1:] * 10 * size, 1, atol=0.1)
    rough = on + np.where(np.arange(len(on)) < 3, size / 45, 0)[:, None] * [0, 0, 1]  # over a radius, as tables may be
    io.write_markers(folder / "rough.csv", MarkerSet.make(names, rough, radius=size / 60, normal=up))
    done = call(windmark, folder, "--datum", "free", "-g", folder / "dome.stl")
    assert "off its surface" not in done.err
    np.testing.assert_allclose(np.linalg.eigvalsh(given[-1].curvature)[:, 1:] * 10 * size, 1, atol=0.1)
    away = on + np.where(np.arange(len(on)) < 3, size / 20, 0)[:, None] * [0, 0, 1]
    io.write_markers(folder / "rough.csv", MarkerSet.make(names, away, radius=size / 60, normal=up))
    done = call(windmark, folder, "--datum", "free", "-g", folder / "dome.stl")
    assert f"3 of {len(on)} markers are over " in done.err
    assert " mm off its surface; their discs count as flat" in done.err
    np.testing.assert_array_equal(given[-1].curvature[:3], 0)
    far = np.add(on, [0, 0, size])
    io.write_markers(folder / "rough.csv", MarkerSet.make(names, far, radius=size / 60, normal=up))
    done = call(windmark, folder, "--datum", "free", "-g", folder / "dome.stl")
    assert (done.code, "dome.stl: does nothing for the markers: " in done.err) == (2, True), done.err
    walls = MarkerSet.make(names, on, radius=size / 60, normal=up, role=["wall"] * len(on))
    io.write_markers(folder / "rough.csv", walls)
    done = call(windmark, folder, "--datum", "free", "-g", folder / "dome.stl")  # a grid of walls
    assert "--grid" not in done.err
    done = windmark("calibrate", folder / "matches.csv", "--board", 3, "--unit", "mm", "-g", folder / "dome.stl")
    assert done.code == 2
    assert "a board is flat" in done.err


def test_datum_has_no_default(windmark, plate):
    done = call(windmark, plate[2])
    assert done.code == 2
    for words in ("--datum is needed", "free:", "fixed:A,B,C,D", "weighted"):
        assert words in done.err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--datum", "fix"), "none of the choices"),
        (("--datum", "fixed:m00,m01"), "at least three"),
        (("--datum", "free:"), "none of the choices"),
        (("--datum", "fixed:m00,m01,zz"), "unknown marker 'zz'"),
        (("--datum", "weighted"), "at least three markers with a sigma"),
        (("--datum", "weighted=-1"), "must be > 0"),
        (("--datum", "weighted=x"), "a number, got 'x'"),
        (("--datum", "free", "--lens", "fish"), "--lens: expected pinhole"),
        (("--datum", "free", "--free", "focal"), "'focal' is none of focal_px"),
        (("--datum", "free", "--free", "k1", "--lens", "brown"), "give one of them"),
        (("--datum", "free", "--distance", "m00,m01,5"), "A,B,length,sigma"),
        (("--datum", "free", "--distance", "m00,zz,5,1"), "unknown marker 'zz'"),
        (("--datum", "free", "--prior-sigma", "k1"), "PARAMETER=sigma"),
        (("--datum", "free", "--free-focal", "v99"), "v99"),
        (("--datum", "free", "--free-principal", "v99"), "free_principal names unknown views v99"),
        (("--datum", "free", "--free-principal", "all"), "say how far they differ, as in --prior-sigma principal=10"),
        (("--datum", "free", "--free-focal", "all"), "as in --prior-sigma focus=0.003"),
        (("--datum", "free", "--prior-sigma", "focus=0.003"), "of the pictures of --free-focal, which names none"),
        (("--datum", "free", "--free-focal", "all", "--prior-sigma", "principal=5"), "of --free-principal, which"),
        (("--datum", "free", "--sigma-px", "0"), "--sigma-px"),
        (("--datum", "free", "--label", "v01:m00=1,2"), "for pictures"),
        (("--datum", "free", "-r", "3"), "for pictures"),
        (("--datum", "free", "--eccentricity", "on"), "auto, table, off"),
        (("--datum", "free", "--board", "3.5"), "either --markers"),
        (("--datum", "free", "--board-marks", "holes:0,0:5,0"), "--board PITCH is needed"),
        (("--datum", "free", "--images-of", "left=v0"), "NAME=PATTERN with a *"),
        (("--datum", "free", "--images-of", "a=v*", "--images-of", "a=w*"), "camera a is there twice"),
        (("--datum", "free", "--images-of", "a=v0*", "--images-of", "b=v1*", "--focal", "nan"),
         "'--focal': expected > 0, not nan"),
        (("--datum", "free", "--size", "\u00b2x5"), "--size must be WIDTHxHEIGHT"),
        (("--datum", "free", "--size", "1" * 5000 + "x5"), "--size must be WIDTHxHEIGHT"),
        (("--datum", "free", "--board", "10", "--board-size", "12x\u00b3"), "--board-size: expected COLUMNSxROWS"),
    ],
)
def test_wrong_usage_is_named(windmark, plate, options, words):
    done = call(windmark, plate[2], *options)
    assert done.code == 2
    assert words in done.err
    assert not (plate[2] / "out").exists()


def test_the_size_is_needed_with_matches(windmark, plate):
    done = call(windmark, plate[2], "--datum", "free", size=False)
    assert done.code == 2
    assert "--size WIDTHxHEIGHT" in done.err


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("image,name,x,y\n", "no rows"),
        ("", "is empty"),
        ("image,name,x,y\nv0,m00,1,nan\n", "line 2"),
        ("image,name,x,y\nv0,m00,1,2\nv0,m00,3,4\n", "already on line 2"),
        ("image,name,x,y\nv0,zz,1,2\n", "not in the table of markers: zz"),
        ("image,name,x,y,camera\nv0,m00,1,2,a\nv0,m01,1,2,b\n", "another camera"),
        ("image,name,x,y,sigma_x,sigma_y\nv0,m00,1,2,0,0\n", "must be > 0"),
    ],
)
def test_wrong_tables_are_named(windmark, plate, text, words):
    (plate[2] / "bad.csv").write_text(text)
    done = call(windmark, plate[2], "--datum", "free", matches="bad.csv")
    assert done.code == 2
    assert words in done.err


def refused(windmark, folder, poses, xyz, camera=networks.CAMERA, datum="free", flat=False):
    """Matches of perfect marks with 0.1 px of noise from the given poses."""
    rng = np.random.default_rng(3)
    names = [f"m{k:02d}" for k in range(len(xyz))]
    io.write_markers(folder / "rough.csv", MarkerSet.make(names, xyz + rng.normal(0, 2, xyz.shape)))
    rows = []
    for v, pose in enumerate(poses):
        xy, _ = camera.project(pose.apply(xyz))
        rows += [(v, p, *(xy[p] + rng.normal(0, 0.1, 2))) for p in range(len(xyz)) if camera.in_image(xy[p])]
    rows = np.array(rows)
    write_matches(folder / "m.csv", rows[:, 0].astype(int), rows[:, 1].astype(int), rows[:, 2:])
    return call(windmark, folder, "--datum", datum, "--json", matches="m.csv", focal=None)


@pytest.mark.slow
def test_pictures_from_one_place_are_refused(windmark, tmp_path):
    rng = np.random.default_rng(8)
    xyz = rng.uniform(-300, 300, (30, 3)) * [1, 0.8, 0.3]
    eye = np.array([100.0, 50.0, 1300.0])
    poses = [Pose.look_at(eye, rng.normal(0, 15, 3), [np.cos(a), np.sin(a), 0]) for a in np.linspace(0, 5, 8)]
    done = refused(windmark, tmp_path, poses, xyz)
    assert done.code == 1
    assert done.json["cause"] == "degenerate"
    assert "not calibrated" in done.err
    assert "from about one place" in done.json["reason"]
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_frontal_pictures_of_a_plate_do_not_tell_the_focal_length(windmark, tmp_path):
    rng = np.random.default_rng(9)
    xyz = rng.uniform(-300, 300, (40, 3)) * [1, 0.8, 0]
    poses = [Pose.look_at([x, y, 1300.0], [x, y, 0.0], [0, 1, 0]) for x, y in rng.uniform(-60, 60, (10, 2))]
    done = refused(windmark, tmp_path, poses, xyz)
    assert done.code == 1
    assert "focal_px" in done.json["weak"]
    assert "all pictures face it" in done.json["reason"]


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_views_and_markers_that_are_too_poor_are_named(windmark, plate):
    case, _, folder = plate
    net = case.network
    keep = (net.view != 13) | (np.cumsum(net.view == 13) <= 3)  # three marks in the last view
    keep &= (net.point != 39) | (net.view == net.view[net.point == 39][0])  # the last marker is seen once
    write_matches(folder / "poor.csv", net.view[keep], net.point[keep], net.xy[keep])
    done = call(windmark, folder, "--datum", "free", matches="poor.csv")
    assert done.code == 0
    assert "left out: v13: view with" in done.out
    assert "left out: m39: marker seen in one view" in done.out


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_distance_gives_the_scale(windmark, plate):
    case, _, folder = plate
    length = float(np.linalg.norm(case.truth.points[0] - case.truth.points[1]))
    done = call(windmark, folder, "--datum", "free", "--distance", f"m00,m01,{2 * length},0.01", "--json")
    assert done.code == 0
    got = io.read_markers(folder / "out" / "markers.csv").xyz
    np.testing.assert_allclose(np.linalg.norm(got[0] - got[1]), 2 * length, atol=0.05)


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_two_cameras_with_their_names(windmark, tmp_path):
    case = networks.make(73, points=30, views=8, rig=True)
    net = case.network
    known = np.concatenate([case.truth.points[:4], case.start.points[4:]])
    io.write_markers(tmp_path / "rough.csv", MarkerSet.make([f"m{k:02d}" for k in range(30)], known))
    io.write_table(tmp_path / "matches.csv", {
        "image": np.array([f"{('left', 'right')[v % 2]}_{v // 2}" for v in net.view]),
        "name": np.array([f"m{p:02d}" for p in net.point]), "x": net.xy[:, 0], "y": net.xy[:, 1],
    })  # fmt: skip
    for name in ("left", "right"):
        io.write_camera(tmp_path / f"{name}.json", Camera((1500, 1000), 1500.0))
    cameras = [x for n in ("left", "right") for x in ("-c", f"{n}={tmp_path / n}.json")]
    done = call(windmark, tmp_path, "--datum", "fixed:m00,m01,m02,m03", "--rig", *cameras, size=False)
    assert done.code == 0
    assert call(windmark, tmp_path, "--datum", "free", *cameras).code == 2  # --size beside --camera
    assert (tmp_path / "out" / "camera-left.json").is_file()
    assert (tmp_path / "out" / "camera-right.json").is_file()


def test_pictures_without_markers_are_refused(windmark, plate):
    folder = plate[2]
    images = []
    for k in range(3):
        images.append(folder / f"p{k}.png")
        io.write_image(images[-1], np.full((60, 80), 9, np.uint8))
    done = windmark("calibrate", *images, "-m", folder / "rough.csv", "--unit", "mm", "--datum", "free", "-r", 3, "-o",
                    folder / "out")  # fmt: skip
    assert done.code == 1
    assert "0 of 3 pictures" in done.err
    assert not (folder / "out").exists()
    done = windmark("calibrate", *images, "-m", folder / "rough.csv", "--unit", "mm", "--datum", "free", "--label",
                    "q:m00=1,2")  # fmt: skip
    assert done.code == 2
    assert "picture 'q'" in done.err


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_the_papers_steps_end_where_newton_does(windmark, tmp_path):
    case = networks.make(71, points=14, views=8)
    net = case.network
    io.write_markers(tmp_path / "rough.csv", MarkerSet.make([f"m{k:02d}" for k in range(14)], case.start.points))
    io.write_camera(tmp_path / "camera.json", case.truth.cameras[0])
    write_matches(tmp_path / "matches.csv", net.view, net.point, net.xy)
    known = ("-c", tmp_path / "camera.json", "--free", "focal_px", "--prior-sigma", "focal_px=0.3")
    found = {}
    for solver in ("newton", "steps"):
        options = ("--datum", "free", *known, "--solver", solver, "--json")
        assert call(windmark, tmp_path, *options, size=False).code == 0
        found[solver] = io.read_markers(tmp_path / "out" / "markers.csv")
    off = found["steps"].xyz - found["newton"].xyz
    assert 0 < np.abs(off / found["newton"].sigma).max() < 0.3  # another way, the same place
    assert call(windmark, tmp_path, "--datum", "free", "--solver", "magic").code == 2


def test_values_of_the_report_are_rounded_by_their_sigmas(windmark, plate, undrawn):
    _, _, folder = plate
    assert call(windmark, folder, "--datum", "free").code == 0
    page = (folder / "out" / "report.html").read_text()
    rows = [re.findall("<td[^>]*>(.*?)</td>", row) for row in page.split("<tr>")]
    camera = {row[0]: (row[2], row[3]) for row in rows if len(row) == 6 and row[5] != "not free"}
    assert {"focal length", "aspect ratio fy/fx", "k1"} <= set(camera)
    markers = {row[0]: row for row in rows if len(row) == 8 and re.fullmatch("m[0-9]+", row[0])}
    assert len(markers) == 40
    for value, sigma in [*camera.values(), *((row[k], row[k + 3]) for row in markers.values() for k in (1, 2, 3))]:
        assert len(value.partition(".")[2]) == len(sigma.partition(".")[2]), (value, sigma)
        assert len(sigma.replace(".", "").lstrip("0")) == 2, sigma


@pytest.mark.slow
def test_without_its_pictures_the_calibration_is_there(windmark, plate, no_pictures):
    _, _, folder = plate
    done = call(windmark, folder, "--datum", "free", "--json")
    missing = no_pictures(done, 7, folder / "out" / "report.html")
    assert any(said.startswith("camera: picture of the residuals") for said in missing)
    assert io.read_camera(folder / "out" / "camera.json")[0].cov is not None
    assert io.read_json(folder / "out" / "summary.json")["not_drawn"] == missing
