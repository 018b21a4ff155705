"""How much bending and how much noise the spline takes: where the marks are most probable."""

import numpy as np
import pytest

from windmark.geometry.planar.spline import _smoothing


@pytest.mark.parametrize("known", [False, True])
def test_bending_and_noise_are_where_the_likelihood_has_no_slope(known):
    """Coefficients of variance bending (stiff + ratio): the score is zero, by the formula of normal numbers."""
    rng = np.random.default_rng(3)
    stiff = np.geomspace(1e-3, 10.0, 300)
    noise = 0.02
    seen = np.sqrt(0.7 * stiff + noise)[:, None] * rng.normal(size=(300, 2))
    ratio, bending = _smoothing(stiff, seen, 2 * noise if known else 0.5 * noise)
    of_each = bending * (stiff + ratio)
    score = 2 / of_each - (seen**2).sum(axis=1) / of_each**2
    assert stiff @ score == pytest.approx(0.0, abs=2e-3 * (2 * stiff @ (1 / of_each)))
    assert bending == pytest.approx(0.7, rel=0.3)
    if known:  # the marks' own noise is more than they show, and is kept
        assert ratio * bending == pytest.approx(2 * noise)
    else:
        assert score.sum() == pytest.approx(0.0, abs=2e-3 * (2 / of_each).sum())
        assert ratio * bending == pytest.approx(noise, rel=0.3)
