import numpy as np
import pytest

from windmark.adjust import CameraBlock, PoseBlock
from windmark.adjust.blocks import VectorBlock, se3_left_jacobian
from windmark.geometry import PARAMETERS, Camera, Pose


@pytest.fixture
def pose():
    return Pose.from_rotvec([0.3, -0.7, 1.9], [0.4, -2.0, 9.0])


def test_pose_step_is_exp_delta_at_pose(pose):
    delta = np.array([0.1, -0.2, 0.3, 0.5, 0.6, -0.7])
    moved = PoseBlock(np.zeros(3)).retract(pose, delta)
    expected = Pose.exp(delta) @ pose
    np.testing.assert_array_equal(moved.rotation, expected.rotation)
    np.testing.assert_array_equal(moved.translation, expected.translation)
    assert PoseBlock(np.zeros(3)).retract(pose, np.full(6, np.nan)) is None


def test_natural_rotation_keeps_the_pivot_and_natural_shift_is_the_distance(pose):
    pivot = np.array([0.5, 1.5, -0.3])
    block = PoseBlock(pivot)
    center = pose.apply(pivot)
    basis = block.natural(pose)
    for k in range(3):
        turned = block.retract(pose, basis[:, k] * 0.8)
        np.testing.assert_allclose(turned.apply(pivot), center, atol=1e-12)
        assert turned.angle_to(pose) == pytest.approx(0.8)
        moved = block.retract(pose, basis[:, 3 + k])
        np.testing.assert_allclose(moved.apply(pivot) - center, np.linalg.norm(center) * np.eye(3)[k], atol=1e-12)


def test_se3_left_jacobian_is_the_derivative_of_exp():
    delta = np.array([0.9, -1.2, 0.8, 2.0, -3.0, 1.0])
    h = 1e-6
    base = Pose.exp(delta).inverse()
    columns = [((Pose.exp(delta + h * e) @ base).log() - (Pose.exp(delta - h * e) @ base).log()) for e in np.eye(6)]
    np.testing.assert_allclose(se3_left_jacobian(delta), np.stack(columns, axis=1) / (2 * h), atol=1e-8)


def test_pose_difference_and_its_derivative(pose):
    block = PoseBlock(np.zeros(3))
    delta = np.array([0.4, 0.1, -0.5, 0.2, 0.3, 0.4])
    value = Pose.exp(delta) @ pose
    difference, derivative = block.difference(value, pose)
    np.testing.assert_allclose(difference, delta, atol=1e-12)
    h = 1e-6
    numeric = [
        block.difference(Pose.exp(h * e) @ value, pose)[0] - block.difference(Pose.exp(-h * e) @ value, pose)[0]
        for e in np.eye(6)
    ]
    np.testing.assert_allclose(derivative, np.stack(numeric, axis=1) / (2 * h), atol=1e-8)


def test_camera_step_moves_only_the_named_parameters():
    camera = Camera((1280, 800), 1500.0, k1=-0.1)
    block = CameraBlock(("k1", "focal_px"))
    moved = block.retract(camera, np.array([0.05, -100.0]))
    assert (moved.k1, moved.focal_px) == (pytest.approx(-0.05), 1400.0)
    assert moved.cx == camera.cx
    difference, derivative = block.difference(moved, camera)
    np.testing.assert_allclose(difference, [0.05, -100.0])
    np.testing.assert_array_equal(derivative, np.eye(2))


def test_camera_step_refuses_impossible_cameras():
    camera = Camera((1280, 800), 1500.0)
    assert CameraBlock(("focal_px",)).retract(camera, np.array([-1500.0])) is None
    assert CameraBlock(("aspect",)).retract(camera, np.array([-2.0])) is None
    assert CameraBlock(("k1",)).retract(camera, np.array([np.nan])) is None


@pytest.mark.parametrize("name", [n for n in PARAMETERS if not n.startswith("tilt")])
def test_a_natural_unit_moves_the_corner_by_about_its_distance(name):
    camera = Camera((1280, 800), 1500.0, lens="rational" if name in ("k4", "k5", "k6") else "brown")
    block = CameraBlock((name,))
    corner = np.array([0.0, 0.0])
    ray = camera.unproject(corner)
    step = 1e-3 * block.natural(camera)[:, 0]
    shift = np.linalg.norm(block.retract(camera, step).project(ray)[0] - corner) / 1e-3
    radius = np.linalg.norm(corner - [camera.cx, camera.cy])
    assert 0.3 * radius < shift < 3.1 * radius


@pytest.mark.parametrize("name", ["focal_px", "k1", "k2", "k3", "k4"])
def test_a_natural_unit_moves_the_corner_of_a_fisheye_lens_by_about_its_distance(name):
    camera = Camera((1280, 800), 600.0, lens="fisheye")
    corner = np.array([0.0, 0.0])
    step = 1e-3 * CameraBlock((name,)).natural(camera)[:, 0]
    seen = CameraBlock((name,)).retract(camera, step).project(camera.unproject(corner))[0]
    radius = np.linalg.norm(corner - [camera.cx, camera.cy])
    assert 0.3 * radius < np.linalg.norm(seen - corner) / 1e-3 < 3.1 * radius


def test_unknown_or_repeated_camera_parameters_are_refused():
    with pytest.raises(ValueError, match=r"free: expected distinct camera parameters .* got \('focal',\)"):
        CameraBlock(("focal",))
    with pytest.raises(ValueError, match="distinct"):
        CameraBlock(("k1", "k1"))


def test_numbers_at_a_bound_stay_where_the_cost_pulls_them_out():
    block = VectorBlock(("a", "b", "c", "d"), np.array([1.0, 2.0, 3.0, 4.0]), np.zeros(4), np.ones(4))
    value, down = np.array([0.0, 0.0, 1.0, 1.0]), np.array([1.0, -1.0, -1.0, 1.0])
    np.testing.assert_array_equal(block.pinned(value, down), [True, False, True, False])
    assert not block.pinned(np.full(4, 0.5), down).any()
    assert not block.pinned(value, np.zeros(4)).any()
    np.testing.assert_array_equal(block.retract(value, np.array([-1.0, 0.3, 2.0, -0.25])), [0.0, 0.3, 1.0, 0.75])
    assert block.retract(value, np.array([np.nan, 0, 0, 0])) is None
    np.testing.assert_array_equal(block.natural(value), np.diag([1.0, 2.0, 3.0, 4.0]))
    off, slope = block.difference(value, down)
    np.testing.assert_array_equal(off, value - down)
    np.testing.assert_array_equal(slope, np.eye(4))
