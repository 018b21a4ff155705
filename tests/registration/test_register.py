"""The verb `register`: right where it can be, and a reasoned no where it cannot."""

from dataclasses import replace

import numpy as np
import pytest
import registration_scenes as scenes

import windmark as wm
from windmark.registration import CAUSES, NotRegistered, Registration, register
from windmark.scene import Detections, MarkerSet


def flat_grid(columns=6, rows=4):
    g = np.stack(np.meshgrid(np.arange(columns) * 1.0, np.arange(rows) * 1.0, [0.0]), axis=-1).reshape(-1, 3)
    return MarkerSet.make([f"g{i}" for i in range(len(g))], g, normal=np.tile([0.0, 0.0, 1.0], (len(g), 1)))


def assert_right(result, scene, missing=0):
    """All labels right, at most so many missing, every visible marker projected to within 2 px."""
    assert result, result.reason
    assert scenes.wrong_labels(result.matching.detection, result.matching.marker, scene) == 0
    assert len(result.matching) >= (scene.label >= 0).sum() - missing
    assert scenes.pose_error_px(result.cam_from_model, scene, result.camera) < 2.0


@pytest.mark.parametrize(
    ("kind", "hidden", "false"),
    [("A", 0.0, 0.0), ("A", 0.5, 1.0), ("A0", 0.25, 0.5), ("B", 0.25, 0.5), ("B", 0.5, 1.0)],
)
@pytest.mark.parametrize("seed", [7001, 7002, 7003])
def test_cold_start_labels_everything_and_nothing_wrong(kind, hidden, false, seed):
    scene = scenes.scene(seed, kind, hidden=hidden, false=false)
    assert_right(register(scene.detections, scene.markers, scene.camera), scene)


@pytest.mark.parametrize("seed", [9_910_000, 9_910_003, 9_910_006])
def test_one_vague_spot_neither_refuses_a_picture_nor_gives_it_a_wrong_pose(seed):
    """Spots that say too little of their noise, but for one that says 1 px: its variance hid what the others lacked,
    and the pose was 38 px off, or none.
    """
    scene = scenes.scene(seed, "A")
    cov = 1e-3 * scene.detections.cov
    cov[0] = np.eye(2)
    assert_right(register(replace(scene.detections, cov=cov), scene.markers, scene.camera), scene)


def test_one_wrong_of_few_pairs_does_not_open_the_gates_for_itself():
    # A false spot 2 px from where a hidden marker would be: with it the residuals of all are about 1 px.
    scene = scenes.scene(6_600_406, "A0", hidden=0.5, false=1.0)
    result = register(scene.detections, scene.markers, scene.camera)
    assert_right(result, scene)
    assert result.rms_px < 0.4


def test_fields_describe_the_result():
    scene = scenes.scene(11, "A", hidden=0.25, false=0.5)
    result = register(scene.detections, scene.markers, scene.camera, seed=4)
    assert isinstance(result, Registration)
    projected, _ = result.camera.project(result.cam_from_model.apply(scene.markers.xyz[result.matching.marker]))
    residuals = projected - scene.detections.xy[result.matching.detection]
    np.testing.assert_allclose(result.residuals, residuals, atol=1e-9)
    np.testing.assert_allclose(result.matching.distance_px, np.linalg.norm(residuals, axis=1))
    assert result.rms_px == pytest.approx(np.sqrt((residuals**2).sum(axis=1).mean()))
    assert (np.diff(result.matching.marker) > 0).all()
    assert result.n_expected >= len(result.matching)
    assert result.log10_nfa < -9
    assert result.score > 60
    assert result.n_hypotheses > 0
    assert result.report.converged
    assert result.options["seed"] == 4
    assert result.options["tolerance_px"] > 0
    assert result.cov.shape == (6, 6)
    assert wm.register is register


@pytest.mark.slow
def test_covariance_holds_the_truth():
    inside = []
    for seed in range(40):
        scene = scenes.scene(seed + 600, "A", hidden=0.25, false=0.25)
        result = register(scene.detections, scene.markers, scene.camera)
        assert result
        delta = (scene.cam_from_model @ result.cam_from_model.inverse()).log()
        inside.append(delta @ np.linalg.solve(result.cov, delta))
    # Chi-square with 6 degrees of freedom; the weak prior of the excess makes it a little wide on purpose.
    assert 0.75 < np.mean(np.array(inside) < 10.64) <= 1.0
    assert 2.0 < np.mean(inside) < 8.0


def test_lens_distortion_and_lost_corners():
    rng = np.random.default_rng(3)
    markers = scenes.wing_and_body(rng)
    camera, pose = scenes.random_view(rng, markers, fov_deg=(50, 60), k1=-0.25)
    scene = scenes.image_of(rng, markers, camera, pose, hidden=0.25, false=0.5)
    corners = Detections.make([[-400.0, -400.0], [1600.0, 1400.0]], sigma_px=0.2)
    assert not np.isfinite(camera.unproject(corners.xy)).any()
    spots = Detections.make(np.concatenate([corners.xy[:1], scene.detections.xy, corners.xy[1:]]), sigma_px=0.2)
    result = register(spots, markers, camera)
    assert result
    np.testing.assert_array_equal(scene.label[result.matching.detection - 1], result.matching.marker)


