"""The verb `register_rig`: several cameras are one."""

from dataclasses import replace

import numpy as np
import pytest
import registration_scenes as scenes

import windmark as wm
from windmark.geometry import Pose, imaged_ellipse
from windmark.geometry.rotations import hat
from windmark.pipeline.verdict.reasons import EXCHANGED
from windmark.registration import NotRegistered, RigRegistration, prepare, register, register_rig
from windmark.scene import Detections, MarkerSet


def assert_right(found, rig, missing=0):
    """All labels right, at most so many missing, every visible marker of each camera projected to within 2 px."""
    assert found, found.reason
    for c, (view, matching) in enumerate(zip(rig.views, found.matchings, strict=True)):
        assert scenes.wrong_labels(matching.detection, matching.marker, view) == 0
        assert scenes.pose_error_px(found.cam_from_model(c), view) < 2.0
    assert sum(found.counts) >= sum((view.label >= 0).sum() for view in rig.views) - missing


def without(view, *markers):
    """The view with some markers hidden."""
    kept = ~np.isin(view.label, markers)
    return replace(view, detections=Detections.make(view.detections.xy[kept]), label=view.label[kept])


def turned(pose, degrees):
    return Pose.from_rotvec(np.radians(degrees) * np.array([0.6, 0.8, 0.0]), np.zeros(3)) @ pose


@pytest.mark.parametrize(("kind", "cameras"), [("A", 2), ("A", 3), ("B", 3)])
@pytest.mark.parametrize("seed", [501, 502])
def test_most_markers_hidden_and_as_many_false_spots(kind, cameras, seed):
    rig = scenes.rig_scene(seed, kind, cameras, hidden=0.7, false=1.0)
    assert_right(register_rig(*rig.arguments()), rig, missing=1)


@pytest.mark.parametrize("seed", [5_100_003, 5_100_026, 5_100_079])
def test_a_labelling_that_fits_as_widely_as_is_looked_is_no_rival(seed):
    """It takes false spots for markers in view of all cameras; a board that goes on beyond its table has sharp ones."""
    rig = scenes.rig_scene(seed, "A", 3, hidden=0.7, false=1.0)
    assert_right(register_rig(*rig.arguments()), rig, missing=1)


def test_seven_of_24_markers_are_too_few_for_one_camera():
    rig = scenes.rig_scene(501, "A", 2, hidden=0.7, false=1.0)
    for view in rig.views:
        assert not register(view.detections, view.markers, view.camera)


@pytest.mark.parametrize(("kind", "hidden", "false"), [("A", 0.0, 0.0), ("A", 0.5, 1.0), ("B", 0.5, 1.0)])
def test_one_camera_is_as_register(kind, hidden, false):
    for seed in range(510, 514):
        rig = scenes.rig_scene(seed, kind, 1, hidden=hidden, false=false)
        spots, markers, cameras, poses = rig.arguments()
        one, found = register(spots[0], markers, cameras[0]), register_rig(*rig.arguments())
        assert one
        assert found
        np.testing.assert_array_equal(found.matchings[0].detection, one.matching.detection)
        np.testing.assert_array_equal(found.matchings[0].marker, one.matching.marker)
        delta = (found.cam_from_model(0) @ one.cam_from_model.inverse()).log()
        assert delta @ np.linalg.solve(one.cov, delta) < 1e-3
        assert found.excess_px[0] == pytest.approx(one.excess_px, abs=0.01)
        assert found.score == pytest.approx(one.score, abs=0.1)
        assert found.log10_nfa == pytest.approx(one.log10_nfa, abs=0.1)
        assert found.n_expected == (one.n_expected,)
        # The covariance of the rig's pose, moved into the camera's frame.
        turn = poses[0].rotation
        moved = np.zeros((6, 6))
        moved[:3, :3] = moved[3:, 3:] = turn
        moved[3:, :3] = hat(poses[0].translation) @ turn
        np.testing.assert_allclose(np.sqrt(np.diag(moved @ found.cov @ moved.T)), np.sqrt(np.diag(one.cov)), rtol=0.02)


