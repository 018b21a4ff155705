"""Fundamental matrices from eight or more, and from seven pairs."""

import numpy as np
import pytest

from windmark.geometry import DegenerateGeometry, Pose
from windmark.geometry.two_view import (
    fundamental_eight_point,
    fundamental_from_poses,
    fundamental_seven_point,
    ideal_pixels,
    sampson_distance,
)


def ideal(s):
    truth = fundamental_from_poses(s.camera_a, Pose.identity(), s.camera_b, s.b_from_a)
    return ideal_pixels(s.camera_a, s.xy_a), ideal_pixels(s.camera_b, s.xy_b), truth


def off(f, truth):
    return min(np.abs(f - truth).max(), np.abs(f + truth).max()) / np.abs(truth).max()


@pytest.mark.parametrize("n", [8, 9, 60])
def test_eight_or_more(scene, other_camera, n):
    a, b, truth = ideal(scene(n=n, camera_b=other_camera, seed=n))
    f = fundamental_eight_point(a, b)
    assert off(f, truth) < 1e-7
    assert np.linalg.svd(f, compute_uv=False)[2] < 1e-14


def test_noise_leaves_small_residuals_and_swapping_transposes(scene):
    a, b, _ = ideal(scene(n=60, sigma=0.1))
    f = fundamental_eight_point(a, b)
    assert np.sqrt(np.mean(sampson_distance(f, a, b) ** 2)) < 0.15
    assert off(fundamental_eight_point(b, a).T, f) < 0.05


def test_seven_pairs(scene):
    a, b, truth = ideal(scene(n=70))
    found = fundamental_seven_point(a.reshape(10, 7, 2), b.reshape(10, 7, 2))
    assert found.shape == (10, 3, 3, 3)
    count = np.isfinite(found[..., 0, 0]).sum(axis=1)
    assert set(count.tolist()) <= {1, 3}
    assert {1, 3} & set(count.tolist())
    for k in range(10):
        real = found[k][np.isfinite(found[k, :, 0, 0])]
        assert min(off(f, truth) for f in real) < 1e-6
        for f in real:
            assert np.abs(sampson_distance(f, a[7 * k : 7 * k + 7], b[7 * k : 7 * k + 7])).max() < 1e-6
            assert abs(np.linalg.det(f / np.abs(f).max())) < 1e-9
    np.testing.assert_allclose(fundamental_seven_point(a[:7], b[:7]), found[0], rtol=1e-6, atol=1e-12)


def test_a_plane_determines_no_fundamental_matrix(scene):
    a, b, _ = ideal(scene("plane", n=30))
    with pytest.raises(DegenerateGeometry, match="several F"):
        fundamental_eight_point(a, b)
    assert np.isnan(fundamental_seven_point(a[:7], b[:7])).all()


def test_bad_input(scene):
    a, b, _ = ideal(scene(n=9))
    with pytest.raises(ValueError, match="at least eight"):
        fundamental_eight_point(a[:7], b[:7])
    with pytest.raises(ValueError, match="seven pairs"):
        fundamental_seven_point(a, b)
    with pytest.raises(ValueError, match=r"\(\.\.\., N, 2\)"):
        fundamental_eight_point(a, b[:8])
    a[0, 0] = np.nan
    with pytest.raises(ValueError, match="finite"):
        fundamental_eight_point(a, b)
