"""Values of several pictures made one: weights and sigma by the rule of independent measurements."""

import numpy as np
import pytest

from windmark.resection.gains import Gains
from windmark.resection.merged_views import combined_values


def gains(gain, cov=None, systematic=0.0):
    count = len(gain)
    unknown = np.zeros(count)
    return Gains(
        np.array(gain, float), np.array([0.0, 7.0]), unknown, unknown, np.zeros((4, 4)) if cov is None else cov,
        np.ones(count, bool), np.zeros((count, count), np.int64), 0, systematic, True,
    )  # fmt: skip


def test_the_mean_has_the_least_variance_that_weights_can_give():
    """A picture twice as bright with the same noise of its pixels knows a value twice as well."""
    value, noise = np.array([[10.0, 10.0, np.nan], [27.0, np.nan, np.nan]]), 0.09
    own = combined_values(value, np.full((2, 3), noise), np.ones((2, 3)), gains([1.0, 2.0]))[1]
    np.testing.assert_array_equal(own, [[10.0, 10.0, np.nan], [10.0, np.nan, np.nan]])
    value[1, 0] += 1.0
    merged = combined_values(value, np.full((2, 3), noise), np.ones((2, 3)), gains([1.0, 2.0]))[0]
    np.testing.assert_allclose(merged.value, [(10.0 + 4 * 10.5) / 5, 10.0, np.nan])
    np.testing.assert_allclose(merged.sigma, [np.sqrt(1 / (1 / noise + 4 / noise)), np.sqrt(noise), np.nan])
    assert merged.source.tolist() == [1, 0, -1]


@pytest.mark.parametrize("both", [0.0, 1.0])
def test_what_is_not_known_of_gains_and_offsets_is_in_the_sigma(both):
    """By the derivatives of the value: -v / g of a gain, -1 / g of an offset; both pictures may share an error."""
    cov = np.diag([1e-4, 4e-4, 0.01, 0.04])
    cov[0, 1] = cov[1, 0] = both * 2e-4
    value = np.array([[10.0], [27.0]])
    merged = combined_values(value, np.zeros((2, 1)), np.ones((2, 1)), gains([1.0, 2.0], cov, 0.03))[0]
    by = np.array([-0.2 * 10.0, -0.8 * 10.0 / 2, -0.2, -0.8 / 2])
    expected = by @ cov @ by + (0.2**2 + 0.8**2) * (0.03 * 10.0) ** 2
    assert merged.sigma[0] == pytest.approx(np.sqrt(expected))