def test_fields_describe_the_result():
    rig = scenes.rig_scene(520, "A", 3, hidden=0.25, false=0.5)
    spots, markers, cameras, _ = rig.arguments()
    found = register_rig(*rig.arguments(), layout=prepare(markers))
    assert isinstance(found, RigRegistration)
    for c in range(3):
        matching = found.matchings[c]
        seen, _ = cameras[c].project(found.cam_from_model(c).apply(markers.xyz[matching.marker]))
        np.testing.assert_allclose(found.residuals[c], seen - spots[c].xy[matching.detection], atol=1e-9)
        np.testing.assert_allclose(matching.distance_px, np.linalg.norm(found.residuals[c], axis=1))
        assert (np.diff(matching.marker) > 0).all()
        assert found.n_expected[c] >= found.counts[c] == len(matching)
    every = np.concatenate(found.residuals)
    assert found.rms_px == pytest.approx(np.sqrt((every**2).sum(axis=1).mean()))
    assert found.cov.shape == (6, 6)
    assert found.excess_px.shape == (3,)
    assert found.log10_nfa < -9
    assert found.score > 60
    assert found.n_hypotheses > 0
    assert found.report.converged
    assert len(found.options["tolerance_px"]) == 3
    assert wm.register_rig is register_rig


@pytest.mark.slow
def test_covariance_is_the_scatter_of_the_poses():
    """Mean of the squared distance over its six degrees of freedom, 25 rigs: 1 within three sigma of the mean."""
    squares = []
    for seed in range(6000, 6025):
        rig = scenes.rig_scene(seed, "A", 2, hidden=0.5, false=0.5)
        found = register_rig(*rig.arguments())
        assert found
        delta = (rig.rig_from_model @ found.rig_from_model.inverse()).log()
        squares.append(delta @ np.linalg.solve(found.cov, delta) / 6)
    assert 0.65 < np.mean(squares) < 1.35


def test_more_cameras_make_the_pose_surer():
    rig = scenes.rig_scene(521, "A", 3)
    spots, markers, cameras, poses = rig.arguments()
    found = [register_rig(spots[:n], markers, cameras[:n], poses[:n]) for n in (1, 2, 3)]
    traces = [np.trace(np.linalg.inv(f.cov)) for f in found]
    assert traces[0] < traces[1] < traces[2]


def test_cameras_without_spots_or_with_few_take_little_part():
    rig = scenes.rig_scene(522, "B", 3, hidden=0.25, false=0.5)
    spots, markers, cameras, poses = rig.arguments()
    nothing = Detections.make(np.zeros((0, 2)))
    found = register_rig([nothing, spots[1], nothing], markers, cameras, poses)
    assert found
    assert found.counts[0] == found.n_expected[0] == found.counts[2] == 0
    assert np.isnan(found.excess_px).tolist() == [True, False, True]
    alone = register(spots[1], markers, cameras[1])
    np.testing.assert_array_equal(found.matchings[1].detection, alone.matching.detection)
    few = np.flatnonzero(rig.views[0].label >= 0)[:2]
    found = register_rig([Detections.make(spots[0].xy[few]), *spots[1:]], markers, cameras, poses)
    assert found
    np.testing.assert_array_equal(found.matchings[0].marker[np.argsort(found.matchings[0].detection)],
                                  rig.views[0].label[few])  # fmt: skip
    assert register_rig([nothing] * 3, markers, cameras, poses).cause == "too_few"