def test_markers_without_normals():
    for seed in (40, 41):
        for kind in ("A", "B"):
            scene = scenes.scene(seed, kind, hidden=0.25, false=0.5)
            bare = MarkerSet.make(scene.markers.name, scene.markers.xyz)
            assert_right(register(scene.detections, bare, scene.camera), scene)


def test_table_errors_of_pixels_are_estimated_not_refused():
    scene = scenes.scene(303, "B", hidden=0.25, false=0.5, noise_px=1.0)
    told_too_good = Detections.make(scene.detections.xy, sigma_px=0.05)
    result = register(told_too_good, scene.markers, scene.camera)
    assert_right(result, scene, missing=2)
    assert 0.7 < result.excess_px < 1.4
    # One pixel of error on the model, where it is.
    depth = np.median(result.cam_from_model.apply(scene.markers.xyz[result.matching.marker])[:, 2])
    assert result.off_table == pytest.approx(result.excess_px * depth / scene.camera.focal_px)
    assert np.sqrt(np.trace(result.cov[:3, :3])) > 3 * np.sqrt(
        np.trace(register(scenes.scene(303, "B", hidden=0.25, false=0.5, noise_px=0.1).detections,
                          scene.markers, scene.camera).cov[:3, :3])
    )  # fmt: skip


def test_known_marker_sigma_explains_the_misfit():
    rng = np.random.default_rng(9)
    markers = scenes.wing(rng)
    camera, pose = scenes.random_view(rng, markers)
    off = markers.xyz + rng.normal(0, 0.001, markers.xyz.shape)
    scene = scenes.image_of(rng, MarkerSet.make(markers.name, off, normal=markers.normal), camera, pose, noise_px=0.1)
    plain = register(scene.detections, markers, camera)
    told = register(scene.detections, replace(markers, sigma=np.full((24, 3), 0.001)), camera)
    assert plain.excess_px > 0.5
    assert told.excess_px < 0.6 * plain.excess_px


def test_doubtful_spots_behind_the_good_ones_do_no_harm():
    scene = scenes.scene(21, "A", hidden=0.25, noise_px=0.2)
    rng = np.random.default_rng(0)
    clutter = rng.uniform(0, 1, (500, 2)) * scene.camera.size_px
    spots = Detections.make(np.concatenate([scene.detections.xy, clutter]), sigma_px=0.2)
    result = register(spots, scene.markers, scene.camera)
    assert result
    true = result.matching.detection < len(scene.label)
    assert true.sum() == len(scene.label)
    assert (scene.label[result.matching.detection[true]] == result.matching.marker[true]).all()
    assert (~true).sum() <= 1


# --- a reasoned no ---------------------------------------------------------------------------


def assert_refused(result, cause):
    assert isinstance(result, NotRegistered)
    assert not result
    assert result.cause == cause, result.reason
    assert cause in CAUSES
    assert result.reason


@pytest.mark.parametrize("count", [0, 1, 3])
def test_too_few_spots_or_markers(count):
    scene = scenes.scene(1)
    few = register(scene.detections.take(np.arange(count)), scene.markers, scene.camera)
    assert_refused(few, "too_few")
    plural = "" if count == 1 else "s"
    assert f"{count} spot{plural}: " in few.reason
    few = register(scene.detections, scene.markers.take(np.arange(count)), scene.camera)
    assert_refused(few, "too_few")
    assert f"{count} marker{plural}: " in few.reason


def test_four_pairs_are_never_enough_without_a_prior():
    rng = np.random.default_rng(0)
    markers = scenes.wing(rng).take([0, 7, 14, 21])
    camera, pose = scenes.random_view(rng, markers)
    scene = scenes.image_of(rng, markers, camera, pose)
    result = register(scene.detections, markers, camera)
    assert not result
    assert result.cause in ("nothing", "weak")


def test_everything_on_one_line():
    scene = scenes.scene(1)
    s = np.linspace(0, 1, 20)[:, None]
    line = Detections.make([100.0, 50.0] + s * [800.0, 600.0])
    assert_refused(register(line, scene.markers, scene.camera), "degenerate")
    markers = MarkerSet.make([f"m{i}" for i in range(20)], s * [1.0, 2.0, 3.0])
    assert_refused(register(scene.detections, markers, scene.camera), "degenerate")


def test_coincident_points():
    scene = scenes.scene(1)
    assert_refused(register(Detections.make(np.full((9, 2), 100.0)), scene.markers, scene.camera), "degenerate")
    same = MarkerSet.make([f"m{i}" for i in range(9)], np.ones((9, 3)))
    assert_refused(register(scene.detections, same, scene.camera), "degenerate")


