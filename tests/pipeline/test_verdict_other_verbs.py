"""The verdict of merged pictures, given poses, lists of points, followed sequences and matched pairs."""

from dataclasses import replace
from types import SimpleNamespace

import clicked_scenes as sweep
import numpy as np
import pytest

from windmark import io, resection, synth
from windmark.geometry import Camera, Pose
from windmark.pipeline.at_pose import AtPose, markers_at_pose
from windmark.pipeline.job import run_project
from windmark.pipeline.misfits import misfits, with_misfits
from windmark.pipeline.project import read_project
from windmark.pipeline.results import ImageResult
from windmark.pipeline.simulate_cameras import camera_shots
from windmark.pipeline.track_results import PoseRow
from windmark.pipeline.verdict import BAD, DOUBTFUL, GOOD
from windmark.pipeline.verdict.given import empty_lists, given_pose
from windmark.pipeline.verdict.grid import grid_findings
from windmark.pipeline.verdict.pair import pair_verdict
from windmark.pipeline.verdict.picture import picture_findings, picture_state, series_fields
from windmark.pipeline.verdict.run import _contradicted, _on_seams, run_verdict
from windmark.pipeline.verdict.track import track_verdict
from windmark.registration import register
from windmark.scene import Detections, Mesh, structured_triangles
from windmark.tasks.clicked_pair import Clicks, clicked_pair
from windmark.tasks.follow import FollowedFrame, FollowOptions, follow


@pytest.fixture(scope="module")
def tunnel():
    return synth.wind_tunnel(11, size_px=(1000, 800), nodes=4000, clutter=None)


# --- merged pictures ------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def pair():
    """Two cameras of one wing."""
    test = camera_shots(5, 2, size_px=(640, 512), nodes=6000, clutter=False)
    return test, [(s.view.camera, s.image) for s in test.shots]


def merged(pair, change=lambda image: image):
    test, shots = pair
    pictures = [
        resection.Picture(name, change(image) if k else image, test.cameras[name], test.cam_from_tunnel[name])
        for k, (name, image) in enumerate(shots)
    ]
    done = resection.merge_views(test.mesh, pictures, black=64.0)
    assert done, done.reason
    return done


def dark_half(image):
    part = np.where(np.arange(image.shape[1]) < image.shape[1] // 2, 1.0, 0.6)
    return ((image - 64.0) * part + 64).astype(image.dtype)


def other_gamma(image):
    return (image.max() * (image / image.max()) ** (1 / 1.6)).astype(image.dtype)


@pytest.mark.slow
def test_two_pictures_of_one_surface_do_not_contradict_each_other(pair):
    assert _contradicted([merged(pair)]) == []
    assert _on_seams([merged(pair)]) == []


def test_steps_along_a_part_of_a_seam_are_told():
    """One lens shades: one gain fits the middle of the seam, and its ends differ to both sides."""
    x, y = np.meshgrid(np.linspace(-2, 2, 60), np.linspace(-1.5, 1.5, 46))
    mesh = Mesh.make(np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1), structured_triangles(60, 46))
    camera, rng = Camera((320, 240), 420.0), np.random.default_rng(1)
    row = np.linspace(-1, 1, 240)[:, None]

    def seams(slope):
        shown = []
        for k, eye in enumerate((-1.0, 1.0)):
            image = 1000 * (1 + k * slope * row) * np.ones((240, 320)) + 10 * rng.standard_normal((240, 320))
            pose = Pose.look_at([eye, 0.0, 6.0], [eye, 0.0, 0.0], [0.0, 1.0, 0.0])
            shown.append(resection.Picture(f"cam{k + 1}", image, camera, pose, noise=10.0))
        return _on_seams([resection.merge_views(mesh, shown)])

    assert seams(0.0) == []
    (found,) = seams(0.2)
    assert (found.word, found.cause) == (DOUBTFUL, "cameras")
    assert "along their seam" in found.reason


@pytest.mark.parametrize("fault", [dark_half, other_gamma])
def test_a_picture_whose_values_are_not_those_of_the_surface_is_told(pair, fault):
    """Gains are fitted to what both see, and merged values lay between: a fifth of them over five sigmas off."""
    (found,) = _contradicted([merged(pair, fault)])
    assert (found.word, found.cause) == (DOUBTFUL, "cameras")
    assert "cam1 and cam2 contradict each other" in found.reason
    assert "in 1 of 2 points" in _contradicted([merged(pair), merged(pair, fault)])[0].reason


