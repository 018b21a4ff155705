"""What unknowns beside those of an adjustment would take off its residuals."""

import numpy as np
import pytest

from windmark.deformation.equations import CHECKED, Added


def test_groups_take_off_what_their_columns_span_and_no_more_unknowns_than_that():
    """By projection; the last column is the first one in another unit, and cannot be told from it."""
    rng = np.random.default_rng(9)
    b = rng.normal(size=(40, 4)) * [1.0, 30.0, 1e-3, 1.0]
    b[:, 3] = 50 * b[:, 0]
    residual = rng.normal(size=40)
    added = Added(b.T @ residual, b.T @ b, np.sqrt((b**2).sum(axis=0)), np.zeros((0, 4)))
    groups = np.array([[0, 1, 2], [1, 2, -1], [0, 3, -1], [2, -1, -1]])
    off, count = added.each(groups)
    assert count.tolist() == [3, 2, 1, 1]
    for k, group in enumerate(groups):
        own = group[group >= 0]
        left = residual - b[:, own] @ np.linalg.lstsq(b[:, own], residual, rcond=1e-9)[0]
        assert off[k] == pytest.approx(residual @ residual - left @ left, rel=5 * CHECKED)
        alone = added.fitted(own)
        assert alone[:2] == (pytest.approx(off[k]), count[k])