def test_doubled_spots_and_markers_still_work():
    scene = scenes.scene(7, noise_px=0.2)
    twice = Detections.make(np.concatenate([scene.detections.xy, scene.detections.xy[:4]]), sigma_px=0.2)
    result = register(twice, scene.markers, scene.camera)
    assert result
    label = np.concatenate([scene.label, scene.label[:4]])
    assert (label[result.matching.detection] == result.matching.marker).all()


@pytest.mark.parametrize("seed", range(4))
def test_pure_clutter(seed):
    rng = np.random.default_rng(seed)
    scene = scenes.scene(seed)
    clutter = Detections.make(rng.uniform(0, 1, (rng.integers(10, 60), 2)) * scene.camera.size_px, sigma_px=0.2)
    result = register(clutter, scene.markers, scene.camera, max_hypotheses=150_000)
    assert not result
    assert result.cause in ("weak", "nothing", "misfit")
    assert result.n_hypotheses > 0


@pytest.mark.parametrize("seed", range(4))
def test_picture_of_another_model(seed):
    rng = np.random.default_rng(seed)
    scene = scenes.scene(seed, "AB"[seed % 2])
    wrong = scenes.wing(rng) if seed % 2 else scenes.wing_and_body(rng)
    assert not register(scene.detections, wrong, scene.camera, max_hypotheses=150_000)


@pytest.mark.parametrize("seed", range(4))
def test_mirror_image(seed):
    scene = scenes.scene(seed, "A")
    flipped = scene.detections.xy * [-1, 1] + [scene.camera.size_px[0] - 1, 0]
    assert not register(Detections.make(flipped, sigma_px=0.2), scene.markers, scene.camera, max_hypotheses=150_000)


def test_symmetric_layout_is_ambiguous_until_a_prior_decides():
    rng = np.random.default_rng(0)
    grid = flat_grid()
    camera, pose = scenes.random_view(rng, grid)
    scene = scenes.image_of(rng, grid, camera, pose, hidden=0.1, false=0.3)
    result = register(scene.detections, grid, camera)
    assert_refused(result, "ambiguous")
    assert result.best_count >= 20
    assert result.runner_up.count == result.best_count
    assert not result.runner_up.same_labels
    angle = np.degrees(result.best_candidate.angle_to(result.runner_up.cam_from_model))
    assert angle == pytest.approx(180, abs=1)
    assert_right(register(scene.detections, grid, camera, prior=pose), scene)


def test_a_prior_that_does_not_tell_a_shift_is_not_asked_for_again():
    """A board that goes on beyond the picture on all sides: what is left to give is a label."""
    rng = np.random.default_rng(4)
    board = flat_grid(24, 18)
    middle = board.xyz.mean(axis=0)
    camera, off = wm.Camera((1000, 750), 2000.0), np.array([0.05, -0.1, 9.0 * np.ptp(board.xyz[:, 0]) / 23])
    pose = wm.Pose.look_at(middle + off, middle, [0, 1, 0])
    scene = scenes.image_of(rng, board, camera, pose)
    result = register(scene.detections, board, camera, prior=pose)
    assert_refused(result, "ambiguous")
    assert "give the label of a spot" in result.reason
    assert "prior pose" not in result.reason


def test_one_moved_marker_breaks_the_symmetry():
    rng = np.random.default_rng(1)
    grid = flat_grid()
    xyz = grid.xyz.copy()
    xyz[8, :2] += 0.4
    markers = MarkerSet.make(grid.name, xyz, normal=grid.normal)
    camera, pose = scenes.random_view(rng, markers)
    scene = scenes.image_of(rng, markers, camera, pose, false=0.3)
    result = register(scene.detections, markers, camera)
    assert_right(result, scene)
    assert 10 < result.score - result.runner_up.score < 60


def part_of_a_board(seed, labelled):
    """A part of 7 x 7 of a board of 15 x 15, with some of the spots in its middle labelled."""
    rng, number = np.random.default_rng(seed), np.arange(15.0)
    xyz = np.stack(np.meshgrid(number, number, [0.0]), axis=-1).reshape(-1, 3)
    board = MarkerSet.make([f"g{i}" for i in range(225)], xyz, normal=np.tile([0.0, 0.0, 1.0], (225, 1)))
    camera, centre = wm.Camera((1024, 1024), 1500.0), np.array([6.0, 8.0, 0.0])
    turn = wm.Pose.exp([0, 0, 0, *rng.normal(0, 0.1, 2), 0]).rotation @ np.diag([1.0, -1.0, -1.0])
    pose = wm.Pose(turn, np.array([0.0, 0.0, 10.5]) - turn @ centre)
    xy = camera.project(pose.apply(xyz))[0]
    seen = rng.permutation(np.flatnonzero(((xy > 8) & (xy < 1016)).all(axis=1)))
    spots = Detections.make(xy[seen] + rng.normal(0, 0.02, (len(seen), 2)), sigma_px=0.02)
    inner = np.flatnonzero(np.abs(xyz[seen] - centre).max(axis=1) < 1.5)[:labelled]
    return spots, board, camera, {int(spot): f"g{seen[spot]}" for spot in inner}, pose


