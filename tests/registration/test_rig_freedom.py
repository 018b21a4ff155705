"""Rigs with all that one camera has: free focal lengths, covariances, labels, occlusion, deformed models."""

from dataclasses import replace

import numpy as np
import pytest
import registration_scenes as scenes
from bent_scenes import Bend, bent_xyz

from windmark.geometry import Pose
from windmark.registration import RigRegistration, register, register_rig
from windmark.scene import MarkerSet


def assert_right(found, rig, missing=0):
    """All labels right, at most so many missing, every visible marker of each camera projected to within 2 px."""
    assert found, found.reason
    for c, (view, matching) in enumerate(zip(rig.views, found.matchings, strict=True)):
        assert scenes.wrong_labels(matching.detection, matching.marker, view) == 0
        assert scenes.pose_error_px(found.cam_from_model(c), view) < 2.0
    assert sum(found.counts) >= sum((view.label >= 0).sum() for view in rig.views) - missing


def test_register_takes_the_cameras_of_a_rig():
    """The same verb and options; several images without their cameras' places are an error."""
    rig = scenes.rig_scene(511, "A", 2, hidden=0.5, false=1.0)
    spots, markers, cameras, poses = rig.arguments()
    found, same = register(spots, markers, cameras, cam_from_rig=poses), register_rig(*rig.arguments())
    assert isinstance(found, RigRegistration)
    np.testing.assert_array_equal(found.rig_from_model.translation, same.rig_from_model.translation)
    np.testing.assert_array_equal(found.cov, same.cov)
    with pytest.raises(ValueError, match="several images need cam_from_rig"):
        register(spots, markers, cameras)
    with pytest.raises(ValueError, match="for each of 2 cameras, got 1"):
        register(spots, markers, cameras, cam_from_rig=poses, fixed=[None])


def test_a_free_focal_length_of_one_camera_is_found():
    """Given 12 % too long; the other camera's is given, and stays."""
    rig = scenes.rig_scene(540, "B", 2, hidden=0.25, false=0.5)
    spots, markers, cameras, poses = rig.arguments()
    true = cameras[1].focal_px
    wrong = [cameras[0], replace(cameras[1], focal_px=1.12 * true)]
    refused = register_rig(spots, markers, wrong, poses)
    assert not refused
    found = register_rig(spots, markers, wrong, poses, free_focal=[False, True])
    assert_right(replace_cameras(found, cameras), rig, missing=1)
    assert found.cameras[0] == cameras[0]
    sigma = np.sqrt(found.cameras[1].cov[0, 0])
    assert found.cameras[1].focal_px == pytest.approx(true, abs=4 * sigma)
    assert sigma < 0.01 * true
    assert [u.camera for u in found.unchecked if u.what == "focal length"] in ([], [0])


def replace_cameras(found, cameras):
    """The registration, to be judged by its pose in the true cameras."""
    assert found, found.reason
    return replace(found, cameras=tuple(cameras))


def test_a_camera_is_found_within_its_covariance_beside_one_that_is_given():
    """A principal point that is 12 px off, and said to be uncertain by 10: known to a fraction of that from the rig."""
    rig = scenes.rig_scene(541, "B", 2, noise_px=0.1)
    spots, markers, cameras, poses = rig.arguments()
    cov = np.diag([0.0, 0.0, 100.0, 100.0, *[0.0] * 7])
    given = replace(cameras[1], cx=cameras[1].cx + 12.0, cov=cov)
    found = register_rig(spots, markers, [cameras[0], given], poses)
    assert found, found.reason
    after = np.sqrt(np.diag(found.cameras[1].cov)[2:4])
    assert (after < 3.0).all()
    assert found.cameras[1].cx == pytest.approx(cameras[1].cx, abs=4 * after[0])
    assert not register_rig(spots, markers, [cameras[0], replace(given, cov=None)], poses)


def test_labels_of_any_camera_decide():
    """A symmetric plate: which of its two ways round it is, one label of the second camera says."""
    xyz = np.stack(np.meshgrid(np.arange(6.0), np.arange(4.0), [0.0]), axis=-1).reshape(-1, 3)
    markers = MarkerSet.make([f"g{i}" for i in range(24)], xyz, normal=np.tile([0.0, 0.0, 1.0], (24, 1)))
    rng = np.random.default_rng(9)
    views = [scenes.image_of(rng, markers, *scenes.random_view(rng, markers), noise_px=0.1) for _ in range(2)]
    rig = scenes.RigScene(tuple(views), tuple(v.cam_from_model for v in views), Pose.identity())
    assert register_rig(*rig.arguments()).cause == "ambiguous"
    told = register_rig(*rig.arguments(), fixed=[None, {0: int(views[1].label[0])}], max_time_s=30.0)
    assert_right(told, rig)
    assert told.options["fixed"] == ({}, {0: f"g{views[1].label[0]}"})


def test_what_a_body_hides_is_asked_of_each_camera():
    rig = scenes.rig_scene(542, "B", 2, noise_px=0.2)
    spots, markers, cameras, poses = rig.arguments()
    asked = set()

    def visible(cam_from_model, camera):
        """The second camera sees no marker of the left wing."""
        asked.add(camera.focal_px)
        return (
            np.ones(60, bool) if camera.focal_px == cameras[0].focal_px else ~np.isin(np.arange(60), np.arange(15, 30))
        )

    found = register_rig(spots, markers, cameras, poses, visible=visible)
    assert found, found.reason
    assert asked == {camera.focal_px for camera in cameras}
    left = [np.isin(m.marker, np.arange(15, 30)).any() for m in found.matchings]
    plain = register_rig(spots, markers, cameras, poses)
    assert np.isin(plain.matchings[1].marker, np.arange(15, 30)).any()
    assert left == [np.isin(plain.matchings[0].marker, np.arange(15, 30)).any(), False]
    assert found.n_expected[1] < plain.n_expected[1]


def test_a_bent_wing_is_labelled_by_all_cameras_together():
    bend, rng = Bend(0.02), np.random.default_rng(44)
    rig = scenes.rig_scene(44, "B", 2, apart_deg=(40, 60))
    markers = rig.views[0].markers
    moved = replace(markers, xyz=bent_xyz(markers, "B", bend))
    views = [
        replace(scenes.image_of(rng, moved, v.camera, v.cam_from_model, hidden=0.25, false=0.25, noise_px=0.2),
                markers=markers)
        for v in rig.views
    ]  # fmt: skip
    bent = scenes.RigScene(tuple(views), rig.cam_from_rig, rig.rig_from_model)
    found = register_rig(*bent.arguments(), max_time_s=30.0)
    assert found, found.reason
    assert found.deformation is not None
    for view, matching in zip(views, found.matchings, strict=True):
        assert scenes.wrong_labels(matching.detection, matching.marker, view) == 0
    assert sum(found.counts) >= sum((view.label >= 0).sum() for view in views) - 1
    stiff = register_rig(*bent.arguments(), max_deformation=0.0, max_time_s=30.0)
    assert not stiff or sum(stiff.counts) < sum(found.counts)