# --- poses that are given ---------------------------------------------------------------------------
_PROJECT = """\
title = "given"
length_unit = "mm"
[[camera]]
file = "camera.json"
pose = "known"
[[image]]
file = "a.tif"
[markers]
file = "markers.csv"
roles = ["model"]
[grid]
file = "model.grid"
[[points]]
file = "taps.csv"
"""


def judged(folder, test, image, scale=1.0, pose=None):
    """A picture with the pose of "wind-off"; the points are some nodes of the grid times ``scale``."""
    shot = test.shot("wind-off")
    io.write_camera(folder / "camera.json", test.cameras["cam1"], pose or shot.view.cam_from_model, unit="mm")
    io.write_markers(folder / "markers.csv", test.markers, length_unit="mm")
    io.write_mesh(folder / "model.grid", test.mesh)
    io.write_image(folder / "a.tif", image)
    xyz = test.mesh.vertices[np.flatnonzero(test.mesh.used)[::400]] * scale
    columns = {"name": [f"t{k}" for k in range(len(xyz))], **dict(zip("xyz", xyz.T, strict=True))}
    io.write_table(folder / "taps.csv", columns, comment="length unit: mm")
    (folder / "project.toml").write_text(_PROJECT)
    return run_verdict(run_project(read_project(folder / "project.toml"), workers=1))


@pytest.mark.slow
def test_markers_are_looked_for_where_a_given_pose_has_them(tmp_path, tunnel):
    verdict = judged(tmp_path, tunnel, tunnel.shot("wind-off").image)
    assert verdict.word == GOOD, verdict
    assert "29 of 29 markers are where the given pose has them" in verdict.reason


@pytest.mark.parametrize(("kind", "word", "cause", "says"), [
    ("moved", DOUBTFUL, "moved", "markers are where the given pose has them"),
    ("mirrored", DOUBTFUL, "moved", "markers are where the given pose has them"),
    ("a little", DOUBTFUL, "moved", "px (RMS per coordinate) from where the given pose has them"),
    ("empty", BAD, "file", "every pixel is at the level 64"),
    ("inches", DOUBTFUL, "units", "are farther than"),
])  # fmt: skip
def test_a_pose_or_a_picture_that_do_not_belong_together_are_doubted(tmp_path, tunnel, kind, word, cause, says):
    image = tunnel.shot("wind-off").image
    image = {"moved": np.roll(image, 40, 1), "mirrored": image[:, ::-1], "a little": np.roll(image, 2, 0),
             "empty": np.full_like(image, 64)}.get(kind, image)  # fmt: skip
    verdict = judged(tmp_path, tunnel, image, 1 / 25.4 if kind == "inches" else 1.0)
    assert (verdict.word, verdict.cause) == (word, cause), verdict
    assert says in verdict.reason


def test_walls_say_nothing_of_the_pose_of_a_model_that_moved(tunnel):
    """At the model's pose they are where they would be if they had moved with it."""
    shot, m, camera = tunnel.shot("wind-off"), tunnel.markers, tunnel.cameras["cam1"]
    moved = replace(m, xyz=np.where((m.role == "wall")[:, None], m.xyz + np.array([3.0, 3.0, 0.0]), m.xyz))
    at = markers_at_pose(shot.image, camera, shot.view.cam_from_model, moved, tunnel.mesh, "auto")
    assert (at.expected, at.found) == (29, 29)
    assert at.off_px < 0.1


def test_few_markers_and_unknown_sizes_say_nothing_of_a_pose(tunnel):
    shot = tunnel.shot("wind-off")
    camera, pose, m = tunnel.cameras["cam1"], shot.view.cam_from_model, tunnel.markers
    unknown = replace(m, radius=np.full(len(m), np.nan))
    assert markers_at_pose(shot.image, camera, pose, unknown, None, "auto") is None
    away = markers_at_pose(shot.image, camera, Pose.from_rotvec([0, np.pi, 0], [0, 0, 0]) @ pose, m, None, "dark")
    assert (away.expected, away.found) == (0, 0)
    for seen in (None, AtPose(3, 3, 0.05), AtPose(5, 4, 0.05)):
        assert given_pose(ImageResult("a", None, camera, pose, at_pose=seen)) == []


