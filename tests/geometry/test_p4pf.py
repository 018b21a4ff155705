from __future__ import annotations

import numpy as np
import pytest

from windmark.geometry import DegenerateGeometry, FocalPose, Pose, p4pf
from windmark.geometry.p4pf import _best_triangle_first
from windmark.geometry.rotations import exp_so3

FLATNESS = {"in space": 1.0, "nearly flat": 0.05, "flat": 0.0}


def random_view(rng, flatness):
    """Four points well inside a 2000 px image, field of view 10 to 70 degrees."""
    while True:
        focal = 1000 / np.tan(np.radians(rng.uniform(5, 35)))
        xyz = rng.uniform(-1, 1, (4, 3)) * [1, 1, flatness]
        distance = focal / 1000 * rng.uniform(1.1, 4)
        pose = Pose(exp_so3(rng.normal(size=3) * 3), np.array([*rng.uniform(-0.2, 0.2, 2) * distance, distance]))
        cam = pose.apply(xyz)
        if cam[:, 2].min() > 0.1:
            xy = focal * cam[:, :2] / cam[:, 2:]
            if np.abs(xy).max() < 1200:
                return focal, pose, xyz, xy


@pytest.mark.slow
@pytest.mark.parametrize("flatness", FLATNESS.values(), ids=FLATNESS.keys())
def test_exact_images_give_the_exact_focal_length(flatness):
    rng = np.random.default_rng(5)
    for _ in range(100):
        focal, pose, xyz, xy = random_view(rng, flatness)
        found = p4pf(xy, xyz)
        assert found
        error = [max(abs(s.focal_px / focal - 1), float(s.pose.angle_to(pose))) for s in found]
        assert min(error) < 1e-5
        best = found[int(np.argmin(error))]
        assert best.rms_px < 1e-8
        np.testing.assert_allclose(best.pose.translation, pose.translation, atol=1e-4 * pose.translation[2])


def test_every_solution_reprojects_as_it_says():
    rng = np.random.default_rng(6)
    several = 0
    for _ in range(100):
        _, _, xyz, xy = random_view(rng, 0.3)
        found = p4pf(xy + rng.normal(size=(4, 2)) * 0.5, xyz, max_rms_px=5.0)
        noisy = xy
        several += len(found) > 1
        assert [s.rms_px for s in found] == sorted(s.rms_px for s in found)
        for s in found:
            assert s.rms_px <= 5.0
            cam = s.pose.apply(xyz)
            assert cam[:, 2].min() > 0
            off = np.linalg.norm(s.focal_px * cam[:, :2] / cam[:, 2:] - noisy, axis=1)
            assert np.sqrt(np.mean(off**2)) < s.rms_px + 2.0
    assert several > 3


def test_solutions_are_minima_and_their_sigma_is_that_of_the_normal_equations():
    rng = np.random.default_rng(7)
    _, _, xyz, xy = random_view(rng, 1.0)
    noisy = xy + 0.3 * rng.normal(size=xy.shape)
    best = p4pf(noisy, xyz)[0]

    def residual(delta):
        q = Pose.exp([*delta[:3], 0, 0, 0]).rotation @ best.pose.rotation
        cam = xyz @ q.T + best.pose.translation + delta[3:6]
        return ((best.focal_px + delta[6]) * cam[:, :2] / cam[:, 2:] - noisy).ravel()

    steps = 1e-6 * np.diag([1, 1, 1, 1, 1, 1, 1e3])
    jacobian = np.stack([(residual(s) - residual(-s)) / (2 * s.max()) for s in steps], axis=-1)
    r = residual(np.zeros(7))
    assert best.rms_px == pytest.approx(np.sqrt(np.mean(np.sum(r.reshape(4, 2) ** 2, axis=1))), rel=1e-9)
    assert np.abs(jacobian.T @ r / np.linalg.norm(jacobian, axis=0)).max() < 1e-6
    covariance = np.linalg.inv(jacobian.T @ jacobian)
    assert best.focal_sigma_px == pytest.approx(np.sqrt(covariance[6, 6]), rel=1e-4)


@pytest.mark.slow
def test_sigma_predicts_the_scatter_of_the_focal_length():
    rng = np.random.default_rng(8)
    focal, _, xyz, xy = random_view(rng, 1.0)
    sigma = p4pf(xy, xyz)[0].focal_sigma_px
    noise = 0.005 * focal / sigma  # half a percent: in the linear range
    got = [p4pf(xy + noise * rng.normal(size=(4, 2)), xyz)[0].focal_px for _ in range(200)]
    assert 0.85 < np.std(got) / (noise * sigma) < 1.15


