"""Weighted quantiles against values that are repeated as often as they weigh."""

import numpy as np
import pytest

from windmark.detection.quantile import weighted_quantile


@pytest.mark.parametrize("share", [0.02, 0.5, 0.75, 1.0])
def test_it_is_the_quantile_of_repeated_values(share):
    rng = np.random.default_rng(4)
    values, weight = rng.normal(size=(6, 9)), rng.integers(0, 5, (6, 9))
    weight[:, 0] = 1
    got = weighted_quantile(values, weight.astype(float), share)
    for row, w, q in zip(values, weight, got, strict=True):
        every = np.sort(np.repeat(row, w))
        assert q == every[int(np.ceil(share * len(every) - 1e-9)) - 1]
    assert weighted_quantile(values[0], weight[0].astype(float), share) == got[0]
