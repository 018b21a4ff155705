"""Test values of marks against their definition, and their distribution in a linear model whose truth is known."""

import numpy as np
import pytest
from scipy import stats

from windmark.calibration.snooping import FALSE, critical, externally, statistic


def test_any_of_the_right_marks_is_called_wrong_once_in_twenty():
    for count in (1, 30, 5000):
        assert count * stats.chi2.sf(critical(count), 2) == pytest.approx(FALSE)
    assert critical(0) == critical(1)


@pytest.mark.parametrize("used", [True, False])
def test_the_statistic_is_the_residual_in_what_is_left_of_its_noise(used):
    rng = np.random.default_rng(1)
    root = rng.uniform(-0.5, 0.5, (40, 2, 2))
    influence = root @ root.transpose(0, 2, 1)
    influence[0] = 0.0  # nothing follows this mark
    influence[1] = 0.3 * np.eye(2)  # the same along all axes
    residual = rng.normal(size=(40, 2))
    q = np.eye(2) + (-influence if used else influence)
    expected = [r @ np.linalg.solve(c, r) for r, c in zip(residual, q, strict=True)]
    np.testing.assert_allclose(statistic(residual, influence, np.full(40, used)), expected, rtol=1e-9)


def test_a_mark_that_alone_determines_something_is_not_tested():
    influence = np.array([np.eye(2), np.diag([1.0, 0.5])])
    residual = np.array([[0.0, 0.0], [0.0, 0.7]])
    np.testing.assert_allclose(statistic(residual, influence, np.ones(2, bool)), [0.0, 0.49 / 0.5], atol=1e-12)


def model(rng, marks=8, unknowns=5):
    """Marks of two coordinates in a linear model; the last one is left out of the adjustment."""
    j = rng.normal(size=(2 * marks, unknowns))
    y = rng.normal(0, 3.0, 2 * marks)  # their sigma is not known: all are three times as large as stated
    used = np.arange(marks) < marks - 1
    rows = np.repeat(used, 2)
    cov = np.linalg.inv(j[rows].T @ j[rows])
    residual = y - j @ (cov @ j[rows].T @ y[rows])
    influence = np.stack([j[2 * k : 2 * k + 2] @ cov @ j[2 * k : 2 * k + 2].T for k in range(marks)])
    squares, redundancy = float((residual[rows] ** 2).sum()), int(rows.sum()) - unknowns
    test = statistic(residual.reshape(-1, 2), influence, used)
    return externally(test, used, squares, redundancy)


def test_values_beside_the_others_are_chi_square_whatever_the_redundancy():
    """Nine degrees of freedom. 1500 draws tell a distribution within 0.035 (one in twenty)."""
    rng = np.random.default_rng(2)
    drawn = np.array([model(rng) for _ in range(1500)])
    for mark in (0, 3, 7):
        assert stats.kstest(drawn[:, mark], stats.chi2(2).cdf).statistic < 0.035


def test_where_nothing_is_left_to_compare_with_nothing_stands_out():
    test, used = np.array([3.0, 4.0]), np.array([True, False])
    np.testing.assert_array_equal(externally(test, used, 0.0, 5), [0.0, 0.0])
    assert externally(test, used, 10.0, 2)[0] == 0.0
    assert externally(test, used, 10.0, 3)[0] > 0
    assert externally(test, used, 10.0, 0)[1] == 0.0
    # A mark that is the whole sum of squares stands out without end, and is a number.
    whole = externally(np.array([10.0]), np.array([True]), 10.0, 6)
    assert 50 < whole[0] < np.inf