@pytest.mark.parametrize(("seen", "cause", "says"), [
    (AtPose(0, 0, np.nan), "few", "from the given pose no marker of the table can be looked for"),
    (AtPose(2, 2, 0.05), "few", "from the given pose only 2 markers of the table can be looked for"),
    (AtPose(2, 0, np.nan), "moved", "0 of 2 markers are where the given pose has them"),
    (AtPose(4, 4, 2.0), "moved", "the markers are 2 px (RMS per coordinate) from"),
])  # fmt: skip
def test_a_given_pose_that_few_markers_can_contradict_is_doubted(tunnel, seen, cause, says):
    """It was "good: 0 of 0 markers are where the given pose has them"."""
    (found,) = given_pose(ImageResult("a", None, tunnel.cameras["cam1"], at_pose=seen))
    assert (found.word, found.cause) == (DOUBTFUL, cause)
    assert says in found.reason


def test_a_pose_in_another_unit_than_the_grid_is_no_good_result(tmp_path, tunnel):
    """In metres beside a grid in mm the camera is within the model: no marker is in view, and next to no node."""
    shot = tunnel.shot("wind-off")
    pose = shot.view.cam_from_model
    metres = Pose(pose.rotation, pose.translation / 1000.0)
    verdict = judged(tmp_path, tunnel, shot.image, pose=metres)
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "units"), verdict
    assert "nodes of the grid are in view" in verdict.reason
    assert "unit of the grid" in verdict.next_step
    said = " ".join(f.reason for f in verdict.findings)
    assert "points taps: none of " in said
    assert "nothing could contradict it" in said


def test_a_list_of_points_that_one_of_two_pictures_shows_is_not_empty():
    of = SimpleNamespace(stem="points-taps", kind="points", name="taps", names=np.array(["a"]), far=np.array([False]))
    lost, has = (
        SimpleNamespace(of=of, values=SimpleNamespace(reason=np.array([code]), words=np.array([words])))
        for code, words in ((3, "outside"), (0, ""))
    )
    assert empty_lists([SimpleNamespace(points=(lost,)), SimpleNamespace(points=(has,))]) == []
    (found,) = empty_lists([SimpleNamespace(points=(lost,))])
    assert "points taps: none of 1 points has a value in any picture (most: outside)" in found.reason


# --- a followed sequence ----------------------------------------------------------------------------
def rows(tunnel, moved=(), **off):
    """Three pictures, their spots exact but for 0.01 px, those of some markers ``moved`` by a quarter of a pixel."""
    shot, camera, out = tunnel.shot("wind-off").perfect, tunnel.cameras["cam1"], []
    use = np.flatnonzero(shot.markers.visible & (tunnel.markers.role == "model"))
    other = replace(camera, cov=None, **{k: getattr(camera, k) + v for k, v in off.items()})
    for k in range(3):
        xy = shot.markers.ellipse_xy[use] + np.random.default_rng(k).normal(0, 0.01, (len(use), 2))
        xy[list(moved), 0] += 0.25
        spots = Detections.make(xy, cov=np.tile(np.eye(2) * 1e-4, (len(use), 1, 1)), radius_px=np.full(len(use), 3.0))
        answer = register(spots, tunnel.markers.take(use), other)
        assert answer, answer.reason
        out.append(PoseRow.of(FollowedFrame(k, f"f{k}", float(k), "cold", "", detections=spots, registration=answer)))
    return out


def test_another_camera_is_told_of_a_sequence_as_of_one_picture(tunnel):
    """Its residuals of some hundredths of a pixel were "the spots' noise", the pose 20 to 90 sigmas off."""
    assert track_verdict(rows(tunnel), "mm").word == GOOD
    for off in ({"cx": 13.0}, {"focal_px": 34.0}):
        verdict = track_verdict(rows(tunnel, **off), "mm")
        assert (verdict.word, verdict.cause) == (DOUBTFUL, "lens"), verdict
        assert "as most of 3 images" in verdict.reason
        assert "elsewhere" in verdict.reason


