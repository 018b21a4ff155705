"""The fundamental matrix from a few matches: right, with covariance, wrong ones named, degenerate ones refused."""

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.geometry.two_view import fundamental_from_poses, refine_fundamental, sampson_distance

CAMERA = Camera((1600, 1200), 1700.0, 1.0, 799.5, 599.5)
A = Pose.look_at(np.array([-150.0, 20.0, 900.0]), np.zeros(3), [0.0, 1.0, 0.0])
B = Pose.look_at(np.array([160.0, -90.0, 880.0]), np.zeros(3), [0.1, 1.0, 0.0])
TRUE = fundamental_from_poses(CAMERA, A, CAMERA, B)


def pairs(n, seed, noise=0.3, flat=False):
    rng = np.random.default_rng(seed)
    xyz = rng.uniform(-220, 220, (n, 3)) * [1, 0.8, 0.0 if flat else 0.6]
    return [CAMERA.project(p.apply(xyz))[0] + rng.normal(0, noise, (n, 2)) for p in (A, B)]


@pytest.mark.slow
def test_it_is_right_and_its_covariance_is_what_repetition_shows():
    found = [refine_fundamental(*pairs(20, 3, 0.0), sigma_px=0.3)]
    assert np.abs(np.abs((found[0].matrix * TRUE).sum()) / np.linalg.norm(TRUE) - 1) < 1e-9
    rng, clean = np.random.default_rng(5), pairs(20, 3, 0.0)
    ends = []
    for _ in range(30):
        noisy = [p + rng.normal(0, 0.1, p.shape) for p in clean]
        one = refine_fundamental(*noisy, sigma_px=0.1)
        ends.append(1 / one.epipole_b[0])  # far outside: its inverse is nearly normal
        cov, e = one.cov_b[0, 0], one.epipole_b[0]
        found.append(np.sqrt(cov) / e**2)
    assert np.std(ends) == pytest.approx(np.median(found[1:]), rel=0.4)


def test_a_wrong_match_is_named():
    a, b = pairs(14, 1)
    b[4] += [30, 25]
    done = refine_fundamental(a, b, sigma_px=0.3)
    assert done
    assert np.flatnonzero(~done.used).tolist() == [4]
    assert np.abs(done.distance_px[4]) > 3
    assert np.abs(sampson_distance(done.matrix, *pairs(50, 9, 0.0))).max() < 2.0


def test_eight_matches_with_a_wrong_one_do_not_tell_which():
    a, b = pairs(8, 2)
    b[3] += [40, -30]
    done = refine_fundamental(a, b, sigma_px=0.3)
    assert not done
    assert "contradict" in done.reason
    assert np.isnan(done.matrix).all()


@pytest.mark.parametrize("wrong", [0, 1, 2])
def test_points_on_a_plane_are_refused_and_wrong_ones_off_it_do_not_help(wrong):
    a, b = pairs(14, 4, flat=True)
    for k in range(wrong):
        b[k] += [25, 18 * (-1) ** k]
    done = refine_fundamental(a, b, sigma_px=0.3)
    assert not done
    assert "homography explains all" in done.reason
    assert sorted(done.suspects) == list(range(wrong))


def test_too_few_a_line_and_no_baseline_are_refused():
    assert "needs 8" in refine_fundamental(*pairs(7, 0)).reason
    x = np.linspace(0, 900, 12)[:, None]
    assert "on a line" in refine_fundamental(np.hstack([x, 0.3 * x]), np.hstack([x, 0.5 * x]) + 4).reason
    a, _ = pairs(12, 0)
    assert "homography" in refine_fundamental(a, a + 7.0).reason


def test_wrong_arguments():
    a, b = pairs(9, 0)
    with pytest.raises(ValueError, match="both be"):
        refine_fundamental(a, b[:8])
    b[0, 0] = np.nan
    with pytest.raises(ValueError, match="finite"):
        refine_fundamental(a, b)
    with pytest.raises(ValueError, match="sigma_px"):
        refine_fundamental(a, a, sigma_px=0.0)
