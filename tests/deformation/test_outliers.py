"""Test values of single spots: what others say of one that took part is what they predict of it without it."""

import numpy as np
import pytest
from swept_scenes import CAMERAS, MARKERS, PARTS, VIEWS, observed, seen

from windmark.adjust import Loss, covariance, minimise
from windmark.deformation.outliers import FALSE, MEDIAN, critical, scale_of
from windmark.deformation.outliers import test_left_out as value_left_out
from windmark.deformation.outliers import test_used as value_used
from windmark.deformation.setup import prepare, start_values
from windmark.deformation.solve import FINE, _many_gross, free_names, sighting, solve
from windmark.deformation.volumes import Volumes


@pytest.fixture(scope="module")
def whole():
    spots = observed(seen(), np.random.default_rng(5))
    task = prepare(spots, MARKERS, Volumes.of(PARTS), CAMERAS, VIEWS, True, None, False, None, False, None, None)
    values = start_values(task, None)
    return solve(task, values, task.eccentricity(values), False, near=False)


def without(whole, spot):
    """The test value of a spot from its prediction, adjusted without it."""
    used = np.ones(len(whole.used), bool)
    used[spot] = False
    problem = whole.task.problem(whole.values, whole.shift, used, Loss())
    values, system, _ = minimise(problem, whole.values, FINE)
    cov = covariance(system, free_names(problem))
    test = value_left_out(whole.task, problem, values, cov, whole.shift, ~used)
    assert np.isnan(test[used]).all()
    return test[spot]


@pytest.mark.parametrize("spot", [0, 17, -1])
def test_within_and_without_are_the_same_value(whole, spot):
    test = value_used(whole.task, sighting(whole.problem), whole.values, whole.cov, whole.used)
    assert test[spot] == pytest.approx(without(whole, spot), rel=0.02)
    np.testing.assert_allclose(test, whole.test)


def test_nobody_left_out_has_no_test(whole):
    none = np.zeros(len(whole.used), bool)
    assert np.isnan(value_left_out(whole.task, whole.problem, whole.values, whole.cov, whole.shift, none)).all()


def test_limits_are_those_of_chi_square_with_two_degrees_of_freedom():
    rng = np.random.default_rng(6)
    drawn = rng.chisquare(2, 100_001)
    assert np.median(drawn) == pytest.approx(MEDIAN, rel=0.02)
    assert scale_of(4 * drawn) == pytest.approx(4, rel=0.02)
    assert scale_of(0.3 * drawn) == 1.0  # smaller than stated is no reason for narrower limits
    assert scale_of(np.r_[4 * drawn, np.full(9, np.nan)]) == pytest.approx(4, rel=0.02)
    assert scale_of(np.full(3, np.nan)) == 1.0
    for count in (1, 50, 400):
        assert count * np.exp(-critical(count) / 2) == pytest.approx(FALSE)
    assert critical(0) == critical(1)


def test_one_gross_error_is_left_to_single_tests_and_two_are_not():
    test = np.random.default_rng(7).chisquare(2, 200).clip(max=9.0)
    for gross, many in ((0, False), (1, False), (2, True)):
        test[:gross] = 1e4
        assert _many_gross(test, 20.0) == many
    assert _many_gross(np.minimum(10 * test[2:], 19.0), 20.0)  # most are too large: it is not a few spots
