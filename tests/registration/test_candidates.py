"""Three markers leave up to four poses, a fourth decides."""

import numpy as np
import pytest

from windmark.geometry import Camera, DegenerateGeometry, Pose
from windmark.registration import pose_candidates

CAMERA = Camera((1280, 1024), 1800, 1.001, 640, 500, k1=-0.1, k2=0.05)
POSE = Pose.look_at([150.0, -250.0, 900.0], np.zeros(3), [0, 1, 0])


def scene(rng, count=4):
    xyz = rng.uniform(-150, 150, (count, 3))
    return CAMERA.project(POSE.apply(xyz))[0], xyz


def test_the_truth_is_among_them_and_a_fourth_marker_finds_it():
    rng = np.random.default_rng(1)
    counts = []
    for _ in range(200):
        xy, xyz = scene(rng)
        three = pose_candidates(xy[:3], xyz[:3], CAMERA)
        assert three.decided is None
        assert min(pose.angle_to(POSE) for pose in three.cam_from_model) < 1e-6
        np.testing.assert_allclose(three.residual_px, 0, atol=1e-6)
        counts.append(len(three))
        four = pose_candidates(xy, xyz, CAMERA)
        assert len(four) == len(three)
        assert four.cam_from_model[0].angle_to(POSE) < 1e-6
        if four.decided is not None:
            assert four.decided.angle_to(POSE) < 1e-6
    # "It exists always two solutions and sometimes four": behind the camera some of them fall away.
    assert set(counts) <= {1, 2, 3, 4}
    assert 4 in counts


def test_a_sigma_means_what_it_says():
    """The fourth marker's distance from the true candidate follows chi with two degrees of freedom."""
    rng = np.random.default_rng(2)
    found = []
    for _ in range(600):
        xy, xyz = scene(rng)
        noisy = pose_candidates(xy + rng.normal(0, 0.02, xy.shape), xyz, CAMERA, sigma_px=0.02)
        near = [k for k, pose in enumerate(noisy.cam_from_model) if pose.angle_to(POSE) < np.radians(0.5)]
        if len(near) == 1:
            found.append(noisy.sigmas[near[0], 3])
    square = np.square(found)
    assert len(found) > 500
    assert 0.85 < np.median(square) / (2 * np.log(2)) < 1.15
    assert (np.array(found) > 4).mean() < 0.01


def test_a_wrong_fourth_label_leaves_none():
    rng = np.random.default_rng(3)
    xy, xyz = scene(rng, 5)
    wrong = xy[[0, 1, 2, 4, 3]]
    answer = pose_candidates(wrong, xyz, CAMERA)
    assert answer.decided is None
    assert not answer.compatible.any()


def test_degenerate_and_wrong_input():
    line = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]) * 50
    xy = CAMERA.project(POSE.apply(line))[0]
    with pytest.raises(DegenerateGeometry, match="collinear"):
        pose_candidates(xy, line, CAMERA)
    good, xyz = scene(np.random.default_rng(4))
    for bad_xy, bad_xyz, words in (
        (good[:2], xyz[:2], "at least 3"), (good, xyz[:3], "xyz must be"), (good * np.nan, xyz, "finite"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=words):
            pose_candidates(bad_xy, bad_xyz, CAMERA)
    with pytest.raises(ValueError, match="sigma_px"):
        pose_candidates(good, xyz, CAMERA, sigma_px=0)
