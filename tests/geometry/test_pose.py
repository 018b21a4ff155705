from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from windmark.geometry import Pose, PoV


def some_pose(seed=0, batch=()):
    return Pose.exp(np.random.default_rng(seed).normal(size=(*batch, 6)))


def test_apply_rotate_and_center():
    pose = some_pose()
    x = np.random.default_rng(1).normal(size=(7, 3))
    np.testing.assert_allclose(pose.apply(x), [pose.rotation @ v + pose.translation for v in x], atol=1e-15)
    np.testing.assert_allclose(pose.rotate(x), pose.apply(x) - pose.translation, atol=1e-15)
    np.testing.assert_allclose(pose.apply(pose.center), np.zeros(3), atol=1e-15)
    assert pose.apply(x[0]).shape == (3,)


def test_batch_applies_to_shared_and_own_points():
    pose = some_pose(2, (4,))
    shared = np.random.default_rng(3).normal(size=(5, 3))
    own = np.random.default_rng(4).normal(size=(4, 5, 3))
    for k in range(4):
        single = Pose(pose.rotation[k], pose.translation[k])
        np.testing.assert_allclose(pose.apply(shared)[k], single.apply(shared), atol=1e-15)
        np.testing.assert_allclose(pose.apply(own)[k], single.apply(own[k]), atol=1e-15)


def test_composition_reads_from_right_to_left():
    a_from_b, b_from_c = some_pose(5), some_pose(6)
    x = np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose((a_from_b @ b_from_c).apply(x), a_from_b.apply(b_from_c.apply(x)), atol=1e-14)
    with pytest.raises(TypeError):
        _ = a_from_b @ np.eye(3)


def test_angle_between_poses():
    pose = some_pose(7)
    for angle in (0.0, 1e-9, 0.5, math.pi):
        turned = Pose.exp([0, 0, angle, 0, 0, 0]) @ pose
        assert float(pose.angle_to(turned)) == pytest.approx(angle, abs=1e-14)


def test_rotvec_goes_both_ways():
    pose = Pose.from_rotvec([0.1, 0.2, -0.3], [1, 2, 3])
    np.testing.assert_allclose(pose.rotvec, [0.1, 0.2, -0.3], atol=1e-15)
    np.testing.assert_array_equal(Pose.identity().log(), np.zeros(6))


@pytest.mark.parametrize(
    ("rotation", "translation", "word"),
    [
        (np.eye(2), np.zeros(3), "expected rotation"),
        (np.eye(3), np.zeros(2), "expected rotation"),
        (np.stack([np.eye(3)] * 2), np.zeros(3), "expected rotation"),
        (np.eye(3) * np.nan, np.zeros(3), "finite"),
        (np.eye(3), [0, 0, np.inf], "finite"),
        (np.diag([1.0, 1, -1]), np.zeros(3), "is mirrored: its determinant is -1"),
        (np.diag([1.0, 1, -1.1]), np.zeros(3), "off by 0.21"),
        (1.001 * np.eye(3), np.zeros(3), "orthonormal"),
    ],
)
def test_what_is_no_pose_is_refused(rotation, translation, word):
    with pytest.raises(ValueError, match=word):
        Pose(rotation, translation)


def test_wrong_shapes_are_named():
    with pytest.raises(ValueError, match=r"Pose\.exp.*\(5,\)"):
        Pose.exp(np.zeros(5))
    with pytest.raises(ValueError, match=r"Pose\.apply.*\(4, 2\)"):
        Pose.identity().apply(np.zeros((4, 2)))
    with pytest.raises(ValueError, match="batch"):
        some_pose(0, (2,)).to_pov()


@pytest.mark.parametrize("size", [1e-200, 1e300])
def test_look_at_takes_directions_of_any_length(size):
    pose = Pose.look_at([0, 0, 0], [size, 0, size / 2], [0, size, 0])
    np.testing.assert_allclose(pose.rotation, Pose.look_at([0, 0, 0], [1, 0, 0.5], [0, 1, 0]).rotation, atol=1e-12)


def test_look_at_puts_the_target_on_the_axis_and_up_up():
    eye, target = np.array([3.0, -2.0, 5.0]), np.array([0.5, 0.2, 0.1])
    pose = Pose.look_at(eye, target, [0, 0, 1])
    np.testing.assert_allclose(pose.apply(target), [0, 0, np.linalg.norm(target - eye)], atol=1e-14)
    np.testing.assert_allclose(pose.center, eye, atol=1e-14)
    above = pose.apply(target + np.array([0, 0, 0.1]))
    assert above[1] < 0  # y is down in the image
    assert above[0] == pytest.approx(0, abs=1e-14)


@pytest.mark.parametrize(("eye", "up"), [([0, 0, 0], [0, 0, 1]), ([0, 0, 4], [0, 0, 1]), ([0, 0, 4], [0, 0, -2])])
def test_look_at_without_a_direction_is_refused(eye, up):
    with pytest.raises(ValueError, match="look_at"):
        Pose.look_at(eye, [0, 0, 0], up)


# --- the paper's point of view -------------------------------------------------------------------
QUARTERS = (0.0, 90.0, 180.0, 270.0)


@pytest.mark.parametrize("offset", [0.0, *(s * 10.0**e for e in range(-9, -4) for s in (-1, 1))])
def test_pov_round_trips_at_and_beside_singular_angles(offset):
    for rx, ry, rz in itertools.product(QUARTERS, repeat=3):
        pov = PoV(rx + offset, ry + offset, rz - offset, 1.5, -2.5, 30.0)
        pose = Pose.from_pov(pov)
        name = pose.to_pov()
        again = Pose.from_pov(name)
        np.testing.assert_allclose(again.rotation, pose.rotation, rtol=0, atol=1e-14)
        np.testing.assert_array_equal(again.translation, pose.translation)
        assert -90 <= name.ry_deg <= 90
        # a name is canonical: naming again gives the same pose and, away from the lock, the same angles
        second = again.to_pov()
        if abs(abs(name.ry_deg) - 90) > 1e-6:
            for a, b in ((name.rx_deg, second.rx_deg), (name.ry_deg, second.ry_deg), (name.rz_deg, second.rz_deg)):
                assert abs((a - b + 180) % 360 - 180) < 1e-9


def test_pov_follows_the_written_order_of_turns():
    pov = PoV(10, 20, 30, 1, 2, 3)
    x, y, z = (
        Pose.exp([*(math.radians(a) * np.eye(3)[k]), 0, 0, 0]).rotation for k, a in enumerate((10.0, 20.0, 30.0))
    )
    np.testing.assert_allclose(Pose.from_pov(pov).rotation, z @ y @ x, atol=1e-15)


def test_field_of_view_names_the_focal_length():
    pov = Pose.identity().to_pov(focal_px=1500.0, width_px=2000)
    assert pov.fov_deg == pytest.approx(2 * math.degrees(math.atan(1000 / 1500)))
    assert pov.focal_px(2000) == pytest.approx(1500.0, rel=1e-14)
    assert math.isnan(Pose.identity().to_pov().fov_deg)