@pytest.mark.slow
def test_near_flat_markers_say_that_they_are_weak():
    """A third of near-planar views with 0.2 px of noise miss the focal length by 5 %; sigma tells which."""
    rng = np.random.default_rng(9)
    strong, weak = [], []
    for _ in range(200):
        focal, _, xyz, xy = random_view(rng, 0.05)
        try:
            found = p4pf(xy + 0.2 * rng.normal(size=(4, 2)), xyz)
        except DegenerateGeometry:
            continue  # the noise left no perspective at all
        if found:
            good = abs(found[0].focal_px / focal - 1) < 0.05
            (strong if 0.2 * found[0].focal_sigma_px < 0.02 * found[0].focal_px else weak).append(good)
    assert len(strong) > 30
    assert len(weak) > 30
    assert np.mean(strong) > 0.9
    assert np.mean(weak) < 0.7


@pytest.mark.parametrize("offset", [np.zeros(3), np.array([300.0, -20.0, 5.0])])
def test_the_origin_of_the_model_does_not_matter(offset):
    focal, pose, xyz, xy = random_view(np.random.default_rng(10), 1.0)
    best = p4pf(xy, xyz + offset)[0]
    assert best.focal_px == pytest.approx(focal, rel=1e-8)
    np.testing.assert_allclose(best.pose.apply(xyz + offset), pose.apply(xyz), rtol=1e-7, atol=1e-7)


def test_the_range_of_focal_lengths_is_respected():
    focal, _, xyz, xy = random_view(np.random.default_rng(11), 1.0)
    inside = p4pf(xy, xyz, focal_range_px=(0.8 * focal, 1.3 * focal))
    assert inside[0].focal_px == pytest.approx(focal, rel=1e-9)
    outside = p4pf(xy, xyz, focal_range_px=(2 * focal, 8 * focal), max_rms_px=0.01)
    assert outside == []


def test_a_plane_seen_face_on_is_named():
    square = np.array([[1.0, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])
    with pytest.raises(DegenerateGeometry, match="no perspective") as caught:
        p4pf(300 * square[:, :2], square)
    assert "focal length" in caught.value.weak


def test_collinear_and_coincident_points_are_named():
    xy = np.array([[0.0, 0], [100, 0], [0, 100], [90, 110]])
    line = np.outer([0.0, 1, 2, 3], [1, 2, 3])
    with pytest.raises(DegenerateGeometry, match="collinear or coincide"):
        p4pf(xy, line)
    with pytest.raises(DegenerateGeometry, match="collinear or coincide"):
        p4pf(xy, np.ones((4, 3)))
    with pytest.raises(DegenerateGeometry, match="image points coincide"):
        p4pf(np.zeros((4, 2)), np.eye(4)[:, :3])
    twice = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0.5], [0, 0, 0]])
    cam = twice + np.array([0, 0, 5])
    with pytest.raises(DegenerateGeometry):
        p4pf(800 * cam[:, :2] / cam[:, 2:], twice)


def test_three_points_in_line_and_one_beside_are_solved():
    focal, pose = 1500.0, Pose.exp([0.4, -0.5, 0.2, 0.1, 0.0, 4.0])
    xyz = np.array([[0.0, 0, 0], [1, 0, 0], [-0.7, 0, 0], [0.2, 1.0, 0.6]])
    cam = pose.apply(xyz)
    found = p4pf(focal * cam[:, :2] / cam[:, 2:], xyz)
    assert min(abs(s.focal_px / focal - 1) for s in found) < 1e-6


def test_an_impossible_image_gives_nothing():
    xyz = np.array([[1.0, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0.3]])
    crossed = np.array([[300.0, 300], [-300, 290], [310, -300], [-290, -310]])
    assert p4pf(crossed, xyz, max_rms_px=0.5) == []


def test_the_best_triangle_comes_first():
    xyz = np.array([[0.0, 0, 0], [1, 0, 0], [2, 1e-9, 0], [0.5, 1, 0]])
    order = _best_triangle_first(xyz)
    assert sorted(order) == [0, 1, 2, 3]
    assert 3 in order[:3]


def test_bad_input_is_named():
    xyz = np.eye(4)[:, :3]
    xy = np.array([[0.0, 0], [100, 0], [0, 100], [90, 110]])
    with pytest.raises(ValueError, match="xy_centered"):
        p4pf(xy[:3], xyz)
    with pytest.raises(ValueError, match="xyz"):
        p4pf(xy, xyz * np.array([1, 1, np.nan]))
    with pytest.raises(ValueError, match="max_rms_px"):
        p4pf(xy, xyz, max_rms_px=0)
    for wrong in ((0.0, 100.0), (300.0, 300.0), (300.0, 100.0), (100.0, np.inf), (np.nan, 100.0)):
        with pytest.raises(ValueError, match="focal_range_px"):
            p4pf(xy, xyz, focal_range_px=wrong)
    assert FocalPose._fields == ("focal_px", "pose", "rms_px", "focal_sigma_px")
