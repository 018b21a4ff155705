"""Homographies with noise in both pictures: minimum, covariance, and the pose of a plane from them."""

import numpy as np
import pytest

from windmark.geometry import DegenerateGeometry
from windmark.geometry.rotations import exp_so3, log_so3
from windmark.geometry.two_view import decompose_homography, rays_with_cov, refine_homography
from windmark.geometry.two_view.homography_refine import (
    across,
    homography_errors,
    homography_rows,
    plane_pose_covariance,
    refine_rotation,
)
from windmark.geometry.two_view.pairs import homogeneous_pairs, pairs_of_pixels

COV_A, COV_B = np.array([[0.02, 0.006], [0.006, 0.01]]), 0.01 * np.eye(2)
H = np.array([[1.1, 0.1, 20.0], [-0.05, 0.95, -10.0], [1e-4, -2e-4, 1.0]])


def plane(n=30, seed=0):
    p = np.random.default_rng(seed).uniform(0, 1000, (n, 2))
    q = p @ H[:, :2].T + H[:, 2]
    return p, q[:, :2] / q[:, 2:]


def draw(p, q, seed):
    rng = np.random.default_rng(seed)
    return p + rng.normal(size=p.shape) @ np.linalg.cholesky(COV_A).T, q + 0.1 * rng.normal(size=q.shape)


def test_rows_and_their_gradient():
    p, q = draw(*plane(), 1)
    pairs = homogeneous_pairs("test", p / 500, q / 500, COV_A, COV_B)
    h = np.diag([1 / 500, 1 / 500, 1]) @ H @ np.diag([500.0, 500, 1])
    h = h / np.linalg.norm(h)
    rows, jacobian = homography_rows(h, across(h), pairs)
    np.testing.assert_allclose((rows.reshape(-1, 2) ** 2).sum(axis=1), homography_errors(h, pairs), rtol=1e-9)
    step = 1e-6
    numeric = [
        (homography_errors(h + step * d, pairs).sum() - homography_errors(h - step * d, pairs).sum()) / (2 * step)
        for d in across(h)
    ]
    np.testing.assert_allclose(2 * jacobian.T @ rows, numeric, rtol=1e-4, atol=1e-4 * np.abs(numeric).max())


def test_exact_pairs_give_the_truth():
    found = refine_homography(*plane(6))
    np.testing.assert_allclose(found.matrix / found.matrix[2, 2], H, rtol=1e-8, atol=1e-10)


def test_errors_have_the_predicted_covariance():
    p, q = plane(20)
    truth, draws, distances, costs = H / np.linalg.norm(H), 300, [], []
    basis = across(truth).reshape(8, 9)
    for k in range(draws):
        found = refine_homography(*draw(p, q, k), COV_A, COV_B)
        error = basis @ (found.matrix - truth).ravel()
        distances.append(error @ np.linalg.solve(basis @ found.cov @ basis.T, error))
        costs.append(found.cost)
    assert np.mean(distances) == pytest.approx(8.0, abs=4 * np.sqrt(16 / draws))
    assert np.mean(costs) == pytest.approx(32.0, abs=4 * np.sqrt(64 / draws))


def test_swapping_the_pictures_inverts():
    p, q = draw(*plane(), 5)
    there = refine_homography(p, q, COV_A, COV_B)
    back = np.linalg.inv(refine_homography(q, p, COV_B, COV_A).matrix)
    np.testing.assert_allclose(back / back[2, 2], there.matrix / there.matrix[2, 2], rtol=1e-4, atol=1e-7)


def test_the_pose_of_a_plane_has_the_predicted_covariance(scene):
    s = scene("plane", seed=1, n=40)
    draws, distances = 200, []
    for k in range(draws):
        xy_a, xy_b = draw(s.xy_a, s.xy_b, k)
        (a, c_a), (b, c_b) = rays_with_cov(s.camera_a, xy_a, COV_A), rays_with_cov(s.camera_b, xy_b, COV_B)
        h = refine_homography(a, b, c_a, c_b)
        found = decompose_homography(h.matrix, a, b)
        near = min(found, key=lambda p: float(np.linalg.norm(p.b_from_a.translation - s.unit.translation)))
        cov = plane_pose_covariance(near, h.matrix, h.cov)
        error = (s.unit @ near.b_from_a.inverse()).log()
        values, vectors = np.linalg.eigh(cov)
        distances.append(np.sum((vectors[:, 1:].T @ error) ** 2 / values[1:]))
    assert np.mean(distances) == pytest.approx(5.0, abs=4 * np.sqrt(10 / draws))


def test_a_rotation(scene):
    s = scene("rotation", sigma=0.1)
    pairs = pairs_of_pixels(s.xy_a, s.xy_b, s.camera_a, s.camera_b, 0.01 * np.eye(2), 0.01 * np.eye(2))
    found, residual, normal = refine_rotation(exp_so3([0.02, 0.01, -0.03]) @ s.b_from_a.rotation, pairs)
    error = log_so3(found @ s.b_from_a.rotation.T)
    assert error @ normal @ error < 16.3  # chi-square, three degrees of freedom, 99.9 %
    assert residual @ residual == pytest.approx(157, abs=4 * np.sqrt(2 * 157))


def test_what_determines_no_homography():
    p, q = plane(3)
    with pytest.raises(DegenerateGeometry, match="four pairs"):
        refine_homography(p, q)
    line = np.outer(np.arange(8.0), [1.0, 2.0])
    with pytest.raises(DegenerateGeometry, match="on a line"):
        refine_homography(line, line + 1)
