"""From tables of matches and pictures to a calibration: marks, rounds, files."""

from dataclasses import replace
from types import SimpleNamespace

import networks
import numpy as np
import pytest

from windmark import io
from windmark.calibration import Distance, Fixed, Free, Weighted
from windmark.calibration.quality import SplitHalf, compare
from windmark.geometry import Camera, Pose
from windmark.geometry.camera import LENS_PARAMETERS
from windmark.geometry.similarity import align
from windmark.pipeline.calibrate import (
    CalibrateSettings,
    MatchedPicture,
    MatchOptions,
    Taken,
    calibrate_marks,
    calibrate_pictures,
    from_table,
    read_known,
    record,
    taken_by,
    write_calibration,
)
from windmark.pipeline.calibrate import from_pictures as rounds
from windmark.pipeline.calibrate.outputs import datum_words, pose_columns, stations
from windmark.pipeline.clock import Clock
from windmark.pipeline.lengths import Lengths
from windmark.scene import Detections, MarkerSet, Matching, Observations, View
from windmark.tasks.calibrate import pictures as matching
from windmark.tasks.calibrate.marks import Marks, start_camera, with_focal
from windmark.tasks.calibrate.rig import beside


def table_of(case):
    net = case.network
    n = len(net.xy)
    blank = np.full(n, "")
    return io.MatchTable(
        np.array([f"v{v:02d}" for v in net.view]), np.array([f"m{p:02d}" for p in net.point]), net.xy,
        np.full((n, 2), np.nan), np.full((n, 2, 2), np.nan), blank, blank,
    )  # fmt: skip


def rough(case, **columns):
    return MarkerSet.make([f"m{k:02d}" for k in range(len(case.start.points))], case.start.points, **columns)


@pytest.fixture(scope="module")
def done():
    case = networks.make(71, points=40, views=14)
    marks = from_table(table_of(case), rough(case), {"camera": Camera((1500, 1000), 1500.0)}, sigma_px=0.1)
    out = calibrate_marks(marks, CalibrateSettings(Free()), Clock())
    assert out
    return out


def test_matches_without_sigma_take_the_given_one(done):
    np.testing.assert_allclose(done.marks.observations.cov[:, 0, 0], 0.01)
    assert 0.9 < done.result.sigma0 < 1.1
    assert isinstance(done.halves, SplitHalf)
    assert 0.7 < done.halves.comparison.ratio < 1.4


def test_names_that_the_table_lacks_are_named():
    case = networks.make(72, points=12, views=4)
    with pytest.raises(ValueError, match="1 markers that are not in the table of markers: m11"):
        from_table(table_of(case), rough(case).take(np.arange(11)), {"camera": networks.CAMERA}, sigma_px=0.1)


def test_which_camera_took_an_image():
    def cameras(*asked):
        return [t.camera for t in taken_by(*asked)]

    assert cameras(["x", "y"], ["camera"]) == ["camera", "camera"]
    assert cameras(["left_01", "right/01"], ["left", "right"]) == ["left", "right"]
    assert [t.frame for t in taken_by(["left_01", "right/01"], ["left", "right"])] == ["01", "01"]
    assert cameras(["cam1_2", "cam12_2"], ["cam1", "cam12"]) == ["cam1", "cam12"]
    assert cameras(["x"], ["left", "right"], None, ["right"]) == ["right"]
    with pytest.raises(ValueError, match="begins with none of left, right"):
        taken_by(["x"], ["left", "right"])
    with pytest.raises(ValueError, match="'up'; there are left, right"):
        taken_by(["x"], ["left", "right"], None, ["up"])


def test_which_camera_took_an_image_by_patterns():
    patterns = {"left": "cal-*_0", "right": "cal-*_1"}
    got = taken_by(["cal-07_0", "cal-07_1", "cal-1.2_0"], ["left", "right"], patterns)
    assert got == [Taken("left", "07"), Taken("right", "07"), Taken("left", "1.2")]
    assert taken_by(["a-3-b"], ["one"], {"one": "*-3-*"}) == [Taken("one", "a_b")]
    with pytest.raises(ValueError, match=r"cal-07_2: .* fits the pattern of none"):
        taken_by(["cal-07_2"], ["left", "right"], patterns)
    with pytest.raises(ValueError, match="fits the pattern of left and right"):
        taken_by(["cal-07"], ["left", "right"], {"left": "cal*", "right": "*07"})


