"""Two views against OpenCV and PoseLib on the same pairs."""

from __future__ import annotations

import cv2
import numpy as np
import poselib
import pytest

from windmark.geometry import Camera, Pose
from windmark.geometry.two_view import (
    essential_five_point,
    estimate_two_view,
    fundamental_eight_point,
    fundamental_seven_point,
    refine_homography,
    sampson_distance,
)

CAMERA = Camera((2000, 1500), 2200.0, 1.0, 1010.0, 740.0, k1=-0.12, k2=0.04, p1=5e-4)
COV = 0.2**2 * np.eye(2)


def pictures(seed, n=100, sigma=0.2, wrong=0.25, depth=0.5):
    """Pixels of both pictures and the relative pose with baseline 1."""
    rng = np.random.default_rng(seed)
    xyz = np.column_stack([rng.uniform(-1, 1, (n, 2)), rng.uniform(4 - depth, 4 + depth, n)])
    step = rng.normal(size=3) * [1, 1, 0.5]
    b_from_a = Pose.from_rotvec(rng.normal(size=3) * 0.1, 0.6 * step / np.linalg.norm(step))
    xy_a, xy_b = CAMERA.project(xyz)[0], CAMERA.project(b_from_a.apply(xyz))[0]
    xy_a, xy_b = xy_a + sigma * rng.normal(size=(n, 2)), xy_b + sigma * rng.normal(size=(n, 2))
    bad = rng.random(n) < wrong
    xy_b[bad] = rng.uniform(200, 1300, (int(bad.sum()), 2))
    return xy_a, xy_b, Pose(b_from_a.rotation, b_from_a.translation / np.linalg.norm(b_from_a.translation))


def errors(rotation, translation, truth):
    """Angles in degrees of the rotation and of the baseline to the truth."""
    t = np.ravel(translation) / np.linalg.norm(translation)
    turn = Pose(np.asarray(rotation), t).angle_to(truth)
    return np.degrees([turn, np.arctan2(np.linalg.norm(np.cross(t, truth.translation)), t @ truth.translation)])


def by_poselib(xy_a, xy_b):
    c = CAMERA
    params = [c.focal_px, c.focal_px * c.aspect, c.cx, c.cy, c.k1, c.k2, c.p1, c.p2]
    camera = {"model": "OPENCV", "width": 2000, "height": 1500, "params": params}
    pose, _ = poselib.estimate_relative_pose(xy_a, xy_b, camera, camera, {"max_epipolar_error": 0.6}, {})
    return pose.R, pose.t


def by_opencv(xy_a, xy_b):
    a, b = CAMERA.unproject(xy_a)[:, :2], CAMERA.unproject(xy_b)[:, :2]
    cv2.setRNGSeed(0)
    e, mask = cv2.findEssentialMat(a, b, np.eye(3), method=cv2.RANSAC, prob=0.9999, threshold=0.6 / CAMERA.focal_px)
    _, r, t, _ = cv2.recoverPose(e, a, b, np.eye(3), mask=mask)
    return r, t


def test_the_relative_pose_is_no_worse_than_theirs():
    found = {"windmark": [], "poselib": [], "opencv": []}
    for seed in range(12):
        xy_a, xy_b, truth = pictures(seed)
        view = estimate_two_view(xy_a, xy_b, CAMERA, cov_a=COV, cov_b=COV)
        assert view.model == "essential"
        found["windmark"].append(errors(view.b_from_a.rotation, view.b_from_a.translation, truth))
        found["poselib"].append(errors(*by_poselib(xy_a, xy_b), truth))
        found["opencv"].append(errors(*by_opencv(xy_a, xy_b), truth))
    rms = {name: np.sqrt(np.mean(np.square(e), axis=0)) for name, e in found.items()}
    assert (rms["windmark"] < 1.02 * rms["poselib"]).all()
    assert (rms["windmark"] < rms["opencv"]).all()


@pytest.mark.parametrize("seed", range(5))
def test_five_pairs(seed):
    """Every solution of OpenCV's and PoseLib's solvers is one of ours."""
    xy_a, xy_b, _ = pictures(seed, n=5, sigma=0.0, wrong=0.0)
    a, b = CAMERA.unproject(xy_a), CAMERA.unproject(xy_b)
    ours = essential_five_point(a, b)
    ours = ours[np.isfinite(ours[:, 0, 0])] / np.sqrt(2)
    theirs = [*cv2.findEssentialMat(a[:, :2], b[:, :2], np.eye(3), method=cv2.LMEDS)[0].reshape(-1, 3, 3)]
    unit = [rays / np.linalg.norm(rays, axis=1, keepdims=True) for rays in (a, b)]
    theirs += [np.cross(np.eye(3), p.t) @ p.R * -1 for p in poselib.relpose_5pt(list(unit[0]), list(unit[1]))]
    assert len(theirs) >= 2
    for e in theirs:
        e = e / np.linalg.norm(e)
        assert min(min(np.abs(e - o).max(), np.abs(e + o).max()) for o in ours) < 1e-6


def test_eight_points():
    xy_a, xy_b, _ = pictures(3, wrong=0.0)
    a, b = CAMERA.unproject(xy_a)[:, :2] * 1000, CAMERA.unproject(xy_b)[:, :2] * 1000
    theirs, _ = cv2.findFundamentalMat(a, b, cv2.FM_8POINT)
    np.testing.assert_allclose(
        np.abs(sampson_distance(fundamental_eight_point(a, b), a, b)), np.abs(sampson_distance(theirs, a, b)), atol=1e-3
    )


@pytest.mark.parametrize("seed", range(5))
def test_seven_points(seed):
    xy_a, xy_b, _ = pictures(seed, n=7, wrong=0.0)
    # OpenCV rounds to single precision: so both get rounded points.
    a, b = (CAMERA.unproject(xy)[:, :2].astype(np.float32).astype(float) for xy in (xy_a, xy_b))
    theirs = cv2.findFundamentalMat(a, b, cv2.FM_7POINT)[0].reshape(-1, 3, 3)
    ours = fundamental_seven_point(a, b)
    ours = ours[np.isfinite(ours[:, 0, 0])]
    assert len(ours) == len(theirs)
    for f in theirs / np.linalg.norm(theirs, axis=(1, 2), keepdims=True):
        assert min(min(np.abs(f - o).max(), np.abs(f + o).max()) for o in ours) < 1e-9


def test_homography_with_noise_in_one_picture():
    """OpenCV minimises the distances in b alone: the same where only b is noisy."""
    xy_a, _, _ = pictures(1, wrong=0.0)
    h = np.array([[1.1, 0.1, 20.0], [-0.05, 0.95, -10.0], [1e-4, -2e-4, 1.0]])
    q = xy_a @ h[:, :2].T + h[:, 2]
    xy_b = q[:, :2] / q[:, 2:] + np.random.default_rng(0).normal(0, 0.5, xy_a.shape)
    ours = refine_homography(xy_a, xy_b, 1e-8 * np.eye(2), np.eye(2)).matrix
    theirs, _ = cv2.findHomography(xy_a, xy_b, 0)
    np.testing.assert_allclose(ours / ours[2, 2], theirs, rtol=1e-4, atol=1e-7)
