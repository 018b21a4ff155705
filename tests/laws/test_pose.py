"""Group laws of poses and similarities, exponential and logarithm, and the point of view, for any pose."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from windmark.geometry import Pose, PoV, Similarity, align

LAWS = settings(max_examples=100, deadline=None)
coordinate = st.floats(-100, 100)
points = st.lists(st.tuples(coordinate, coordinate, coordinate), min_size=1, max_size=6).map(np.array)


@st.composite
def tangents(draw, max_angle=math.pi):
    axis = np.array([draw(st.floats(-1, 1)) for _ in range(3)])
    assume(np.linalg.norm(axis) > 1e-3)
    angle = draw(st.one_of(st.floats(0, max_angle), st.floats(0, 1e-6), st.sampled_from([0.0, max_angle])))
    return np.concatenate([angle * axis / np.linalg.norm(axis), [draw(coordinate) for _ in range(3)]])


poses = tangents().map(Pose.exp)


def assert_same(a: Pose, b: Pose, tolerance=1e-12):
    np.testing.assert_allclose(a.rotation, b.rotation, rtol=0, atol=tolerance)
    np.testing.assert_allclose(a.translation, b.translation, rtol=0, atol=1000 * tolerance)


@LAWS
@given(poses, poses, poses)
def test_poses_are_a_group(a, b, c):
    one = Pose.identity()
    assert_same((a @ b) @ c, a @ (b @ c))
    assert_same(a @ one, a)
    assert_same(one @ a, a)
    assert_same(a @ a.inverse(), one)
    assert_same(a.inverse() @ a, one)
    assert_same((a @ b).inverse(), b.inverse() @ a.inverse())


@LAWS
@given(poses, poses, points)
def test_composition_acts_on_points_in_order(a, b, x):
    np.testing.assert_allclose((a @ b).apply(x), a.apply(b.apply(x)), atol=1e-10)
    np.testing.assert_allclose(a.inverse().apply(a.apply(x)), x, atol=1e-10)


@LAWS
@given(poses, points)
def test_a_pose_is_rigid(a, x):
    y = a.apply(x)
    distance = np.linalg.norm(x[:, None] - x[None], axis=-1)
    np.testing.assert_allclose(np.linalg.norm(y[:, None] - y[None], axis=-1), distance, atol=1e-11)
    assert np.linalg.det(a.rotation) > 0


@LAWS
@given(tangents(max_angle=3.1))
def test_log_undoes_exp(delta):
    np.testing.assert_allclose(Pose.exp(delta).log(), delta, rtol=1e-9, atol=1e-10)


@LAWS
@given(poses)
def test_exp_undoes_log(a):
    assert np.linalg.norm(a.log()[:3]) <= math.pi + 1e-12
    assert_same(Pose.exp(a.log()), a, 1e-11)


@LAWS
@given(tangents(), st.floats(-1, 1), st.floats(-1, 1))
def test_motions_along_one_tangent_commute_and_add(delta, s, t):
    assert_same(Pose.exp(s * delta) @ Pose.exp(t * delta), Pose.exp((s + t) * delta), 1e-11)


@LAWS
@given(poses, tangents(max_angle=3.1))
def test_a_conjugated_motion_keeps_its_angle_and_its_shift_along_the_axis(a, delta):
    moved = (a @ Pose.exp(delta) @ a.inverse()).log()
    angle = np.linalg.norm(delta[:3])
    assert abs(np.linalg.norm(moved[:3]) - angle) < 1e-9
    if angle > 1e-3:
        shift = delta[:3] @ delta[3:] / angle
        assert abs(moved[:3] @ moved[3:] / np.linalg.norm(moved[:3]) - shift) < 1e-6


@LAWS
@given(st.floats(-720, 720), st.floats(-720, 720), st.floats(-720, 720), coordinate)
def test_any_angles_name_a_pose_that_its_pov_gives_back(rx, ry, rz, distance):
    pose = Pose.from_pov(PoV(rx, ry, rz, 1.0, -2.0, distance))
    pov = pose.to_pov()
    assert -90 <= pov.ry_deg <= 90
    assert -180 <= pov.rx_deg <= 180
    assert -180 <= pov.rz_deg <= 180
    assert_same(Pose.from_pov(pov), pose, 3e-14)


@LAWS
@given(
    st.sampled_from([0.0, 90.0, 180.0, 270.0]),
    st.sampled_from([0.0, 90.0, 180.0, 270.0]),
    st.sampled_from([0.0, 90.0, 180.0, 270.0]),
    st.tuples(*[st.floats(-1e-4, 1e-4)] * 3),
)
def test_pov_near_the_singular_angles(rx, ry, rz, offset):
    pose = Pose.from_pov(PoV(rx + offset[0], ry + offset[1], rz + offset[2], 0, 0, 1))
    assert_same(Pose.from_pov(pose.to_pov()), pose, 3e-14)


@LAWS
@given(poses, st.floats(0.01, 100), poses, st.floats(0.01, 100), points)
def test_similarities_are_a_group(a, k, b, m, x):
    p, q = Similarity(k, a.rotation, a.translation), Similarity(m, b.rotation, b.translation)
    size = 1 + np.abs(p.apply(q.apply(x))).max()
    np.testing.assert_allclose((p @ q).apply(x), p.apply(q.apply(x)), atol=1e-12 * size)
    np.testing.assert_allclose(p.inverse().apply(p.apply(x)), x, atol=1e-10 * max(1, 1 / k))


@LAWS
@given(poses, poses, st.integers(0, 1000))
def test_alignment_follows_a_motion_of_either_set(a, b, seed):
    """Moving the source by a and the target by b conjugates the estimate: it depends on no origin and no axes."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(8, 3))
    y = x + 0.1 * rng.normal(size=(8, 3))
    plain = align(x, y)
    moved = align(a.apply(x), b.apply(y))
    expected = Similarity(1, b.rotation, b.translation) @ plain @ Similarity(1, a.rotation, a.translation).inverse()
    np.testing.assert_allclose(moved.scale, expected.scale, rtol=1e-10)
    np.testing.assert_allclose(moved.rotation, expected.rotation, atol=1e-10)
    np.testing.assert_allclose(moved.translation, expected.translation, atol=1e-7)
    np.testing.assert_allclose(moved.rms, plain.rms, rtol=1e-9)