def test_unlike_cameras():
    """Images of different sizes, a curved lens with oblong pixels, markers with a sigma, no normals."""
    rng = np.random.default_rng(3)
    plain = scenes.wing_and_body(rng)
    markers = replace(plain, sigma=np.full_like(plain.xyz, 2e-4), xyz=plain.xyz + rng.normal(0, 2e-4, plain.xyz.shape))
    views = []
    for size, lens in (((640, 480), {}), ((2560, 2000), {"k1": -0.1, "aspect": 1.02, "p1": 1e-3})):
        camera, pose = scenes.random_view(rng, plain, fov_deg=(30, 50), tilt_max_deg=30, size_px=size)
        views.append(scenes.image_of(rng, plain, replace(camera, **lens), pose, hidden=0.5, false=1.0))
    rig = scenes.RigScene(tuple(views), tuple(v.cam_from_model for v in views), Pose.identity())
    spots, _, cameras, poses = rig.arguments()
    for table in (markers, replace(markers, normal=np.full_like(plain.xyz, np.nan))):
        assert_right(register_rig(spots, table, cameras, poses), rig, missing=1)


def test_discs_are_seen_as_ellipses():
    """Detectors give the centre of the imaged ellipse; the residuals and the pose are as without the discs' size."""
    rig = scenes.rig_scene(528, "B", 2, noise_px=0.02)
    spots, markers, cameras, poses = rig.arguments()
    discs = replace(markers, radius=np.full(len(markers), 0.03))
    moved = []
    for view in rig.views:
        pose, xy = view.cam_from_model, view.detections.xy.copy()
        seen = imaged_ellipse(view.camera, pose.apply(discs.xyz), pose.rotate(discs.normal), discs.radius)
        true = view.label >= 0
        xy[true] += seen.eccentricity_px[view.label[true]]
        moved.append(Detections.make(xy, sigma_px=0.02))
    found, plain = register_rig(moved, discs, cameras, poses), register_rig(spots, markers, cameras, poses)
    assert_right(found, rig)
    delta = (found.rig_from_model @ plain.rig_from_model.inverse()).log()
    assert delta @ np.linalg.solve(plain.cov, delta) < 0.1
    assert found.rms_px == pytest.approx(plain.rms_px, rel=0.02)
    ignored = register_rig(moved, markers, cameras, poses)
    assert ignored.rms_px > 1.5 * found.rms_px


def test_what_one_camera_cannot_tell_another_one_can():
    """A grid whose only irregular marker (8; half a turn brings it onto 15) the first camera does not see."""
    xyz = np.stack(np.meshgrid(np.arange(6.0), np.arange(4.0), [0.0]), axis=-1).reshape(-1, 3)
    xyz[8, :2] += (0.3, 0.12)
    markers = MarkerSet.make([f"g{i}" for i in range(24)], xyz, normal=np.tile([0.0, 0.0, 1.0], (24, 1)))
    rng = np.random.default_rng(8)
    views = [scenes.image_of(rng, markers, *scenes.random_view(rng, markers), noise_px=0.1) for _ in range(2)]
    views[0] = without(views[0], 8, 15)
    rig = scenes.RigScene(tuple(views), tuple(v.cam_from_model for v in views), Pose.identity())
    spots, _, cameras, poses = rig.arguments()
    assert register(spots[0], markers, cameras[0]).cause == "ambiguous"
    assert_right(register_rig(*rig.arguments()), rig)
    refused = register_rig([spots[0], without(views[1], 8, 15).detections], markers, cameras, poses)
    assert refused.cause == "ambiguous"
    assert refused.runner_up is not None


@pytest.mark.parametrize("degrees", [0.5, 3.0, 30.0])
def test_a_camera_that_is_not_where_the_rig_says_is_named(degrees):
    rig = scenes.rig_scene(523, "B", 3, hidden=0.25, false=0.5)
    spots, markers, cameras, poses = rig.arguments()
    refused = register_rig(spots, markers, cameras, [poses[0], turned(poses[1], degrees), poses[2]])
    assert isinstance(refused, NotRegistered)
    assert refused.cause == "wrong_camera"
    assert "camera 1 is not where cam_from_rig says" in refused.reason
    assert_right(register_rig(spots[::2], markers, cameras[::2], poses[::2]), replace(rig, views=rig.views[::2]))