def test_one_marker_off_its_table_is_named(tunnel):
    """It was "good", with sigmas 20 to 200 times as large: those of a model that is bent at this marker alone."""
    every = rows(tunnel, moved=[5])
    names = [f"n{k}" for k in range(len(tunnel.markers))]
    assert 5 in every[0].matches[0]
    verdict = track_verdict(every, "mm", names=names)
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "marker"), verdict
    assert verdict.reason.startswith("n5 is 0.2")
    assert "in most of 3 images" in verdict.reason
    once = [rows(tunnel)[0], every[1], rows(tunnel)[2]]
    assert track_verdict(once, "mm", names=names).word == GOOD  # a spot that is off in one picture of three


def test_a_picture_that_was_written_twice_is_named(tunnel):
    """Its pose is that of the instant before: 200 sigmas off."""
    a, b, c = rows(tunnel)
    assert track_verdict([a, b, c], "mm").word == GOOD
    verdict = track_verdict([a, b, replace(b, name="again", index=2), c], "mm")
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "file")
    assert "again is f1 once more" in verdict.reason
    # Looked for from another prediction a spot differs by a part of its noise, and two images back there is no pair.
    told = track_verdict([replace(row, picture=p) for row, p in zip((a, b, c), (1, 2, 1), strict=True)], "mm")
    assert (told.word, told.cause) == (DOUBTFUL, "file")
    assert "f2 is f0 bit by bit" in told.reason
    unknown = [replace(row, picture=p) for row, p in zip((a, b, c), (1, 0, 0), strict=True)]
    assert track_verdict(unknown, "mm").word == GOOD


def series(excess, spot=0.01, matched=30):
    """Rows of images with so much misfit each."""
    none = (np.zeros(0, np.int64), np.zeros((0, 4)))
    return [
        PoseRow(k, f"f{k}", float(k), "tracked", "", True, 0.0, matched, matched, e, np.zeros(6), np.ones(6),
                Pose.identity(), none, excess_px=e, spot_px=spot)
        for k, e in enumerate(excess)
    ]  # fmt: skip


def test_one_torn_image_of_a_sequence_is_named_in_verdict_and_row():
    """"all 100 images have a pose, residuals are the spots' noise", and that one's is 19 sigmas off."""
    rows = series([0.0] * 99 + [0.17])
    verdict = track_verdict(rows, "mm")
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "picture")
    assert "f99: residuals of 0.17 px per coordinate, 17 times its spots' sigma" in verdict.reason
    reasons = [row.reason for row in with_misfits(rows)]
    assert "torn" in reasons[99]
    assert not any(reasons[:99])
    # A small tear stands out from its neighbours.
    assert list(misfits(series([0.0] * 5 + [0.05] + [0.0] * 4))) == [5]


def test_a_picture_that_is_turned_by_half_a_turn_is_named_though_its_markers_fit():
    every = series([0.0] * 5)
    poses = [Pose.from_rotvec([0.1, 0.02 * k, 0.3], [0.0, 1.0, 900.0]) for k in range(5)]
    upright = [replace(row, cam_from_model=pose) for row, pose in zip(every, poses, strict=True)]
    assert track_verdict(upright, "mm").word == GOOD
    half = Pose.from_rotvec([0, 0, np.pi], [0, 0, 0])
    mixed = [replace(row, cam_from_model=half @ row.cam_from_model) if k == 2 else row for k, row in enumerate(upright)]
    verdict = track_verdict(mixed, "mm")
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "picture")
    assert verdict.reason.startswith("f2: the picture is turned by 180 degrees against f1")
    assert ["turned" in row.reason for row in with_misfits(mixed)] == [False, False, True, False, False]
    # A model that rolls before the camera, a quarter of a turn from image to image, is none.
    rolled = [Pose.from_rotvec([0, 0, 0.5 * np.pi * k], [0, 0, 0]) @ poses[0] for k in range(5)]
    assert track_verdict([replace(r, cam_from_model=p) for r, p in zip(every, rolled, strict=True)], "mm").word == GOOD


@pytest.mark.parametrize("words", ["frame 3 is coded from one that was lost from the film",
                                   "damaged: frame 4 is not whole, or a frame that it is coded from"])  # fmt: skip
