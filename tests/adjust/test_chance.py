"""Probabilities of chance beside SciPy's distributions, and where those underflow beside exact arithmetic."""

import math
from fractions import Fraction

import pytest
from scipy import stats
from scipy.stats import binom

from windmark.adjust import chance, log_tail


@pytest.mark.parametrize(
    ("at_least", "trials", "probability"), [(1, 1, 0.5), (4, 10, 0.1), (41, 50, 0.01), (5, 5, 0.2), (3, 400, 0.9)]
)
def test_tail_is_that_of_the_binomial_distribution(at_least, trials, probability):
    assert log_tail(at_least, trials, probability) == pytest.approx(binom.logsf(at_least - 1, trials, probability))


@pytest.mark.parametrize(("at_least", "trials"), [(150, 160), (201, 220), (301, 400)])
def test_tail_below_the_smallest_number_is_still_told(at_least, trials):
    p = Fraction(1, 128)
    exact = sum(math.comb(trials, k) * p**k * (1 - p) ** (trials - k) for k in range(at_least, trials + 1))
    logarithm = math.log(exact.numerator) - math.log(exact.denominator)
    assert logarithm < math.log(1e-290)
    assert log_tail(at_least, trials, float(p)) == pytest.approx(logarithm, rel=1e-6)


def test_what_is_certain_and_what_cannot_be():
    assert log_tail(0, 5, 0.2) == 0.0
    assert log_tail(3, 5, 1.0) == 0.0
    assert log_tail(6, 5, 0.2) == -math.inf
    assert log_tail(1, 5, 0.0) == -math.inf


@pytest.mark.parametrize(("dof", "redundancy"), [(1, 4), (3, 20), (2, 3)])
def test_unknowns_that_are_not_there_explain_so_much_by_the_distribution_of_f(dof, redundancy):
    free = redundancy - dof
    for level in (0.5, 1e-2, 1e-6):
        f = stats.f.isf(level, dof, free)
        left = 7.0
        test = f * dof * left / free
        assert chance(test, dof, test + left, redundancy) == pytest.approx(level)
        assert chance(9 * test, dof, 9 * (test + left), redundancy) == pytest.approx(level)  # whatever sigma is


def test_what_tells_nothing_is_chance_and_what_leaves_nothing_is_none():
    assert chance(5.0, 0, 9.0, 4) == 1.0
    assert chance(5.0, 4, 9.0, 4) == 1.0
    assert chance(5.0, 3, 9.0, 4) < 1.0
    assert chance(9.0, 1, 9.0, 4) == 0.0