def test_a_wrong_focal_length_of_one_camera_is_no_registration():
    rig = scenes.rig_scene(524, "A", 2)
    spots, markers, cameras, poses = rig.arguments()
    wrong = [cameras[0], replace(cameras[1], focal_px=1.2 * cameras[1].focal_px)]
    assert register_rig(spots, markers, wrong, poses).cause == "wrong_focal"
    alone = register_rig(spots[1:], markers, wrong[1:], poses[1:])
    assert alone.cause == register(spots[1], markers, wrong[1]).cause


@pytest.mark.slow
def test_clutter_and_other_models_are_refused():
    for seed in (530, 531):
        rig = scenes.rig_scene(seed, "A", 2)
        spots, markers, cameras, poses = rig.arguments()
        other = scenes.scene(seed + 5000, "B").markers
        assert not register_rig(spots, other, cameras, poses)
        rng = np.random.default_rng(seed)
        clutter = [Detections.make(rng.uniform(0, 1, (60, 2)) * camera.size_px) for camera in cameras]
        refused = register_rig(clutter, markers, cameras, poses)
        assert refused.cause in ("weak", "nothing", "time")
        assert refused.reason


def test_prior_is_a_pose_of_the_rig():
    rig = scenes.rig_scene(525, "A", 2, hidden=0.5, false=1.0)
    near = turned(rig.rig_from_model, 5.0)
    assert_right(register_rig(*rig.arguments(), prior=near), rig)
    far = rig.rig_from_model @ Pose.from_rotvec([0.0, 0.0, 1.5], np.zeros(3))
    assert not register_rig(*rig.arguments(), prior=far)


def test_time_limit_is_an_honest_refusal():
    rig = scenes.rig_scene(526, "B", 2, hidden=0.7, false=1.0)
    refused = register_rig(*rig.arguments(), max_time_s=1e-6)
    assert refused.cause == "time"
    assert "max_time_s" in refused.reason or "unknown" in refused.reason


def test_bad_input_is_named():
    rig = scenes.rig_scene(527, "A", 2)
    spots, markers, cameras, poses = rig.arguments()
    with pytest.raises(ValueError, match="got 2, 2 and 1"):
        register_rig(spots, markers, cameras, poses[:1])
    with pytest.raises(ValueError, match="got 0, 0 and 0"):
        register_rig([], markers, [], [])
    batch = Pose(np.stack([np.eye(3)] * 2), np.zeros((2, 3)))
    with pytest.raises(ValueError, match=r"cam_from_rig\[1\] must be a single pose"):
        register_rig(spots, markers, cameras, [poses[0], batch])
    with pytest.raises(ValueError, match="register_rig: prior must be a single pose"):
        register_rig(*rig.arguments(), prior=batch)
    with pytest.raises(ValueError, match="register_rig: max_time_s must be > 0"):
        register_rig(*rig.arguments(), max_time_s=0.0)
    with pytest.raises(ValueError, match=r"detections\[0\].cov must be finite"):
        register_rig([replace(spots[0], cov=spots[0].cov * np.nan), spots[1]], markers, cameras, poses)
    with pytest.raises(ValueError, match="layout must be prepared from the same markers"):
        register_rig(*rig.arguments(), layout=prepare(scenes.scene(1, "B").markers))
    line = [Detections.make(np.stack([np.arange(9.0) * 50, np.full(9, 70.0)], axis=1)) for _ in spots]
    assert register_rig(line, markers, cameras, poses).cause == "degenerate"


def off_by(pose, sigma, rng):
    """A camera's place drawn with a covariance of so many radians, and so many lengths."""
    return Pose.exp(rng.normal(0, 1, 6) * sigma) @ pose


