"""What a view sees of the points and what it weighs: the kernels beside their readable twins."""

import numpy as np
import pytest

from windmark.deformation import _kernels
from windmark.deformation._kernels import see
from windmark.deformation.sighting import Sight, by_place, camera_block, pose_block, whiteners
from windmark.geometry import Camera, Pose
from windmark.geometry.rotations import hat


def slow(camera, pose, place, by_model, row, xy, first, by_pose, by_focal, residual, jacobian):
    seen = pose.apply(place[row])
    found, valid, by_seen = camera.point_jacobian(seen)
    if not valid.all():
        return False
    rows = slice(first, first + 2)
    residual[row, rows] = found - xy
    jacobian[row, rows, : by_model.shape[2]] = by_seen @ pose.rotation @ by_model[row]
    if by_pose >= 0:
        jacobian[row, rows, by_pose : by_pose + 6] = np.concatenate([-(by_seen @ hat(seen)), by_seen], axis=-1)
    if by_focal >= 0:
        jacobian[row, rows, by_focal] = (found - [camera.cx, camera.cy]) / camera.focal_px
    return True


@pytest.mark.parametrize(("by_pose", "by_focal"), [(-1, -1), (5, -1), (-1, 11), (5, 11)])
def test_the_kernel_is_its_twin(by_pose, by_focal):
    rng = np.random.default_rng(1)
    camera = Camera((1280, 800), 1400.0, aspect=1.01, k1=-0.12, k2=0.05, p1=4e-4, p2=-3e-4, tilt_x=0.03, tilt_y=-0.02)
    pose = Pose.exp([0.2, -0.1, 0.3, 0.1, -0.2, 9.0])
    place, by_model = rng.uniform(-2, 2, (30, 3)), rng.normal(size=(30, 3, 5))
    row = rng.permutation(30)[:20]
    xy = rng.uniform(0, 800, (20, 2))
    known = row, xy, 2, by_pose, by_focal
    fast, twin = ((np.zeros((30, 4)), np.zeros((30, 4, 12))) for _ in range(2))
    assert see(camera.packed(), pose.rotation, pose.translation, place, by_model, *known, *fast)
    assert slow(camera, pose, place, by_model, *known, *twin)
    np.testing.assert_allclose(fast[0], twin[0], rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(fast[1], twin[1], rtol=1e-9, atol=1e-9)
    behind = place.copy()
    behind[row[3], 2] = -50.0
    assert not see(camera.packed(), pose.rotation, pose.translation, behind, by_model, *known, *fast)


@pytest.mark.parametrize("shared", [False, True])
def test_whitened_observations_have_unit_covariance_where_seen(shared):
    rng = np.random.default_rng(2)
    seen = rng.random((40, 3)) < 0.7
    root, own = rng.normal(size=(40, 3, 2, 2)), rng.normal(size=(40, 3, 3))
    cov, place_cov = root @ np.swapaxes(root, -1, -2) + 0.1 * np.eye(2), own @ np.swapaxes(own, -1, -2)
    moved = rng.normal(size=(40, 6, 3))
    whitener = whiteners(cov, seen, moved, place_cov if shared else None)
    assert (np.triu(whitener, 1) == 0).all()
    for n in range(40):
        total = np.zeros((6, 6))
        for v in range(3):
            total[2 * v : 2 * v + 2, 2 * v : 2 * v + 2] = cov[n, v]
        if shared:
            total += moved[n] @ place_cov[n] @ moved[n].T
        kept = np.repeat(seen[n], 2)
        total[~kept] = total[:, ~kept] = 0.0
        np.testing.assert_allclose(whitener[n] @ total @ whitener[n].T, np.diag(kept.astype(float)), atol=1e-9)
        assert (whitener[n][~kept] == 0).all()
    if shared:
        cov[3, np.argmax(seen[3])] = -99.0 * np.eye(2)
        with pytest.raises(np.linalg.LinAlgError, match="positive definite"):
            whiteners(cov, seen, moved, place_cov)


def test_pixels_move_with_the_place_as_the_camera_says():
    rng = np.random.default_rng(3)
    camera, pose = Camera((1280, 800), 1400.0, k1=-0.12), Pose.exp([0.2, -0.1, 0.3, 0.1, -0.2, 9.0])
    place, row = rng.uniform(-2, 2, (20, 3)), np.arange(3, 15)
    sight = Sight("v", "c", row, np.zeros((12, 2)))
    values = {camera_block("c"): camera, pose_block("v"): pose}
    got = by_place((sight,), values, place)
    np.testing.assert_allclose(got[row], camera.point_jacobian(pose.apply(place[row]))[2] @ pose.rotation, rtol=1e-9)
    assert (np.delete(got, row, axis=0) == 0).all()


def test_baardas_values_are_their_twin():
    """Two cameras and one, and an observation that nothing checks."""
    rng = np.random.default_rng(4)
    whitener = np.tril(rng.normal(size=(15, 4, 4)))
    whitener[12:, 2:] = whitener[12:, :, 2:] = 0.0
    residual, jacobian = rng.normal(size=(15, 4)), rng.normal(size=(15, 4, 5))
    jacobian[14, :2] = np.eye(2, 5) * 1e8  # takes all that is known of two parameters
    white = (whitener @ jacobian).reshape(-1, 5)
    cov = np.linalg.inv(white.T @ white)
    point = np.concatenate([np.arange(15), np.arange(12)])
    view = np.repeat([0, 1], [15, 12])
    out = np.empty(27)
    _kernels.test_values(whitener, residual, jacobian, cov, point, view, 1e-9, out)
    for k, (n, v) in enumerate(zip(point, view, strict=True)):
        two, weight = slice(2 * v, 2 * v + 2), whitener[n].T @ whitener[n]
        e, own = (weight @ residual[n])[two], (weight @ jacobian[n])[two]
        spread = weight[two, two] - own @ cov @ own.T
        assert out[k] == pytest.approx(0.0 if n == 14 else e @ np.linalg.solve(spread, e), rel=1e-6)