@pytest.mark.parametrize(("tilt", "seed"), [(40, 1), (40, 2), (55, 0), (65, 3)])
def test_a_large_board_from_near_by_of_which_much_lies_behind_the_camera(tilt, seed):
    """Places of markers beside the camera are open by thousands of pixels, and the middle of all may be behind it."""
    rng, number, tilt = np.random.default_rng(seed), np.arange(25.0), np.radians(tilt)
    xyz = np.stack(np.meshgrid(number, number, [0.0]), axis=-1).reshape(-1, 3)
    board = MarkerSet.make([f"g{i}" for i in range(625)], xyz, normal=np.tile([0.0, 0.0, 1.0], (625, 1)))
    camera, centre = wm.Camera((1024, 1024), 1500.0), np.array([10.0, 12.0, 0.0])
    tilted = wm.Pose.from_rotvec([tilt, 0, 0], np.zeros(3)) @ wm.Pose.from_rotvec([0, 0, seed], np.zeros(3))
    turn = np.diag([1.0, -1.0, -1.0]) @ tilted.rotation
    pose = wm.Pose(turn, np.array([0.0, 0.0, 6.0]) - turn @ centre)
    there = pose.apply(xyz)
    xy = camera.project(there)[0]
    assert (there[:, 2] < 0).sum() > 50
    seen = rng.permutation(np.flatnonzero((there[:, 2] > 0) & ((xy > 8) & (xy < 1016)).all(axis=1)))
    spots = Detections.make(xy[seen] + rng.normal(0, 0.02, (len(seen), 2)), sigma_px=0.02)
    result = register(spots, board, camera, fixed={0: f"g{seen[0]}", 1: f"g{seen[1]}"})
    assert result, result.reason
    assert result.cam_from_model.angle_to(pose) < 1e-3


@pytest.mark.parametrize("seed", [0, 6, 8])
def test_a_camera_in_the_middle_of_markers_all_round(seed):
    """As on the walls of a test section: those beside the camera have no place, or one open by 1e12 px and more."""
    rng = np.random.default_rng(seed)
    xyz, wall = rng.uniform(-1, 1, (120, 3)), rng.integers(0, 3, 120)
    xyz[np.arange(120), wall] = np.sign(xyz[np.arange(120), wall])
    table = MarkerSet.make([f"w{i}" for i in range(120)], xyz * [2.0, 1.5, 1.5], sigma=np.full((120, 3), 1e-4))
    camera = wm.Camera((1200, 900), 600.0, k1=-0.05, k2=0.01)
    for eye in rng.uniform(-0.6, 0.6, (3, 3)):
        pose = wm.Pose.look_at(eye, eye + rng.normal(size=3), rng.normal(size=3))
        xy, valid = camera.project(pose.apply(table.xyz))
        seen = np.flatnonzero(valid & camera.in_image(xy))
        spots = Detections.make(xy[seen] + rng.normal(0, 0.1, (len(seen), 2)), sigma_px=0.1)
        result = register(spots, table, camera)
        assert result, result.reason
        assert (seen[result.matching.detection] == result.matching.marker).all()
        error = (result.cam_from_model @ pose.inverse()).log()
        assert error @ np.linalg.solve(result.cov, error) < 27  # 1e-4 by chance


@pytest.mark.parametrize("seed", [0, 3, 4, 8])
def test_a_spot_at_ninety_degrees_from_the_axis_of_a_fisheye_does_not_hide_the_others(seed):
    """It is 10^5 px off in the plane in which is searched; the cells of that became as wide as the model."""
    rng = np.random.default_rng(seed)
    xyz, wall = rng.uniform(-1, 1, (120, 3)), rng.integers(0, 3, 120)
    xyz[np.arange(120), wall] = np.sign(xyz[np.arange(120), wall])
    camera = wm.Camera((1200, 900), 300.0, lens="fisheye")
    eye = rng.uniform(-0.6, 0.6, 3)
    pose = wm.Pose.look_at(eye, eye + rng.normal(size=3), rng.normal(size=3))
    near = pose.inverse().apply(camera.directions(np.array([599.5 + 300 * np.radians(89.97), 449.5])))
    table = MarkerSet.make([f"w{i}" for i in range(121)], np.concatenate([xyz * [2.0, 1.5, 1.5], near[None]]))
    xy, valid = camera.project(pose.apply(table.xyz))
    seen = np.flatnonzero(valid & camera.in_image(xy))
    assert 120 in seen
    result = register(Detections.make(xy[seen] + rng.normal(0, 0.1, (len(seen), 2)), sigma_px=0.1), table, camera)
    assert result, result.reason
    assert (seen[result.matching.detection] == result.matching.marker).all()
    assert result.cam_from_model.angle_to(pose) < 1e-3


