"""Two pictures from pairs of spots, some wrong: the right model, its pose, and names for what is not determined."""

import numpy as np
import pytest

from windmark.geometry.two_view import essential_from_poses, estimate_two_view

COV = 0.1**2 * np.eye(2)


def estimate(s, **options):
    return estimate_two_view(s.xy_a, s.xy_b, s.camera_a, s.camera_b, **{"cov_a": COV, "cov_b": COV, **options})


@pytest.mark.parametrize("seed", range(4))
def test_points_in_space(scene, angle_deg, other_camera, seed):
    s = scene(seed=seed, sigma=0.1, wrong=0.3, camera_b=other_camera)
    view = estimate(s)
    assert view.model == "essential"
    assert view.reason == ""
    assert view.weak == view.alternatives == ()
    assert (view.inliers & ~s.wrong).sum() >= (~s.wrong).sum() - 2
    assert (view.inliers & s.wrong).sum() <= 2
    assert np.degrees(view.b_from_a.angle_to(s.unit)) < 0.2
    assert angle_deg(view.b_from_a.translation, s.unit.translation) < 0.5
    assert view.sigma0 == pytest.approx(1.0, abs=0.25)
    np.testing.assert_allclose(view.essential, essential_from_poses(view.b_from_a))


@pytest.mark.parametrize("seed", range(4))
def test_points_on_a_plane(scene, angle_deg, seed):
    s = scene("plane", seed=seed, sigma=0.1, wrong=0.3)
    view = estimate(s)
    assert view.model == "homography-plane"
    poses = (view.b_from_a, *view.alternatives)
    assert len(poses) <= 2
    assert min(angle_deg(p.translation, s.unit.translation) for p in poses) < 1.0
    assert bool(view.alternatives) == ("two poses" in view.reason)
    assert not (view.inliers & s.wrong).any()


@pytest.mark.parametrize("seed", range(4))
def test_pure_rotation(scene, seed):
    s = scene("rotation", seed=seed, sigma=0.1, wrong=0.3)
    view = estimate(s)
    assert view.model == "rotation"
    assert view.b_from_a is view.essential is None
    assert "no baseline" in view.reason
    np.testing.assert_allclose(view.rotation, s.b_from_a.rotation, atol=1e-4)
    assert view.cov.shape == (3, 3)


def test_a_tiny_baseline_is_named(scene):
    view = estimate(scene(seed=1, sigma=0.1, baseline=1e-3))
    assert "tiny baseline" in view.reason or "no baseline" in view.reason
    assert set(view.weak) & {"depth", "baseline direction"}


def test_sigma_is_estimated_where_none_is_given(scene):
    s = scene(seed=5, sigma=0.05, wrong=0.2)
    view = estimate(s, cov_a=None, cov_b=None)
    assert view.model == "essential"
    assert view.sigma0 == pytest.approx(0.05, rel=0.25)
    assert not (view.inliers & s.wrong).any()
    given = estimate(s, cov_a=0.05**2 * np.eye(2), cov_b=0.05**2 * np.eye(2))
    np.testing.assert_allclose(np.diag(view.cov), np.diag(given.cov), rtol=0.6)


def test_the_same_seed_gives_the_same(scene):
    s = scene(seed=2, sigma=0.1, wrong=0.4)
    one, two = estimate(s, seed=7), estimate(s, seed=7)
    np.testing.assert_array_equal(one.b_from_a.rotation, two.b_from_a.rotation)
    np.testing.assert_array_equal(one.inliers, two.inliers)


def test_missing_spots_are_left_out(scene):
    s = scene(seed=3, sigma=0.1)
    s.xy_a[4] = s.xy_b[7] = np.nan
    view = estimate(s)
    assert view
    assert not view.inliers[[4, 7]].any()
    assert np.isnan(view.distance[[4, 7]]).all()
    assert view.inliers.sum() >= 76


# --- what is not there ---------------------------------------------------------------------------
def test_too_few_pairs(scene):
    view = estimate(scene(n=3))
    assert not view
    assert "too few pairs: 3" in view.reason


def test_points_on_a_line(scene):
    s = scene(n=30, sigma=0.1)
    t = np.linspace(-1, 1, 30)[:, None]
    line = np.array([0.1, 0.2, 4.0]) + t * np.array([0.8, 0.3, 0.4])
    s.xy_a[:] = s.camera_a.project(line)[0]
    s.xy_b[:] = s.camera_b.project(s.b_from_a.apply(line))[0]
    view = estimate(s)
    assert not view
    assert "on a line" in view.reason
    assert view.weak == ("relative pose",)


def test_unrelated_spots_are_refused(scene):
    s = scene(n=40)
    rng = np.random.default_rng(99)
    for seed in range(3):
        s.xy_b[:] = rng.uniform(200, 1300, (40, 2))
        view = estimate(s, seed=seed, max_trials=100)
        assert not view
        assert "agree" in view.reason


def test_six_right_pairs_are_taken_only_when_told(scene):
    s = scene(n=6, sigma=0.1, seed=4)
    assert not estimate(s)
    trusted = estimate(s, max_log10_nfa=np.inf)
    assert trusted.model == "essential"
    assert trusted.inliers.all()


def test_bad_input(scene):
    s = scene(n=10)
    with pytest.raises(ValueError, match="cov_a and cov_b"):
        estimate(s, cov_b=None)
    with pytest.raises(ValueError, match="positive definite"):
        estimate(s, cov_b=np.zeros((2, 2)))
    with pytest.raises(ValueError, match="xy_a and xy_b"):
        estimate_two_view(s.xy_a, s.xy_b[:5], s.camera_a)


def test_without_covariances_wrong_pairs_are_judged_by_the_estimated_noise(scene):
    """Pairs two pixels off their lines are within the gate of noise of a pixel, and far beyond that of this noise."""
    s = scene(seed=6, sigma=0.03)
    along = s.camera_b.project(s.b_from_a.apply(1.01 * s.xyz_a))[0] - s.camera_b.project(s.b_from_a.apply(s.xyz_a))[0]
    across = along[:8, ::-1] * [1.0, -1.0]
    s.xy_b[:8] += 2.0 * across / np.linalg.norm(across, axis=1, keepdims=True)
    view = estimate(s, cov_a=None, cov_b=None)
    assert not view.inliers[:8].any()
    assert view.inliers[8:].mean() > 0.9
    assert view.sigma0 == pytest.approx(0.03, rel=0.25)
