"""Epipolar lines and distances, against their definitions and against noise."""

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.geometry.two_view import (
    epipolar_distance,
    epipolar_lines,
    fundamental_from_poses,
    relative_pose_refine,
    sampson_distance,
    symmetric_epipolar_distance,
)

PINHOLE = Camera((1000, 800), 1200.0, 0.98)
B_FROM_A = Pose.from_rotvec([0.1, -0.2, 0.05], [1.0, 0.3, -0.1])
F = fundamental_from_poses(PINHOLE, Pose.identity(), PINHOLE, B_FROM_A)


def spots(n=20, seed=0):
    return np.random.default_rng(seed).uniform(100, 700, (n, 2))


def test_a_line_gives_signed_distances_in_pixels():
    lines = epipolar_lines(F, spots())
    np.testing.assert_allclose(np.hypot(lines[:, 0], lines[:, 1]), 1.0, atol=1e-14)
    foot = np.array([300.0, 200.0])
    on = foot - (lines[:, :2] @ foot + lines[:, 2])[:, None] * lines[:, :2]
    off = on + 7.5 * lines[:, :2]
    np.testing.assert_allclose(np.sum(off * lines[:, :2], axis=1) + lines[:, 2], 7.5, atol=1e-10)
    for sign in (0.5, 2.0):  # both points of the ray are on the line
        xy, _ = PINHOLE.project(B_FROM_A.apply(sign * 4 * PINHOLE.unproject(spots())))
        np.testing.assert_allclose(np.sum(xy * lines[:, :2], axis=1) + lines[:, 2], 0.0, atol=1e-9)


def test_the_symmetric_distance_is_that_to_both_lines():
    a, b = spots(seed=1), spots(seed=2)
    to_b = np.sum(b * epipolar_lines(F, a)[:, :2], axis=1) + epipolar_lines(F, a)[:, 2]
    to_a = np.sum(a * epipolar_lines(F.T, b)[:, :2], axis=1) + epipolar_lines(F.T, b)[:, 2]
    np.testing.assert_allclose(np.abs(symmetric_epipolar_distance(F, a, b)), np.hypot(to_a, to_b), rtol=1e-12)
    np.testing.assert_allclose(1 / sampson_distance(F, a, b) ** 2, 1 / to_a**2 + 1 / to_b**2, rtol=1e-10)


def test_swapping_the_pictures_changes_nothing():
    a, b = spots(seed=1), spots(seed=2)
    for distance in (sampson_distance, symmetric_epipolar_distance):
        np.testing.assert_allclose(distance(F, a, b), distance(F.T, b, a), rtol=1e-12)
    table = sampson_distance(F, a[:, None], b[None])
    assert table.shape == (20, 20)
    np.testing.assert_allclose(np.diag(table), sampson_distance(F, a, b), rtol=1e-12)


def test_the_sampson_distance_is_the_reprojection_error():
    """To first order: the smallest common move that brings a pair onto the epipolar geometry, found by brute force."""
    from scipy.optimize import minimize

    a, _ = spots(6), None
    b = PINHOLE.project(B_FROM_A.apply(4 * PINHOLE.unproject(a)))[0] + np.random.default_rng(3).normal(0, 0.3, (6, 2))
    for k in range(6):
        start = 4 * PINHOLE.unproject(a[k])
        cost = lambda x, k=k: (  # noqa: E731
            np.sum((PINHOLE.project(x)[0] - a[k]) ** 2) + np.sum((PINHOLE.project(B_FROM_A.apply(x))[0] - b[k]) ** 2)
        )
        best = minimize(cost, start, method="Nelder-Mead", options={"xatol": 1e-10, "fatol": 1e-14, "maxiter": 4000})
        assert abs(sampson_distance(F, a[k], b[k])) == pytest.approx(np.sqrt(best.fun), rel=2e-3)


def test_the_epipole_has_no_line():
    forward = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 0]])  # both epipoles at (0, 0)
    lines = epipolar_lines(forward, [[0.0, 0.0], [3.0, 4.0]])
    assert np.isnan(lines[0]).all()
    np.testing.assert_allclose(lines[1], [-0.8, 0.6, 0.0])


def test_pixels_as_taken(scene, other_camera):
    """Through the lens: exact pairs are at zero, and a shift across the curve is measured in pixels of that picture."""
    s = scene(camera_b=other_camera, n=40)
    at = epipolar_distance(s.xy_a, s.xy_b, s.camera_a, s.camera_b, s.b_from_a)
    assert np.abs(at.sampson_px).max() < 1e-9
    step = 0.01 * np.array([np.cos(0.4), np.sin(0.4)])
    moved = epipolar_distance(s.xy_a, s.xy_b + step, s.camera_a, s.camera_b, s.b_from_a)
    other = epipolar_distance(s.xy_a, s.xy_b + step[::-1] * [-1, 1], s.camera_a, s.camera_b, s.b_from_a)
    np.testing.assert_allclose(np.hypot(moved.in_b_px, other.in_b_px), 0.01, rtol=2e-3)
    assert (np.abs(moved.sampson_px) <= np.abs(moved.in_b_px) + 1e-15).all()
    table = epipolar_distance(s.xy_a, s.xy_b, s.camera_a, s.camera_b, s.b_from_a, every_pair=True)
    assert table.in_b_px.shape == (40, 40)
    assert np.abs(np.diag(table.in_b_px)).max() < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("with_pose", [False, True])
def test_sigmas_are_standard_deviations(scene, with_pose):
    """Distances of new spots in sigmas have variance one: of the spots alone, or with an estimated pose."""
    cov_a, cov_b = np.array([[0.04, 0.01], [0.01, 0.02]]), 0.01 * np.eye(2)
    root = np.linalg.cholesky(cov_a)
    z = []
    for seed in range(40):
        s = scene(seed=seed, n=40)
        rng = np.random.default_rng(1000 + seed)
        xy_a = s.xy_a + rng.normal(size=(40, 2)) @ root.T
        xy_b = s.xy_b + 0.1 * rng.normal(size=(40, 2))
        pose, cov_pose, new = s.b_from_a, None, slice(0, 40)
        if with_pose:
            fit = relative_pose_refine(pose, xy_a[:12], xy_b[:12], s.camera_a, s.camera_b, cov_a=cov_a, cov_b=cov_b)
            pose, cov_pose, new = fit.b_from_a, fit.cov, slice(12, 40)
        found = epipolar_distance(
            xy_a[new], xy_b[new], s.camera_a, s.camera_b, pose, cov_a=cov_a, cov_b=cov_b, cov_pose=cov_pose
        )
        z.append(found.sigmas)
    assert np.mean(np.concatenate(z) ** 2) == pytest.approx(1.0, abs=0.15 if with_pose else 0.1)


def test_bad_input():
    with pytest.raises(ValueError, match="fundamental"):
        sampson_distance(np.eye(2), spots(), spots())
    with pytest.raises(ValueError, match="points"):
        epipolar_lines(F, np.zeros((3, 3)))
    with pytest.raises(ValueError, match="as many spots"):
        epipolar_distance(spots(3), spots(4), PINHOLE, PINHOLE, B_FROM_A)