@pytest.mark.parametrize("seed", range(6))
def test_one_label_on_a_regular_board_does_not_tell_its_quarter_turns_apart(seed):
    spots, board, camera, labels, _ = part_of_a_board(seed, 1)
    assert_refused(register(spots, board, camera, fixed=labels), "ambiguous")
    spots, board, camera, labels, pose = part_of_a_board(seed, 2)
    result = register(spots, board, camera, fixed=labels)
    assert result, result.reason
    assert result.cam_from_model.angle_to(pose) < 1e-3


def test_two_poses_of_one_labelling_are_ambiguous():
    rng = np.random.default_rng(2)
    flat = scenes.wing(rng)
    flat = MarkerSet.make(flat.name, flat.xyz * [1, 1, 0], normal=np.tile([0.0, 0.0, 1.0], (24, 1)))
    camera = wm.Camera((1280, 1000), 1280 / (2 * np.tan(np.radians(0.25))))
    pose = wm.Pose.look_at(np.array([0.45, 0.5, 0.0]) + 600 * np.array([0.5, 0.3, 0.8]), [0.45, 0.5, 0.0], [0, 1, 0])
    scene = scenes.image_of(rng, flat, camera, pose, noise_px=0.5)
    result = register(scene.detections, flat, camera, tolerance_px=6.0)
    assert_refused(result, "ambiguous")
    assert result.runner_up.same_labels
    resolved = register(scene.detections, flat, camera, tolerance_px=6.0, prior=pose, prior_max_angle_deg=15)
    assert resolved
    assert (scene.label[resolved.matching.detection] == resolved.matching.marker).all()


def test_similar_model_is_a_misfit():
    rng = np.random.default_rng(50018)
    pictured = scenes.wing(rng)
    sheared = pictured.xyz * [1.05, 1.0, 1.0] + pictured.xyz[:, 1:2] ** 2 * [0.06, 0.0, 0.0]
    camera, pose = scenes.random_view(rng, pictured, tilt_max_deg=20)
    scene = scenes.image_of(rng, pictured, camera, pose)
    other = MarkerSet.make(pictured.name, sheared, normal=pictured.normal)
    result = register(scene.detections, other, camera, max_hypotheses=200_000)
    assert_refused(result, "misfit")
    assert "tolerance_px" in result.reason
    loose = register(scene.detections, other, camera, tolerance_px=40.0, max_table_error=0.5)
    assert (scene.label[loose.matching.detection] == loose.matching.marker).all()


def test_another_model_of_the_same_design_is_a_misfit_unless_its_table_may_be_that_wrong():
    """Rows that differ by a few percent of the markers' distance; all find their spots."""
    rng = np.random.default_rng(5)
    pictured, other = scenes.wing(rng), scenes.wing(rng)
    camera, pose = scenes.random_view(rng, pictured, tilt_max_deg=20)
    scene = scenes.image_of(rng, pictured, camera, pose, noise_px=0.2)
    result = register(scene.detections, other, camera, tolerance_px=60.0, max_hypotheses=50_000, max_time_s=20.0)
    assert_refused(result, "misfit")
    assert "same design" in result.reason
    told = replace(other, sigma=np.full((24, 3), 0.012))
    for markers, allowed in ((other, 0.2), (told, 0.025)):
        result = register(scene.detections, markers, camera, tolerance_px=60.0, max_table_error=allowed)
        assert result, result.reason
        assert (scene.label[result.matching.detection] == result.matching.marker).all()


@pytest.mark.parametrize("seed", range(4))
def test_a_tight_limit_on_the_table_judges_the_residuals_and_not_the_gates(seed):
    """The gates stay open by more than 0.1 % of the spacing for few pairs; that is no error of the table."""
    rng = np.random.default_rng(seed)
    markers = scenes.wing(rng)
    camera, pose = scenes.random_view(rng, markers)
    scene = scenes.image_of(rng, markers, camera, pose, noise_px=0.05)
    assert register(scene.detections, markers, camera, max_table_error=0.001)
    off = replace(scene.detections, xy=scene.detections.xy + rng.normal(0, 0.4, scene.detections.xy.shape))
    result = register(off, markers, camera, max_table_error=0.001)
    assert_refused(result, "misfit")
    assert 0.25 < float(result.reason.split("off their table by ")[1].split(" px")[0]) < 0.6


@pytest.mark.parametrize("kind", ["A", "B"])
def test_table_errors_of_one_percent_of_the_spacing_are_no_misfit(kind):
    scene, rng = scenes.scene(11, kind, hidden=0.25), np.random.default_rng(11)
    xyz = scene.markers.xyz
    apart = np.linalg.norm(xyz[:, None] - xyz[None], axis=2) + 1e9 * np.eye(len(xyz))
    markers = replace(scene.markers, xyz=xyz + rng.normal(0, 0.01 * np.median(apart.min(axis=1)), xyz.shape))
    assert_right(register(scene.detections, markers, scene.camera), scene)


