"""Measured radius, ellipse, depth and covariance of SPOT's bowl."""

from functools import partial

import numpy as np
import pytest

import windmark as wm

bowl = partial(wm.detect, refine="bowl")


@pytest.mark.parametrize("blur", [0, 1, 2])
@pytest.mark.parametrize("angle", [0.0, 0.5, 1.4])
def test_ellipse(angle, blur, draw):
    image = draw((60, 60), [(30.2, 29.7, 7.0, 5.0, angle)], blur=blur) + np.random.default_rng(0).normal(
        0, 0.5, (60, 60)
    )
    found = bowl(image, radius_px=6.0)
    assert len(found) == 1
    np.testing.assert_allclose(found.axes_px[0], [7.0, 5.0], rtol=0.03)
    assert found.angle[0] == pytest.approx(angle, abs=0.03)
    assert found.radius_px[0] == pytest.approx(np.sqrt(35), rel=0.02)
    assert found.radius_px[0] == pytest.approx(np.sqrt(found.axes_px[0].prod()), rel=1e-6)
    assert found.depth[0] == pytest.approx(60, rel=0.02)


def test_axes_are_left_out_where_noise_hides_them(draw):
    rng = np.random.default_rng(1)
    image = draw((60, 60), [(30.2, 29.7, 2.0)]) + rng.normal(0, 15, (60, 60))
    found = bowl(image, radius_px=2.0, min_quality=1.0, max_spots=1)
    assert len(found) == 1
    assert np.isnan(found.axes_px).all()
    assert np.isnan(found.angle).all()


@pytest.mark.parametrize(
    ("r0", "noise", "runs"), [(2.0, 0.03, 250), (2.0, 0.08, 250), (3.0, 0.01, 250), (3.0, 0.1, 250), (6.0, 0.05, 200)]
)
def test_covariance_is_that_of_many_runs(r0, noise, runs, draw):
    """Standardised errors over random discs and noise: 1 if the covariance is right; 0.8 ... 1.25 is promised."""
    rng = np.random.default_rng(int(100 * r0 + 1000 * noise))
    n, z = 80, []
    for _ in range(runs):
        x, y = n / 2 + rng.uniform(-0.5, 0.5, 2)
        a, turn = r0 * rng.uniform(0.95, 1.1), rng.uniform(0, np.pi)
        image = draw((n, n), [(x, y, a, a * rng.uniform(0.75, 1), turn)], blur=1) + rng.normal(0, 60 * noise, (n, n))
        found = bowl(image, radius_px=r0, max_spots=1)
        if len(found):
            z.append(np.linalg.solve(np.linalg.cholesky(found.cov[0]), found.xy[0] - [x, y]))
    assert len(z) > 0.8 * runs
    assert 0.8 < np.std(z) < 1.25
    assert np.abs(np.mean(z, axis=0)).max() < 0.25


def test_covariance_of_an_ellipse_is_one(draw):
    """The long axis is known less well: fewer edge pixels look along it."""
    image = draw((60, 60), [(30.2, 29.7, 7.5, 4.8, 0.0)]) + np.random.default_rng(0).normal(0, 3, (60, 60))
    found = bowl(image, radius_px=6.0)
    assert found.cov[0, 0, 0] > 1.3 * found.cov[0, 1, 1]
    assert np.linalg.eigvalsh(found.cov[0]).min() > 0