def test_two_cameras_cannot_tell_which_of_them_is_elsewhere():
    rig = scenes.rig_scene(523, "B", 2, hidden=0.25, false=0.5)
    spots, markers, cameras, poses = rig.arguments()
    refused = register_rig(spots, markers, cameras, [poses[0], turned(poses[1], 2.0)])
    assert refused.cause == "wrong_camera"
    assert "camera 0 or camera 1 is not where cam_from_rig says" in refused.reason


def test_cameras_are_counted_with_those_that_have_no_spots():
    """The first one is empty; the third is the second that takes part."""
    rig = scenes.rig_scene(523, "B", 4, hidden=0.25, false=0.5)
    spots, markers, cameras, poses = rig.arguments()
    given = [poses[0], poses[1], turned(poses[2], 3.0), poses[3]]
    empty = Detections.make(np.zeros((0, 2)))
    refused = register_rig([empty, *spots[1:]], markers, cameras, given)
    assert "camera 2 is not where cam_from_rig says" in refused.reason
    found = register_rig([empty, *spots[1:]], markers, cameras, poses)
    assert {u.camera for u in found.unchecked} <= {1, 2, 3}


def whitened(found, rig):
    delta = (rig.rig_from_model @ found.rig_from_model.inverse()).log()
    return delta @ np.linalg.solve(found.cov, delta) / 6


@pytest.mark.slow
def test_a_place_that_is_slightly_off_is_in_the_sigma_and_said():
    """One camera of three turned by 0.3 px, which is three sigma of a spot."""
    chi2, said = [], 0
    for seed in range(9000, 9006):
        rig = scenes.rig_scene(seed, "B", 3, noise_px=0.1, hidden=0.3, false=0.3)
        spots, markers, cameras, poses = rig.arguments()
        angle = float(np.degrees(0.3 / cameras[1].focal_px))
        found = register_rig(spots, markers, cameras, [poses[0], turned(poses[1], angle), poses[2]])
        assert found, found.reason
        chi2.append(whitened(found, rig))
        said += any(u.what in ("place in the rig", "principal point") for u in found.unchecked)
    assert said >= 5
    assert np.median(chi2) < 2.0


@pytest.mark.slow
def test_a_covariance_of_the_places_is_used():
    """Places that are off by 2 px, and said to be so uncertain: found with the pose, whose sigma is true."""
    chi2 = []
    for seed in range(570, 578):
        rig, rng = scenes.rig_scene(seed, "B", 3, noise_px=0.1), np.random.default_rng(seed)
        spots, markers, cameras, poses = rig.arguments()
        distance = np.linalg.norm(rig.views[0].cam_from_model.translation)
        sigma = np.repeat([2.0 / cameras[0].focal_px, 1e-3 * distance], 3)
        given, cov = [off_by(p, sigma, rng) for p in poses], np.diag(sigma**2)
        found = register_rig(spots, markers, cameras, given, rig_cov=[cov] * 3)
        assert found, found.reason
        chi2.append(whitened(found, rig))
        assert found.cam_from_rig[1].angle_to(given[1]) > 0
        for c, view in enumerate(rig.views):
            assert scenes.pose_error_px(found.cam_from_model(c), view) < 1.0
    assert 0.4 < np.mean(chi2) < 2.0
    with pytest.raises(ValueError, match=r"rig_cov\[0\] must be \(6, 6\)"):
        register_rig(*rig.arguments(), rig_cov=[np.eye(3), None, None])
    with pytest.raises(ValueError, match="for each camera of a rig"):
        register_rig(*rig.arguments(), rig_cov=[None])


@pytest.mark.parametrize("cameras", [2, 3])
def test_two_cameras_in_each_others_place_are_named(cameras):
    rig = scenes.rig_scene(523, "B", cameras, hidden=0.25, false=0.5)
    spots, markers, each, poses = rig.arguments()
    refused = register_rig(spots, markers, each, [poses[1], poses[0], *poses[2:]])
    assert refused.cause == "exchanged"
    assert "camera 0 and camera 1 are exchanged" in refused.reason
    assert EXCHANGED in refused.reason  # what the verdict on a series knows it by
