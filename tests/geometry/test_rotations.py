from __future__ import annotations

import itertools

import numpy as np
import pytest

from windmark.geometry import rotations as rot

ANGLES = [0.0, 1e-12, 1e-8, 1e-4, 0.0099, 0.0101, 0.5, 2.0, 3.0, np.pi - 1e-4, np.pi - 1e-8, np.pi - 1e-12, np.pi]
AXES = [np.array(a, float) / np.linalg.norm(a) for a in itertools.product([-1, 0, 1], repeat=3) if any(a)]


def turned(angle, axis):
    return rot.exp_so3(angle * axis)


@pytest.mark.parametrize("angle", ANGLES)
def test_exp_is_a_rotation_that_log_undoes(angle):
    for axis in AXES:
        r = turned(angle, axis)
        np.testing.assert_allclose(r @ r.T, np.eye(3), atol=4e-16)
        assert np.linalg.det(r) == pytest.approx(1, abs=1e-15)
        w = rot.log_so3(r)
        assert np.linalg.norm(w) == pytest.approx(angle, abs=3e-15)
        np.testing.assert_allclose(rot.exp_so3(w), r, atol=2e-15)


def test_exp_agrees_with_the_power_series():
    w = np.array([0.3, -0.8, 0.5])
    k, term, total = rot.hat(w), np.eye(3), np.eye(3)
    for n in range(1, 30):
        term = term @ k / n
        total = total + term
    np.testing.assert_allclose(rot.exp_so3(w), total, atol=1e-15)


def test_left_jacobian_is_the_integral_of_exp():
    # V(w) = integral of exp(s w) over s in [0, 1] (Gauss-Legendre)
    nodes, weights = np.polynomial.legendre.leggauss(20)
    for w in (np.array([0.4, -1.0, 0.2]), np.array([2.0, 1.0, -2.0]), np.array([1e-5, 2e-5, 0]), np.zeros(3)):
        integral = sum(c / 2 * rot.exp_so3((x + 1) / 2 * w) for x, c in zip(nodes, weights, strict=True))
        np.testing.assert_allclose(rot.left_jacobian(w), integral, atol=1e-14)


def test_series_and_closed_form_meet_where_they_change_over():
    for scale in (0.01 * (1 - 1e-9), 0.01 * (1 + 1e-9)):
        w = scale * np.array([0.6, 0.0, 0.8])
        exact = np.eye(3) + rot.hat(w) / 2 + rot.hat(w) @ rot.hat(w) / 6 - scale**2 * rot.hat(w) / 24
        np.testing.assert_allclose(rot.left_jacobian(w), exact, atol=1e-10)
    a, b = (rot.left_jacobian(s * np.array([0.6, 0.0, 0.8])) for s in (0.01 * (1 - 1e-12), 0.01 * (1 + 1e-12)))
    np.testing.assert_allclose(a, b, atol=1e-13)


def test_hat_is_the_cross_product():
    a, b = np.random.default_rng(0).normal(size=(2, 5, 3))
    np.testing.assert_allclose((rot.hat(a) @ b[..., None])[..., 0], np.cross(a, b), atol=1e-15)


def test_quaternion_of_half_turns_keeps_its_sign_rule():
    for axis in np.eye(3):
        q = rot.quaternion(turned(np.pi, axis))
        assert q[0] >= 0
        np.testing.assert_allclose(np.abs(q[1:]), axis, atol=1e-15)


def test_batches_equal_one_by_one():
    """Single ones are worked out in plain floats: tiny, usual, nearly half turns about any axis."""
    axis = np.random.default_rng(1).normal(size=(40, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    w = np.array([0.0, 1e-13, 1e-6, 0.00999, 0.0101, 0.5, 2.0, 3.1, np.pi - 1e-9])[:, None, None] * axis
    r = rot.exp_so3(w)
    for function in (rot.exp_so3, rot.left_jacobian):
        np.testing.assert_allclose(function(w), [[function(v) for v in row] for row in w], atol=1e-15)
    np.testing.assert_allclose(rot.quaternion(r), [[rot.quaternion(m) for m in row] for row in r], atol=1e-15)
    np.testing.assert_allclose(rot.log_so3(r), [[rot.log_so3(m) for m in row] for row in r], rtol=1e-14, atol=1e-15)
    assert np.isnan(rot.exp_so3([np.inf, 0.0, 0.0])).all()
    assert rot.exp_so3(np.zeros((0, 3))).shape == (0, 3, 3)


def test_project_to_so3_finds_the_nearest_rotation():
    rng = np.random.default_rng(2)
    r = rot.exp_so3(rng.normal(size=(50, 3)))
    np.testing.assert_allclose(rot.project_to_so3(3.7 * r), r, atol=1e-14)
    noisy = r + 0.2 * rng.normal(size=r.shape)
    best = rot.project_to_so3(noisy)
    assert np.all(np.linalg.det(best) > 0)
    distance = np.linalg.norm(noisy - best, axis=(-1, -2))
    for _ in range(20):
        other = rot.exp_so3(0.05 * rng.normal(size=(50, 3))) @ best
        assert np.all(np.linalg.norm(noisy - other, axis=(-1, -2)) >= distance - 1e-12)


def test_project_to_so3_never_reflects():
    mirror = np.diag([1.0, 1.0, -1.0])
    assert np.linalg.det(rot.project_to_so3(mirror)) == pytest.approx(1)


QUARTERS = [0.0, 90.0, 180.0, 270.0]
NEAR = [0.0, *(s * 10.0**e for e in range(-9, -4) for s in (-1, 1))]


def test_singular_angles_round_trip_in_all_combinations():
    """0, 90, 180, 270 degrees and 1e-9 to 1e-5 degrees beside them, on every axis: 85,184 poses."""
    values = np.radians([q + d for q in QUARTERS for d in NEAR])
    rx, ry, rz = (a.ravel() for a in np.meshgrid(values, values, values, indexing="ij"))
    r = rot.from_xyz_angles(rx, ry, rz)
    angles = rot.to_xyz_angles(r)
    np.testing.assert_allclose(rot.from_xyz_angles(*angles), r, rtol=0, atol=1e-15)
    assert np.all(np.abs(angles[1]) <= np.pi / 2)
    assert np.all(np.abs(angles[0]) <= np.pi)
    assert np.all(np.abs(angles[2]) <= np.pi)


def test_angles_of_ordinary_rotations_come_back():
    rng = np.random.default_rng(3)
    given = rng.uniform([-3.1, -1.5, -3.1], [3.1, 1.5, 3.1], (1000, 3)).T
    np.testing.assert_allclose(rot.to_xyz_angles(rot.from_xyz_angles(*given)), given, atol=1e-13)


def test_at_gimbal_lock_rx_is_zero():
    for ry in (np.pi / 2, -np.pi / 2):
        rx, found, rz = rot.to_xyz_angles(rot.from_xyz_angles(0.3, ry, 0.5))
        assert rx == 0
        assert found == pytest.approx(ry, abs=1e-15)
        assert rz == pytest.approx(0.5 - np.sign(ry) * 0.3, abs=1e-15)
