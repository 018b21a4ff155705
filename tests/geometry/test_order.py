"""Quantiles and medians against numpy's."""

import numpy as np
import pytest

from windmark.geometry.order import median, quantile


@pytest.mark.parametrize("count", [1, 2, 5, 6, 100])
def test_they_are_those_of_numpy(count):
    values = np.random.default_rng(count).normal(size=count)
    assert median(values) == np.median(values)
    for share in (0.0, 0.2, 0.5, 0.77, 1.0):
        assert quantile(values, share) == pytest.approx(np.quantile(values, share), rel=1e-14)
