"""Marks that fit each other's marker."""

import numpy as np
import pytest

from windmark.adjust import exchanged_pairs
from windmark.adjust.exchanged import NEAR


@pytest.mark.parametrize(("off", "fits"), [(0.95, True), (1.05, False)])
def test_two_marks_that_both_fit_the_others_place_are_a_pair(off, fits):
    there = np.array([[0.0, 0], [100, 0], [0, 100], [100, 100]])
    sigma = np.array([0.5, 1.0, 2.0, 1.0])
    seen = there[[2, 1, 0, 3]].copy()
    seen[0] += [off * NEAR * sigma[0], 0.0]
    assert exchanged_pairs(seen, there, sigma) == ([(0, 2)] if fits else [])
    seen[0] -= [off * NEAR * sigma[0], 0.0]
    seen[2] += [0.0, -off * NEAR * sigma[2]]
    assert exchanged_pairs(seen, there, sigma) == ([(0, 2)] if fits else [])


def test_what_is_not_predicted_fits_nobody_and_one_in_its_place_is_no_pair():
    there = np.array([[0.0, 0], [100, 0]])
    assert exchanged_pairs(there[::-1], there, np.ones(2)) == [(0, 1)]
    assert exchanged_pairs(there[::-1], [[0.0, 0], [np.nan, np.nan]], np.ones(2)) == []
    assert exchanged_pairs(there, there, np.ones(2)) == []
    assert exchanged_pairs(there[[1, 1]], there, np.ones(2)) == []  # one way only
    assert exchanged_pairs(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0)) == []