def test_a_rig_of_two_cameras():
    case = networks.make(73, points=30, views=8, rig=True)
    table = table_of(case)
    names = np.array([f"{'ab'[v % 2]}_{v // 2}" for v in case.network.view])
    marks = from_table(
        replace(table, image=names), rough(case), dict(zip("ab", case.start.cameras, strict=True)), sigma_px=0.1
    )
    assert {v.frame for v in marks.views} == {str(k) for k in range(8)}
    out = calibrate_marks(marks, CalibrateSettings(Free(), rig=True), Clock())
    assert set(out.result.cameras) == {"a", "b"}
    assert 0.9 < out.result.sigma0 < 1.1
    true = case.truth.offsets.translation[1], np.degrees(np.linalg.norm(Pose(
        case.truth.offsets.rotation[1], case.truth.offsets.translation[1]).log()[:3]))  # fmt: skip
    (one,) = beside(out.result)
    assert one.camera == "b"
    assert abs(one.angle_deg - true[1]) < 4 * one.angle_sigma_deg
    scale = align(out.result.markers.xyz, case.truth.points, scale=True).scale
    assert abs(one.distance * scale - np.linalg.norm(true[0])) < 4 * one.distance_sigma
    assert out.result.cam_from_rig["a"].rotation.tolist() == np.eye(3).tolist()


def test_cameras_that_share_no_instant_are_no_rig():
    case = networks.make(73, points=30, views=8, rig=True)
    names = np.array([f"{'ab'[v % 2]}_{v}" for v in case.network.view])
    marks = from_table(
        replace(table_of(case), image=names),
        rough(case),
        dict(zip("ab", case.start.cameras, strict=True)),
        sigma_px=0.1,
    )
    out = calibrate_marks(marks, CalibrateSettings(Free(), rig=True), Clock())
    assert not out
    assert out.weak == ("b",)
    assert "camera b has no frame in common with a" in out.reason


def test_stations_have_the_covariance_of_sampled_poses(done):
    at, cov = stations(done.result)
    view = done.result.views[3].name
    pose = done.result.pose(view)
    draws = np.random.default_rng(0).multivariate_normal(np.zeros(6), done.result.pose_cov[3], 4000)
    centers = (Pose.exp(draws) @ pose).center
    np.testing.assert_allclose(at[3], pose.center)
    np.testing.assert_allclose(np.cov(centers.T), cov[3], atol=0.08 * np.abs(cov[3]).max())


def test_files_are_read_back(done, tmp_path):
    write_calibration(done, tmp_path, "mm")
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "camera.json", "markers-covariance.csv", "markers.csv", "poses.csv", "poses.json", "residuals.csv", "views",
    ]  # fmt: skip
    camera, none = io.read_camera(tmp_path / "camera.json")
    assert none is None
    np.testing.assert_array_equal(camera.parameters(), done.result.cameras["camera"].parameters())
    np.testing.assert_array_equal(camera.cov, done.result.cameras["camera"].cov)
    known = read_known(tmp_path, Lengths("mm"))
    np.testing.assert_allclose(known.marker_cov, done.result.marker_cov, rtol=1e-8)  # one triangle is written
    assert compare(known, done.result).rms < 1e-9
    _, pose = io.read_camera(tmp_path / "views" / "v03.json")
    np.testing.assert_allclose(pose.center, done.result.pose("v03").center)
    assert len((tmp_path / "residuals.csv").read_text().splitlines()) == len(done.result.observations) + 1
    rows = pose_columns(done.result)
    assert (rows["sigma_x"] > 0).all()
    assert rows["marks"].sum() == done.result.used.sum()