# --- priors and focal length -------------------------------------------------------------------


def test_prior_rejects_the_truth_when_it_is_wrong():
    scene = scenes.scene(5, "A", hidden=0.25, false=0.25)
    pose = scene.cam_from_model
    turned = wm.Pose.from_rotvec([0, 0, np.radians(50)], [0, 0, 0]) @ pose
    refused = register(scene.detections, scene.markers, scene.camera, prior=turned, max_hypotheses=100_000)
    assert not refused
    assert_right(register(scene.detections, scene.markers, scene.camera, prior=turned, prior_max_angle_deg=60), scene)
    far = wm.Pose(pose.rotation, pose.translation * 1.6)
    assert not register(scene.detections, scene.markers, scene.camera, prior=far, max_hypotheses=100_000)
    assert_right(register(scene.detections, scene.markers, scene.camera, prior=far, prior_max_scale=2.0), scene)


def test_prior_lets_fewer_markers_suffice():
    rng = np.random.default_rng(2)
    markers = scenes.wing(rng).take([0, 3, 7, 10, 13, 16, 20, 23])
    camera, pose = scenes.random_view(rng, markers)
    scene = scenes.image_of(rng, markers, camera, pose, noise_px=0.2, false=0.5)
    alone = register(scene.detections, markers, camera)
    near = register(scene.detections, markers, camera, prior=pose, prior_max_angle_deg=10, prior_max_scale=1.1)
    assert not alone
    assert_right(near, scene)


@pytest.mark.parametrize("factor", [0.75, 1.0, 1.3])
def test_unknown_focal_length(factor):
    scene = scenes.scene(2, "B", hidden=0.25, false=0.5)
    camera = replace(scene.camera, focal_px=factor * scene.camera.focal_px)
    result = register(scene.detections, scene.markers, camera, free_focal=True)
    assert_right(result, scene)
    sigma = np.sqrt(result.cov[6, 6])
    assert abs(result.camera.focal_px - scene.camera.focal_px) < 4 * sigma < 0.1 * scene.camera.focal_px
    assert result.camera.cov[0, 0] == pytest.approx(result.cov[6, 6])


@pytest.mark.parametrize("seed", [9045, 9088])
def test_unknown_focal_length_meets_candidates_with_markers_beside_the_camera(seed):
    scene = scenes.scene(seed, "A0", hidden=0.5, false=1.0)
    factor = np.exp(np.random.default_rng(seed).uniform(-0.3, 0.3))
    camera = replace(scene.camera, focal_px=factor * scene.camera.focal_px)
    result = register(scene.detections, scene.markers, camera, free_focal=True)
    if result:
        assert_right(result, scene, missing=1)
    else:
        assert result.cause in ("weak", "focal", "ambiguous")


def test_unknown_focal_length_and_a_deformation_do_not_explain_a_wrong_labelling():
    scene = scenes.scene(921_155, "C", hidden=0.5, false=1.0)
    factor = np.exp(np.random.default_rng(921_155).uniform(-0.3, 0.3))
    camera = replace(scene.camera, focal_px=factor * scene.camera.focal_px)
    result = register(scene.detections, scene.markers, camera, free_focal=True)
    if result:
        assert scenes.pose_error_px(result.cam_from_model, scene, result.camera) < 5.0
    else:
        assert result.cause in ("weak", "focal", "time", "misfit", "ambiguous")


def test_frontal_plane_does_not_fix_the_focal_length():
    rng = np.random.default_rng(2)
    flat = scenes.wing(rng)
    flat = MarkerSet.make(flat.name, flat.xyz * [1, 1, 0], normal=np.tile([0.0, 0.0, 1.0], (24, 1)))
    camera = wm.Camera((1280, 1000), 2000.0, k1=-0.1)
    pose = wm.Pose.look_at([0.45, 0.5, 2.6], [0.45, 0.5, 0.0], [0, 1, 0])
    scene = scenes.image_of(rng, flat, camera, pose, noise_px=0.3)
    assert_right(register(scene.detections, flat, camera), scene)
    result = register(scene.detections, flat, camera, free_focal=True)
    assert_refused(result, "focal")
    assert "focal length" in result.reason
    assert result.best_count >= 20


# --- options -----------------------------------------------------------------------------------


def test_same_seed_same_result_and_other_seed_same_labels():
    scene = scenes.scene(77, "A", hidden=0.5, false=1.0)
    runs = [register(scene.detections, scene.markers, scene.camera, method="ransac", seed=s) for s in (0, 0, 1, 2)]
    assert runs[0].n_hypotheses == runs[1].n_hypotheses
    np.testing.assert_array_equal(runs[0].cam_from_model.translation, runs[1].cam_from_model.translation)
    np.testing.assert_array_equal(runs[0].cov, runs[1].cov)
    assert len({r.n_hypotheses for r in runs}) > 1
    for other in runs[2:]:
        np.testing.assert_array_equal(other.matching.detection, runs[0].matching.detection)
        np.testing.assert_allclose(other.cam_from_model.translation, runs[0].cam_from_model.translation, rtol=1e-6)


