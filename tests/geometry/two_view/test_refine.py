"""Refined poses: the minimum, at the Cramer-Rao bound, with the covariance of their errors."""

import numpy as np
import pytest

from windmark.geometry import DegenerateGeometry, Pose
from windmark.geometry.two_view import (
    rays_with_cov,
    refine_essential,
    relative_pose_refine,
)
from windmark.geometry.two_view.pairs import homogeneous_pairs
from windmark.geometry.two_view.refine import pose_covariance, sampson_errors, sampson_rows, tangent

COV_A, COV_B = np.array([[0.02, 0.006], [0.006, 0.01]]), 0.01 * np.eye(2)


def noisy(s, seed):
    """Pixels with the noise of COV_A and COV_B."""
    rng = np.random.default_rng(seed)
    n = len(s.xy_a)
    return s.xy_a + rng.normal(size=(n, 2)) @ np.linalg.cholesky(COV_A).T, s.xy_b + 0.1 * rng.normal(size=(n, 2))


def error5(found, truth):
    """Error of a pose in five parameters: rotation vector, and the baseline along its tangent."""
    delta = (found @ truth.inverse()).log()
    to_delta = pose_covariance(truth, np.eye(5))  # only its range matters
    basis = np.linalg.svd(to_delta)[0][:, :5]
    return basis, basis.T @ delta


def crlb(s):
    """Cramer-Rao bound (6, 6) by the whole bundle: pose with fixed baseline and all points, eliminated."""
    n = len(s.xy_a)
    tilt = np.zeros((6, 5))
    tilt[:3, :3] = np.eye(3)
    tilt[3:, :3] = -np.stack([np.cross(e, s.b_from_a.translation) for e in np.eye(3)], axis=1)
    tilt[3:, 3:] = tangent(s.b_from_a.translation / np.linalg.norm(s.b_from_a.translation))
    d_a = s.camera_a.project_jacobian(s.xyz_a)[2]
    y = s.b_from_a.apply(s.xyz_a)
    d_b = s.camera_b.project_jacobian(y)[2]
    info = np.zeros((5, 5))
    w_a, w_b = np.linalg.inv(COV_A), np.linalg.inv(COV_B)
    for k in range(n):
        by_delta = np.column_stack([-np.stack([np.cross(y[k], e) for e in np.eye(3)], axis=1), np.eye(3)])
        j_pose = d_b[k] @ by_delta @ tilt
        j_point = d_b[k] @ s.b_from_a.rotation
        point = d_a[k].T @ w_a @ d_a[k] + j_point.T @ w_b @ j_point
        cross = j_pose.T @ w_b @ j_point
        info += j_pose.T @ w_b @ j_pose - cross @ np.linalg.solve(point, cross.T)
    return tilt @ np.linalg.inv(info) @ tilt.T


def test_derivatives():
    rng = np.random.default_rng(0)
    e, slopes = rng.normal(size=(3, 3)), rng.normal(size=(4, 3, 3))
    pairs = homogeneous_pairs("test", rng.normal(size=(9, 2)), rng.normal(size=(9, 2)), COV_A, COV_B)
    residual, jacobian = sampson_rows(e, slopes, pairs)
    np.testing.assert_allclose(residual, sampson_errors(e, pairs), rtol=1e-12)
    numeric = [(sampson_errors(e + 1e-6 * d, pairs) - sampson_errors(e - 1e-6 * d, pairs)) / 2e-6 for d in slopes]
    np.testing.assert_allclose(jacobian.T, numeric, rtol=1e-5, atol=1e-6)


def test_exact_pairs_give_the_truth(scene, other_camera):
    s = scene(camera_b=other_camera)
    start = Pose.exp([0.02, -0.01, 0.03, 0.1, -0.1, 0.05]) @ s.unit
    found = relative_pose_refine(start, s.xy_a, s.xy_b, s.camera_a, s.camera_b)
    np.testing.assert_allclose(found.b_from_a.rotation, s.unit.rotation, atol=1e-8)
    np.testing.assert_allclose(found.b_from_a.translation, s.unit.translation, atol=1e-7)
    assert found.cost < 1e-10


def test_the_covariance_is_the_cramer_rao_bound(scene):
    """That of the bundle with all points free, when the baseline has length 1."""
    s = scene(seed=3, n=30, baseline=0.25)  # four away: a baseline of 1
    found = relative_pose_refine(s.b_from_a, s.xy_a, s.xy_b, s.camera_a, s.camera_b, cov_a=COV_A, cov_b=COV_B)
    np.testing.assert_allclose(found.cov, crlb(s), rtol=1e-4, atol=1e-4 * found.cov.max())