def test_tables_of_other_markers_are_refused(done, tmp_path):
    write_calibration(done, tmp_path, "mm")
    io.write_markers(tmp_path / "markers.csv", done.result.markers.take(np.arange(10)))
    with pytest.raises(io.FileError, match="other markers"):
        read_known(tmp_path, Lengths("mm"))


@pytest.mark.parametrize(
    ("datum", "distances", "words"),
    [
        (Free(), (), "shift, turn nor grow"),
        (Free(), (Distance("m00", "m01", 100.0, 0.1),), "m00 to m01, 100 with sigma 0.1"),
        (Fixed(("m00", "m01", "m02")), (), "m00, m01, m02, held"),
        (Weighted(None, 0.2), (), "a sigma of 0.2"),
    ],
)
def test_the_datum_in_words(done, datum, distances, words):
    result = replace(done.result, options={**done.result.options, "datum": datum, "distances": distances})
    assert words in " ".join(datum_words(result))


def test_the_record_has_what_a_machine_needs(done):
    got = record(done, "mm")
    assert set(got["cameras"]["camera"]) >= set(LENS_PARAMETERS["brown"])
    assert got["cameras"]["camera"]["focal_px"]["sigma"] == done.result.sigma("camera", "focal_px")
    assert got["halves"]["done"]
    io.to_json(got)


def test_a_long_lens_is_found_from_nothing():
    """Three widths of the image: beyond the focal lengths that the calibration tries round its start value."""
    rng, camera = np.random.default_rng(6), Camera((1500, 1000), 4600.0, k1=-0.2)
    xyz = rng.uniform(-300, 300, (30, 3)) * [1, 0.6, 0.3]
    poses = [
        Pose.look_at(3.6 * networks.view(rng).center, rng.normal(0, 10, 3), rng.normal(0, 1, 3)) for _ in range(14)
    ]
    seen = [camera.project(p.apply(xyz))[0] for p in poses]
    noise = np.tile(0.01 * np.eye(2), (420, 1, 1))
    view, point = np.repeat(np.arange(14), 30), np.tile(np.arange(30), 14)
    marks = Marks(
        Observations(view, point, np.concatenate(seen) + rng.normal(0, 0.1, (420, 2)), noise),
        MarkerSet.make([f"m{k:02d}" for k in range(30)], xyz + rng.normal(0, 2, xyz.shape)),
        {"camera": start_camera((1500, 1000), None)}, tuple(View(f"v{v:02d}") for v in range(14)),
    )  # fmt: skip
    started = with_focal(marks)
    assert abs(started.cameras["camera"].focal_px / 4600 - 1) < 0.1
    out = calibrate_marks(started, CalibrateSettings(Free()), Clock())
    assert abs(out.result.cameras["camera"].focal_px - 4600) < 4 * out.result.sigma("camera", "focal_px")


def spots(case, view, *, more, rng):
    """What a detector gives of a view: spots in no order that helps, some of them false."""
    net = case.network
    mine = net.view == view
    xy = np.concatenate([net.xy[mine], rng.uniform([0, 0], [1499, 999], (more, 2))])
    order = rng.permutation(len(xy))
    return Detections.make(xy[order], cov=np.full((len(xy), 2), 0.1**2)[:, :, None] * np.eye(2))


def matched_pictures(case, monkeypatch, tmp_path, settings=None, broken=()):
    rng = np.random.default_rng(5)
    views = int(case.network.view.max()) + 1
    found = {f"v{v:02d}": spots(case, v, more=40 if v in broken else 6, rng=rng) for v in range(views)}
    for v in broken:
        found[f"v{v:02d}"] = Detections.make(rng.uniform([0, 0], [1499, 999], (40, 2)))

    def fake(path, name, taken, options):
        return MatchedPicture(name, taken.camera, (1500, 1000), found[name], taken.frame)

    monkeypatch.setattr(rounds, "_detect", fake)
    return calibrate_pictures(
        [tmp_path / f"v{v:02d}.png" for v in range(views)], rough(case), {"camera": None}, MatchOptions(),
        settings or CalibrateSettings(Free()), Clock(),
    )  # fmt: skip