def test_limits_are_limits():
    scene = scenes.scene(11, "A", hidden=0.25, false=0.5)
    good = register(scene.detections, scene.markers, scene.camera)
    for name, value in (
        ("min_score", good.score + 1),
        ("max_log10_nfa", good.log10_nfa - 1),
        ("tolerance_px", 0.3),
    ):
        result = register(scene.detections, scene.markers, scene.camera, max_hypotheses=20_000, **{name: value})
        assert not result, name
    grid = flat_grid()
    rng = np.random.default_rng(0)
    camera, pose = scenes.random_view(rng, grid)
    assert register(scenes.image_of(rng, grid, camera, pose).detections, grid, camera, min_margin=0.0)


def test_time_limit_says_so():
    scene = scenes.scene(1)
    clutter = Detections.make(np.random.default_rng(0).uniform(0, 1000, (40, 2)), sigma_px=0.2)
    result = register(clutter, scene.markers, scene.camera, max_time_s=1e-9)
    assert_refused(result, "time")
    assert "max_time_s" in result.reason


def test_budget_is_kept():
    scene = scenes.scene(1)
    clutter = Detections.make(np.random.default_rng(0).uniform(0, 1000, (40, 2)), sigma_px=0.2)
    result = register(clutter, scene.markers, scene.camera, max_hypotheses=30_000)
    assert 30_000 <= result.n_hypotheses < 120_000  # the last batch is finished, and rivals of the best are tried


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"method": "icp"}, "method"),
        ({"tolerance_px": 0.0}, "tolerance_px"),
        ({"tolerance_px": np.nan}, "tolerance_px"),
        ({"prior_max_angle_deg": -1.0}, "prior_max_angle_deg"),
        ({"prior_max_scale": 0.3}, "prior_max_scale"),
        ({"focal_range": 1.0}, "focal_range"),
        ({"max_focal_sigma": 0.0}, "max_focal_sigma"),
        ({"max_time_s": 0.0}, "max_time_s"),
        ({"max_hypotheses": 0}, "max_hypotheses"),
        ({"min_margin": -1.0}, "min_margin"),
        ({"max_table_error": 0.0}, "max_table_error"),
    ],
)
def test_wrong_options_name_the_parameter(options, word):
    scene = scenes.scene(1)
    with pytest.raises(ValueError, match=word):
        register(scene.detections, scene.markers, scene.camera, **options)


def test_wrong_input_names_the_parameter():
    scene = scenes.scene(1)
    cov = scene.detections.cov.copy()
    cov[0, 0, 0] = np.nan
    with pytest.raises(ValueError, match="cov"):
        register(replace(scene.detections, cov=cov), scene.markers, scene.camera)
    poses = wm.Pose(np.stack([np.eye(3)] * 2), np.zeros((2, 3)))
    with pytest.raises(ValueError, match="prior"):
        register(scene.detections, scene.markers, scene.camera, prior=poses)


@pytest.mark.parametrize("seed", [100_305, 100_453, 101_140])
def test_a_few_scattered_markers_are_enough(seed):
    """9 and 11 of 24: no four neighbouring spots are near neighbours on the model, or a weak labelling looks alike."""
    scene = scenes.scene(seed, "A", hidden=0.5, false=1.0)
    assert_right(register(scene.detections, scene.markers, scene.camera), scene)