def test_frames_that_a_film_lost_are_the_files_fault(words):
    lost = replace(series([0.0])[0], cam_from_model=None, status="lost", reason=f"a.mp4: {words}")
    verdict = track_verdict([*series([0.0] * 5), lost], "mm")
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "file")
    assert "copy the film from the camera again" in verdict.next_step


def test_half_of_the_images_may_be_torn_and_no_table_is_blamed():
    verdict = track_verdict(series([0.01, 0.02, 0.02, 0.25, 0.24, 0.3]), "mm")
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "picture")
    assert "f5 (and 2 more of 6 images)" in verdict.reason


def test_images_that_noise_or_what_all_have_in_common_explains_do_not_stand_out():
    # What 6 markers of 1000 images make of noise: the largest of the misfits is twice the noise and more.
    rng = np.random.default_rng(0)
    excess = np.sqrt(np.maximum(rng.chisquare(6, 1000) / 6 - 1, 0)) * 0.1
    assert excess.max() > 0.15
    assert misfits(series(excess, spot=0.1, matched=6)) == {}
    assert track_verdict(series(np.linspace(0.0, 0.09, 50)), "mm").word == GOOD  # a lens, and a model that moves
    assert misfits(series([0.2] * 20 + [0.25] * 5)) == {}  # a table that is off is told by the verdict, of all
    assert misfits(series([0.3])) == {}


def test_mirrored_pictures_of_a_sequence_are_named(tunnel):
    """"16 of 16 markers could be chance", and to give it more time."""
    image = tunnel.shot("wind-off").image[:, ::-1]
    markers = tunnel.markers.take(np.flatnonzero(tunnel.markers.role == "model"))
    options = FollowOptions(radius_px=(3.0,))
    frames = follow([("a", image), ("b", image)], markers, tunnel.cameras["cam1"], options=options)
    verdict = track_verdict([PoseRow.of(f) for f in frames], "mm")
    assert (verdict.word, verdict.cause) == (BAD, "mirrored"), verdict
    assert "mirror the picture" in verdict.next_step


def test_interlaced_pictures_are_said_of_the_whole_where_they_are_more_than_some():
    good = [("cam1", 0.0)] * 20 + [("cam2", 0.08)] * 20
    assert series_fields(good) == []
    assert series_fields([*good, ("cam1", 0.8)]) == []
    (found,) = series_fields([*good, *[("cam1", 0.8), ("cam1", 1.2), ("cam1", 0.7)]])
    assert (found.word, found.cause) == (DOUBTFUL, "interlaced")
    assert "3 of 23 pictures of cam1 are interlaced" in found.reason
    assert "1.2 px" in found.reason


def test_an_interlaced_picture_is_told(tunnel):
    shot = tunnel.shot("wind-off")
    use = shot.perfect.markers.visible & (tunnel.markers.role == "model")
    spots = Detections.make(shot.perfect.markers.xy[use], radius_px=np.full(int(use.sum()), 4.0), sigma_px=0.02)
    assert not [f for f in picture_findings(picture_state(shot.image, spots, "dark")) if f.cause == "interlaced"]
    combed = shot.image.copy()
    combed[1::2] = np.roll(combed, 1, axis=1)[1::2]
    (found,) = [f for f in picture_findings(picture_state(combed, spots, "dark")) if f.cause == "interlaced"]
    assert found.word == DOUBTFUL


# --- two pictures that are matched ------------------------------------------------------------------
def matched(seed=7, noise=0.01, **off):
    camera = sweep.scenes.CAMERA
    _, _, places = sweep.pictures("block", seed, camera, noise)
    spots = tuple(Detections.make(s, sigma_px=noise) for s in places)
    clicks = Clicks(places[0][:12], places[1][:12], tuple(str(k) for k in range(12)))
    other = replace(camera, cov=None, **{k: getattr(camera, k) + v for k, v in off.items()})
    result = clicked_pair(*spots, clicks, (other, other))
    return result, pair_verdict(result, clicks, spots, (other, other))


@pytest.mark.parametrize("seed", [7, 8, 9, 11])
def test_the_right_cameras_of_a_pair_are_not_doubted(seed):
    result, verdict = matched(seed)
    assert result, result.reason
    assert verdict.word == GOOD, verdict