@pytest.mark.slow
def test_pictures_of_unlabelled_spots(monkeypatch, tmp_path):
    """No labels, no poses, no focal length, rough coordinates; two pictures of nothing are refused and named."""
    case = networks.make(74, points=40, views=12)
    out, matched = matched_pictures(case, monkeypatch, tmp_path, broken=(2, 7))
    assert out
    assert [m.name for m in matched if m.registration is None] == ["v02", "v07"]
    assert all(m.problem for m in matched if m.registration is None)
    result = out.result
    assert len(result.views) == 10
    true = case.truth.cameras[0]
    for p in ("focal_px", "cx", "cy"):
        assert abs(getattr(result.cameras["camera"], p) - getattr(true, p)) < 4 * result.sigma("camera", p)
    known = case.truth.points[[int(n[1:]) for n in result.markers.name]]
    off = align(result.markers.xyz, known, scale=True).apply(result.markers.xyz) - known
    assert np.sqrt((off**2).mean()) < 3 * np.sqrt((result.markers.sigma**2).mean())


@pytest.mark.slow
def test_too_few_pictures_say_why(monkeypatch, tmp_path):
    case = networks.make(75, points=40, views=4)
    out, matched = matched_pictures(case, monkeypatch, tmp_path, broken=(0, 1))
    assert not out
    assert out.cause == "too_few"
    assert "2 of 4 pictures" in out.reason
    assert set(out.dropped) == {"v00", "v01"}
    assert len(matched) == 4


def labelled_pictures(case, monkeypatch, tmp_path, wrong):
    """Pictures whose matching gives the true labels; ``wrong(name, round, anew)`` says where they are exchanged."""
    net = case.network
    views = int(net.view.max()) + 1

    def spots_of(path, name, taken, options):
        xy = net.xy[net.view == int(name[1:])]
        return MatchedPicture(name, taken.camera, (1500, 1000), Detections.make(xy, sigma_px=0.1), taken.frame)

    def match(picture, markers, camera, options, how, n, excess_px, anew):
        point = net.point[net.view == int(picture.name[1:])]
        order = np.random.default_rng(3).permutation(len(point)) if wrong(picture.name, n, anew) else slice(None)
        pairs = Matching(np.arange(len(point)), point[order], np.zeros(len(point)))
        return replace(picture, registration=SimpleNamespace(matching=pairs), problem="", round=picture.round or n)

    monkeypatch.setattr(rounds, "_detect", spots_of)
    monkeypatch.setattr(matching, "_match", match)
    return calibrate_pictures(
        [tmp_path / f"v{v:02d}.png" for v in range(views)], rough(case), {"camera": Camera((1500, 1000), 1500.0)},
        MatchOptions(), CalibrateSettings(Free()), Clock(),
    )  # fmt: skip


@pytest.mark.slow
def test_a_picture_that_contradicts_the_others_to_the_end_is_dropped(monkeypatch, tmp_path):
    case = networks.make(76, points=40, views=10)
    out, pictures = labelled_pictures(case, monkeypatch, tmp_path, lambda name, n, anew: name == "v03")
    assert out, out.reason
    assert [p.name for p in pictures if p.registration is None] == ["v03"]
    assert pictures[3].round == 0
    assert "most of its marks contradict the other pictures" in pictures[3].problem
    assert "v03" not in [v.name for v in out.result.views]
    assert out.result.suspect == ()
    assert out.result.used.mean() > 0.99


def test_a_doubtful_picture_is_matched_anew_and_stays_if_it_fits_then(monkeypatch, tmp_path):
    case = networks.make(77, points=40, views=10)
    asked = []

    def wrong(name, n, anew):
        if name == "v03" and n > 2:
            asked.append((n, anew))
        return name == "v03" and n < 3

    out, pictures = labelled_pictures(case, monkeypatch, tmp_path, wrong)
    assert out, out.reason
    assert asked[0] == (3, True)  # its labels were forgotten, those of the others were kept
    assert all(p.registration is not None for p in pictures)
    assert len(out.result.views) == 10
    assert out.result.used.mean() > 0.99