@pytest.mark.parametrize(
    ("seed", "factor"),
    [
        (1_830_082, 0.8),
        (1_830_451, 1.2),
        (1_830_505, 1.2),
        (1_830_793, 1.2),
        (920_242, 0.8),
        (920_081, 1.2),
        (4_830_846, 0.8),
        (4_830_873, 1.2),
        (4_831_008, 0.8),
        (6_600_327, 1.2),
    ],
)
def test_markers_that_fit_at_a_wrong_focal_length_are_refused(seed, factor):
    # 24 to 34 of 50 markers fitted within the gates, the others were 9 to 55 px off; of 920,081 all of 120 did.
    # Then come three in which 9 to 12 of 24 fitted a slight bending. In the last one a wrong label among ten right ones
    # held the focal length.
    hidden, false = ((0.0, 0.0), (0.25, 0.5), (0.5, 1.0))[seed // 3 % 3]
    scene = scenes.scene(seed, "ABC"[seed % 3], hidden=hidden, false=false)
    camera = replace(scene.camera, focal_px=scene.camera.focal_px * factor)
    result = register(scene.detections, scene.markers, camera)
    if result:  # half of 24 markers on a flat wing do not tell it, and the answer says so
        assert "focal length" in [u.what for u in result.unchecked]
        assert scenes.wrong_labels(result.matching.detection, result.matching.marker, scene) == 0
        return
    assert result.cause in ("wrong_focal", "weak", "misfit", "time"), result.reason


@pytest.mark.parametrize("factor", [0.8, 1.2])
def test_wrong_focal_length_is_named(factor):
    scene = scenes.scene(61, "B", hidden=0.25, false=0.5)
    wrong = replace(scene.camera, focal_px=factor * scene.camera.focal_px)
    result = register(scene.detections, scene.markers, wrong)
    assert_refused(result, "wrong_focal")
    assert "free_focal" in result.reason
    assert_right(register(scene.detections, scene.markers, wrong, free_focal=True), scene)


@pytest.mark.parametrize("kind", ["A", "C"])
def test_both_methods_agree(kind):
    scene = scenes.scene(62, kind, hidden=0.25, false=0.5)
    fast, slow = (register(scene.detections, scene.markers, scene.camera, method=m) for m in ("hash", "ransac"))
    assert_right(fast, scene, missing=1)
    np.testing.assert_array_equal(fast.matching.detection, slow.matching.detection)
    assert fast.cam_from_model.angle_to(slow.cam_from_model) < 1e-6


def test_time_limit_is_an_honest_refusal():
    rng = np.random.default_rng(0)
    scene = scenes.scene(63, "C")
    clutter = Detections.make(rng.uniform(0, 1, (300, 2)) * scene.camera.size_px, sigma_px=0.2)
    result = register(clutter, scene.markers, scene.camera, max_time_s=0.01)
    assert_refused(result, "time")
    assert "max_time_s" in result.reason


def test_five_hundred_markers_and_two_thousand_spots():
    rng = np.random.default_rng(4)
    xy = np.stack(np.meshgrid(np.arange(25.0), np.arange(20.0)), axis=-1).reshape(-1, 2)
    xyz = np.column_stack([xy + rng.uniform(-0.35, 0.35, xy.shape), rng.normal(0, 0.2, 500)])
    markers = MarkerSet.make([f"m{i}" for i in range(500)], xyz, normal=np.tile([0.0, 0.0, 1.0], (500, 1)))
    camera, pose = scenes.random_view(rng, markers, size_px=(2560, 2000), tilt_max_deg=40)
    scene = scenes.image_of(rng, markers, camera, pose, hidden=0.3, false=4.0, ranked=True, noise_px=0.2)
    result = register(scene.detections, markers, camera)
    assert result, result.reason
    assert scenes.pose_error_px(result.cam_from_model, scene) < 2
    assert len(result.matching) >= 0.99 * (scene.label >= 0).sum()


def test_work_is_counted_so_time_limits_no_answer():
    """The same refusal, after the same links, however slow the machine; a longer time lets it work more."""
    scene = scenes.scene(63, "B")
    clutter = Detections.make(np.random.default_rng(0).uniform(0, 1000, (80, 2)), sigma_px=0.2)
    first, second = (register(clutter, scene.markers, scene.camera) for _ in range(2))
    assert_refused(first, "weak")
    assert "max_time_s" in first.reason
    assert first.reason == second.reason
    assert first.n_hypotheses == second.n_hypotheses
    longer = register(clutter, scene.markers, scene.camera, max_time_s=5.0)
    assert longer.n_hypotheses > 1.5 * first.n_hypotheses


@pytest.mark.parametrize(("most", "told"), [(0.055, False), (0.07, True)])
def test_a_focal_length_read_out_of_the_distortion_is_as_good_as_the_lens(most, told):
    """Sigma 3.7 % with the lens as given, 6.3 % where it may be wrong by half a percent of the diagonal."""
    scene = scenes.scene(4_730_031, "A", noise_px=0.3)
    bent, on = replace(scene.camera, k1=-0.4), scene.label >= 0
    seen = scene.cam_from_model.apply(scene.markers.xyz[scene.label[on]])
    xy = np.array(scene.detections.xy)
    xy[on] += bent.project(seen)[0] - scene.camera.project(seen)[0]
    spots = Detections.make(xy, sigma_px=0.3)
    found = register(spots, scene.markers, bent, free_focal=True, max_focal_sigma=most)
    assert bool(found) is told
    assert found.cause == "focal" if not told else np.sqrt(found.cov[6, 6]) / found.camera.focal_px < 0.04


@pytest.mark.parametrize("seed", [4_730_031, 4_730_154])
def test_a_focal_length_is_as_certain_as_it_is_reported(seed):
    """The doubt about labels that are accepted has no place in the sigma by which it is judged."""
    scene = scenes.scene(seed, "A", hidden=0.25 if seed == 4_730_031 else 0.0, false=0.5 if seed == 4_730_031 else 0.0)
    result = register(scene.detections, scene.markers, scene.camera, free_focal=True)
    assert result, result.reason
    sigma = np.sqrt(result.cov[6, 6]) / result.camera.focal_px
    assert 0.03 < sigma < 0.05
    least = 0.99 * sigma
    refused = register(scene.detections, scene.markers, scene.camera, free_focal=True, max_focal_sigma=least)
    assert refused.cause == "focal"