@pytest.mark.parametrize(("off", "cause"), [
    ({"focal_px": 200.0}, "lens"), ({"k1": 0.03}, "lens"), ({"k1": 0.1}, "noise"), ({"cy": 40.0}, "lens"),
])  # fmt: skip
def test_another_camera_of_a_pair_is_told_by_what_is_left(off, cause):
    """A lens that is ten times farther off than its prior says is left to scatter."""
    result, verdict = matched(**off)
    assert result, result.reason
    assert (verdict.word, verdict.cause) == (DOUBTFUL, cause), verdict
    assert "times their spots' sigma" in verdict.reason


def test_a_pair_that_is_refused_is_bad_with_a_step():
    camera = sweep.scenes.CAMERA
    _, _, places = sweep.pictures("block", 7, camera, 0.1)
    spots = tuple(Detections.make(s, sigma_px=0.1) for s in places)
    clicks = Clicks(places[0][:4], places[1][:4], tuple("abcd"))
    verdict = pair_verdict(clicked_pair(*spots, clicks, (camera, camera)), clicks, spots, (camera, camera))
    assert (verdict.word, verdict.cause) == (BAD, "few")
    assert "seven are needed" in verdict.reason
    assert "match more markers" in verdict.next_step


def test_a_wrong_match_is_told_by_what_the_others_leave():
    """A tenth of a pixel was taken for all cameras: 0.3 px off the line was 3 sigmas where the others leave 0.01 px."""
    camera = sweep.scenes.CAMERA
    _, _, (a, b) = sweep.pictures("block", 7, camera, 0.01)
    free = 14
    b[free] += [0.35, -0.35]
    spots = tuple(Detections.make(s, sigma_px=0.01) for s in (a, b))
    clicks = Clicks(a[:12], b[:12], tuple(str(k) for k in range(12)))
    result = clicked_pair(*spots, clicks, (camera, camera))
    assert result, result.reason
    assert free not in result.spot_a.tolist()
    assert np.abs(result.distance_px).max() < 0.06


# --- a grid beside its markers ----------------------------------------------------------------------
@pytest.mark.parametrize(
    ("move", "word", "says"),
    [
        (lambda p, s: p, None, ""),
        (lambda p, s: p + np.array([0, 0, 2e-3 * s]), DOUBTFUL, "where it is shifted by"),
        (lambda p, s: 1.005 * p, DOUBTFUL, "smaller"),
        (lambda p, s: p[:, [0, 2, 1]] * [1, 1, -1], BAD, "with its x, -z, y as x, y, z it goes through them"),
        ("thicker", DOUBTFUL, "off the grid's surface"),
    ],
)
def test_a_grid_that_is_not_where_the_markers_are_is_told(tunnel, move, word, says):
    if move == "thicker":
        normals = tunnel.mesh.vertex_normals()
        skin = 3e-3 * tunnel.mesh.size * normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        mesh = replace(tunnel.mesh, vertices=tunnel.mesh.vertices + skin)
    else:
        mesh = replace(tunnel.mesh, vertices=move(tunnel.mesh.vertices, tunnel.mesh.size))
    found = grid_findings(tunnel.markers, mesh, "mm")
    if word is None:
        assert found == []
        return
    (one,) = found
    assert (one.word, one.cause) == (word, "grid")
    assert says in one.reason


def test_a_doubted_grid_under_a_given_pose_is_no_bad_result(tunnel):
    """Nothing was to be registered, so the grid kept nothing from it."""
    mesh = replace(tunnel.mesh, vertices=tunnel.mesh.vertices + np.array([0, 0, 2e-3 * tunnel.mesh.size]))
    bright = np.clip(np.random.default_rng(6).normal(200, 40, (60, 80)), 0, 255).astype(np.uint8)
    given = ImageResult("a", bright, tunnel.cameras["cam1"])  # clipped: a doubt of its own
    project = SimpleNamespace(length_unit="mm", section=())
    result = SimpleNamespace(images=(given,), markers=tunnel.markers, mesh=mesh, project=project, lost_views=(),
                             merged=(), unknown_sides=(), look=None)  # fmt: skip
    verdict = run_verdict(result)
    assert [f.cause for f in verdict.findings] == ["saturated", "grid", "few"]
    assert verdict.word == DOUBTFUL