def test_errors_have_the_predicted_covariance(scene):
    """Two-sided: 300 draws; so the estimate reaches the bound."""
    s = scene(seed=4, n=25, baseline=0.25)
    draws, distances, costs = 300, [], []
    for k in range(draws):
        xy_a, xy_b = noisy(s, k)
        found = relative_pose_refine(s.unit, xy_a, xy_b, s.camera_a, s.camera_b, cov_a=COV_A, cov_b=COV_B)
        basis, error = error5(found.b_from_a, s.unit)
        distances.append(error @ np.linalg.solve(basis.T @ found.cov @ basis, error))
        costs.append(found.cost)
    assert np.mean(distances) == pytest.approx(5.0, abs=4 * np.sqrt(10 / draws))
    assert np.mean(costs) == pytest.approx(20.0, abs=4 * np.sqrt(40 / draws))


def test_nothing_is_known_along_the_baseline(scene):
    s = scene(sigma=0.1)
    found = relative_pose_refine(s.b_from_a, s.xy_a, s.xy_b, s.camera_a, s.camera_b)
    along = np.r_[np.zeros(3), found.b_from_a.translation]
    assert abs(along @ found.cov @ along) < 1e-12 * np.trace(found.cov)
    assert np.linalg.norm(found.b_from_a.translation) == pytest.approx(1.0)


def test_rays_and_pixels_are_one(scene):
    s = scene(sigma=0.1)
    s.xy_a[3] = np.nan
    pixels = relative_pose_refine(s.b_from_a, s.xy_a, s.xy_b, s.camera_a, s.camera_b, cov_a=COV_A, cov_b=COV_B)
    (a, c_a), (b, c_b) = rays_with_cov(s.camera_a, s.xy_a, COV_A), rays_with_cov(s.camera_b, s.xy_b, COV_B)
    rays = refine_essential(s.b_from_a, 3 * a, b[:, :2], c_a, c_b)
    np.testing.assert_allclose(rays.b_from_a.rotation, pixels.b_from_a.rotation, atol=1e-12)
    assert np.isnan(pixels.distance[3])
    assert np.nansum(pixels.distance**2) == pytest.approx(pixels.cost)


def test_covariance_of_rays_goes_through_the_lens(scene, other_camera):
    rng = np.random.default_rng(0)
    xy = rng.uniform(50, 1100, (5, 2))
    _, cov = rays_with_cov(other_camera, xy, COV_A)
    for k in range(5):
        many = xy[k] + 0.05 * rng.normal(size=(4000, 2)) @ np.linalg.cholesky(COV_A).T
        sample = np.cov(other_camera.unproject(many)[:, :2].T) / 0.05**2
        np.testing.assert_allclose(sample, cov[k], atol=0.08 * np.trace(cov[k]))


def test_what_cannot_be_refined(scene):
    s = scene()
    with pytest.raises(DegenerateGeometry, match="five pairs"):
        relative_pose_refine(s.b_from_a, s.xy_a[:4], s.xy_b[:4], s.camera_a, s.camera_b)
    with pytest.raises(DegenerateGeometry, match="baseline"):
        relative_pose_refine(Pose.identity(), s.xy_a, s.xy_b, s.camera_a, s.camera_b)
    same = np.tile(s.xy_a[:1], (8, 1)), np.tile(s.xy_b[:1], (8, 1))
    with pytest.raises(DegenerateGeometry, match="not determine"):
        relative_pose_refine(s.b_from_a, *same, s.camera_a, s.camera_b)
    with pytest.raises(ValueError, match="cov_a"):
        refine_essential(s.b_from_a, s.xy_a, s.xy_b, np.eye(3))


@pytest.mark.parametrize("count", [4, 5])
def test_five_pairs_are_enough_and_four_are_not(scene, count):
    """A relative pose has five freedoms, and each pair tells one."""
    s = scene(seed=2)
    pairs = s.xy_a[:count], s.xy_b[:count], s.camera_a, s.camera_b
    if count < 5:
        with pytest.raises(DegenerateGeometry, match="at least five pairs"):
            relative_pose_refine(s.unit, *pairs)
        return
    found = relative_pose_refine(s.unit, *pairs)
    assert found.b_from_a.angle_to(s.unit) < 1e-6
    np.testing.assert_allclose(found.distance, 0.0, atol=1e-6)
