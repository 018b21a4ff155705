"""Properties that a refined pose must have, whatever the scene."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from windmark.adjust import refine_pose
from windmark.geometry import Camera, Pose


@st.composite
def scenes(draw):
    """Any roll, tilt and distance, field of view 12 to 75 degrees, a lens that is one to one in the image."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    focal = draw(st.floats(850, 6000))
    radius = 755 / focal
    bend = draw(st.floats(-0.15, 0.15, allow_subnormal=False)) / radius**2
    camera = Camera(
        (1280, 800),
        focal,
        aspect=draw(st.floats(0.9, 1.1)),
        k1=bend,
        k2=draw(st.floats(-0.03, 0.03, allow_subnormal=False)) / radius**4,
        p1=draw(st.floats(-2e-3, 2e-3)),
        p2=draw(st.floats(-2e-3, 2e-3)),
        tilt_x=draw(st.sampled_from([0.0, 0.02])),
    )
    n = draw(st.integers(6, 40))
    xyz = rng.uniform(-1, 1, (n, 3)) * [1, 0.7, draw(st.floats(0.2, 1.0))]
    # Distance at which the model fills most of the image.
    distance = 1.6 + focal / 400 * draw(st.floats(1.0, 2.0))
    turn = rng.normal(size=3)
    pose = Pose.from_rotvec(turn / np.linalg.norm(turn) * draw(st.floats(0, np.pi)), [0.05, -0.05, distance])
    return camera, pose, xyz, rng


def nearby(rng, pose, scale=1.0):
    delta = scale * rng.uniform(-1, 1, 6) * [0.15, 0.15, 0.15, 0.1, 0.1, 0.1 * pose.translation[2]]
    return Pose(Pose.exp(np.r_[delta[:3], 0, 0, 0]).rotation @ pose.rotation, pose.translation + delta[3:])


def noisy(camera, pose, xyz, rng, sigma=0.1):
    xy, valid = camera.project(pose.apply(xyz))
    assert valid.all()
    return xy + sigma * rng.normal(size=xy.shape)


def relative(a, b):
    """Rotation and relative shift between two poses."""
    return max(float(a.angle_to(b)), float(np.linalg.norm(a.translation - b.translation) / b.translation[2]))


@settings(max_examples=60, deadline=None)
@given(scenes())
def test_perfect_data_give_the_perfect_pose(scene):
    camera, pose, xyz, rng = scene
    xy = noisy(camera, pose, xyz, rng, sigma=0.0)
    cov = np.tile(np.eye(2) * 1e-6, (len(xyz), 1, 1))
    estimate = refine_pose(camera, nearby(rng, pose), xyz, xy, cov)
    assert estimate.report.converged
    assert relative(estimate.cam_from_model, pose) < 1e-8
    assert estimate.rms_px < 1e-7


@settings(max_examples=30, deadline=None)
@given(scenes(), st.sampled_from([1 / 25.4, 25.4, 1000.0]))
def test_inches_or_millimetres_give_the_same_pose(scene, unit):
    camera, pose, xyz, rng = scene
    xy = noisy(camera, pose, xyz, rng)
    start = nearby(rng, pose, 0.3)
    one = refine_pose(camera, start, xyz, xy, free=("focal_px",), prior_sigma={"focal_px": 50.0})
    other = refine_pose(
        camera,
        Pose(start.rotation, unit * start.translation),
        unit * xyz,
        xy,
        free=("focal_px",),
        prior_sigma={"focal_px": 50.0},
    )
    assert (
        relative(Pose(other.cam_from_model.rotation, other.cam_from_model.translation / unit), one.cam_from_model)
        < 1e-7
    )
    assert other.camera.focal_px == pytest.approx(one.camera.focal_px, rel=1e-7)
    scale = np.r_[1, 1, 1, unit, unit, unit, 1]
    sigma = np.sqrt(np.diag(one.cov)) * scale
    np.testing.assert_allclose(
        other.cov / np.outer(sigma, sigma), one.cov * np.outer(scale, scale) / np.outer(sigma, sigma), atol=1e-5
    )
    assert other.report.iterations == one.report.iterations


@settings(max_examples=30, deadline=None)
@given(scenes())
def test_the_model_frame_and_the_order_of_points_do_not_matter(scene):
    camera, pose, xyz, rng = scene
    xy = noisy(camera, pose, xyz, rng)
    start = nearby(rng, pose, 0.3)
    model_from_tunnel = Pose.from_rotvec(rng.normal(size=3), rng.normal(size=3) * 5)
    order = rng.permutation(len(xyz))
    one = refine_pose(camera, start, xyz, xy)
    other = refine_pose(camera, start @ model_from_tunnel, model_from_tunnel.inverse().apply(xyz)[order], xy[order])
    assert relative(other.cam_from_model @ model_from_tunnel.inverse(), one.cam_from_model) < 1e-7
    # The perturbation acts in the camera's frame, so the covariance is the same too.
    sigma = np.sqrt(np.diag(one.cov))
    np.testing.assert_allclose(other.cov / np.outer(sigma, sigma), one.cov / np.outer(sigma, sigma), atol=1e-5)
    np.testing.assert_allclose(other.residuals_px, one.residuals_px[order], atol=1e-5)


@settings(max_examples=30, deadline=None)
@given(scenes(), st.sampled_from(["none", "huber", "cauchy", "tukey"]))
def test_the_start_does_not_matter(scene, loss):
    camera, pose, xyz, rng = scene
    xy = noisy(camera, pose, xyz, rng)
    cov = np.tile(np.eye(2) * 0.01, (len(xyz), 1, 1))
    one, other = (refine_pose(camera, nearby(rng, pose, 0.3), xyz, xy, cov, loss=loss) for _ in range(2))
    delta = (one.cam_from_model @ other.cam_from_model.inverse()).log() / np.sqrt(np.diag(one.cov))
    assert np.abs(delta).max() < 1e-2


@settings(max_examples=30, deadline=None)
@given(scenes())
def test_more_knowledge_never_widens_the_covariance(scene):
    camera, pose, xyz, rng = scene
    xy = noisy(camera, pose, xyz, rng, sigma=0.0)  # so that all are linearised at one point
    cov = np.tile(np.eye(2) * 0.01, (len(xyz), 1, 1))
    plain = refine_pose(camera, pose, xyz, xy, cov)
    prior = refine_pose(camera, pose, xyz, xy, cov, prior_sigma={"rotation_y": 1e-4, "translation_z": 0.1})
    free = refine_pose(camera, pose, xyz, xy, cov, free=("focal_px",), prior_sigma={"focal_px": 100.0})
    sigma = np.sqrt(np.diag(plain.cov))
    for smaller, larger in ((prior.cov, plain.cov), (plain.cov, free.cov[:6, :6])):
        assert np.linalg.eigvalsh((larger - smaller) / np.outer(sigma, sigma)).min() > -1e-6
