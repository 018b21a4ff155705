"""Points near each other, few or many."""

import numpy as np
import pytest

from windmark.detection.pairs import FEW, close_pairs, nearest


@pytest.mark.parametrize("count", [2, 40, FEW, FEW + 60])
def test_pairs_and_the_least_distance(count):
    xy = np.random.default_rng(count).uniform(0, 100, (count, 2))
    away = np.hypot(*(xy[:, None] - xy).T)
    i, j = np.nonzero(np.triu(away <= 9.0, 1))
    assert sorted(map(tuple, close_pairs(xy, 9.0).tolist())) == sorted(zip(i.tolist(), j.tolist(), strict=True))
    assert nearest(xy) == pytest.approx(away[np.triu_indices(count, 1)].min())


def test_one_point_has_no_neighbour():
    assert nearest(np.zeros((1, 2))) == np.inf
    assert len(close_pairs(np.zeros((1, 2)), 5.0)) == 0
