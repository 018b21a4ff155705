"""Parts of the fit to the taps, against plain least squares, probabilities and draws."""

import numpy as np
import pytest
from scipy import integrate, stats

from windmark.paint import NodeField
from windmark.paint.tap_fit import (
    FALSE,
    _backward,
    _best_half,
    _critical,
    _of_best,
    _scatter,
    _student,
    _Taps,
    _tests,
    fit_taps,
)


def taps(rng, count=12, free="both", order=1, shared=0.02, sigma=0.1):
    x = rng.uniform(-1, 1, count)
    field = (
        NodeField.make(x, 0.03)
        .with_mode("lamp", np.full(count, shared))
        .with_mode("pose", shared * rng.normal(size=count))
    )
    powers = ((x - 0.1) / 0.8)[:, None] ** np.arange(order + 1)
    p = powers @ np.array([2.0, 1.6 if free == "both" else 0.8, 0.3, 0.1][: order + 1])
    return _Taps(
        p + rng.normal(0, sigma, count), np.full(count, sigma**2) * rng.uniform(0.5, 2, count), field, powers, 0.8, free
    )


@pytest.mark.parametrize("order", [1, 2, 3])
def test_slope_and_covariance_are_those_of_the_polynomial(order):
    rng = np.random.default_rng(order)
    some, coefficients = taps(rng, order=order), rng.normal(size=order + 1)
    x = some.x.value

    def curve(at):
        return (((at - 0.1) / 0.8)[:, None] ** np.arange(order + 1)) @ coefficients

    slope = (curve(x + 1e-6) - curve(x - 1e-6)) / 2e-6
    np.testing.assert_allclose(some.slope(coefficients), slope, rtol=1e-6, atol=1e-8)
    of = np.array([0, 3, 4, 9])
    modes = slope[of, None] * some.x.modes[of]
    expected = np.diag(some.variance[of] + (slope[of] * 0.03) ** 2 + 0.25) + modes @ modes.T
    np.testing.assert_allclose(some.covariance(of, coefficients, 0.5), expected, rtol=1e-6)


@pytest.mark.parametrize("free", ["both", "offset"])
def test_the_fit_is_least_squares_of_whitened_readings(free):
    rng = np.random.default_rng(4)
    some, of = taps(rng, free=free), np.array([1, 2, 3, 5, 8, 11])
    total = some.covariance(of, np.array([2.0, 1.5]), 0.2)
    coefficients, response, cov = some.solve(of, total)
    white = np.linalg.inv(np.linalg.cholesky(total))
    if free == "both":
        expected = np.linalg.lstsq(white @ some.powers[of], white @ some.p[of], rcond=None)[0]
        np.testing.assert_allclose(response @ some.powers[of], np.eye(2), atol=1e-9)
    else:  # a slope of 1: only the offset is asked
        rest = some.p[of] - (some.x.value[of] - 0.1)
        expected = np.array([*np.linalg.lstsq(white @ np.ones((6, 1)), white @ rest, rcond=None)[0], 0.8])
    np.testing.assert_allclose(coefficients, expected, rtol=1e-8)
    np.testing.assert_allclose(cov, response @ total @ response.T)
    step = np.eye(6)[2] * 1e-3
    some.p[of] += step
    np.testing.assert_allclose(some.solve(of, total)[0] - coefficients, response @ step, atol=1e-12)


@pytest.mark.parametrize("share", [0.3, 0.5, 0.75, 1.0])
def test_what_fits_best_by_choice_scatters_less(share):
    """Mean square of the normal deviates below the quantile of their size."""
    q = stats.norm.ppf(0.5 + share / 2)
    expected = integrate.quad(lambda z: z * z * stats.norm.pdf(z), -q, q)[0] / share if share < 1 else 1.0
    assert _of_best(share) == pytest.approx(expected, rel=1e-8)
    assert _of_best(1.3) == 1.0


@pytest.mark.parametrize(("count", "dof"), [(5, 3), (40, 30), (1, 1)])
def test_any_of_the_good_taps_is_left_out_once_in_twenty(count, dof):
    assert count * 2 * stats.t.sf(_critical(count, dof), dof) == pytest.approx(FALSE)
    assert _critical(count, 0) == _critical(count, 1)
    assert _critical(0, 3) == _critical(1, 3)


def test_a_scatter_from_few_residuals_is_widened_to_hold_95_percent():
    for dof in (1, 4, 100):
        assert 2 * stats.t.sf(1.959964 * _student(dof), dof) == pytest.approx(0.05, rel=1e-6)
    assert _student(0) == _student(1)


@pytest.mark.parametrize(("count", "unknowns", "half"), [(12, 2, 7), (13, 2, 8), (3, 2, 3), (2, 2, 2), (9, 1, 5)])
def test_the_search_begins_with_those_that_agree(count, unknowns, half):
    rng = np.random.default_rng(count)
    some = taps(rng, count, "both" if unknowns == 2 else "offset", shared=0.0, sigma=1e-3)
    wrong = np.arange(count) >= half
    some.p[wrong] += 5.0 + np.arange(wrong.sum())
    np.testing.assert_array_equal(_best_half(some, np.arange(count), unknowns), np.arange(half))


def test_sizes_of_residuals_are_standard_normal_for_good_taps():
    """Of those that count and of those left out; 3000 draws tell a standard deviation within 4 %."""
    rng = np.random.default_rng(6)
    sizes = [], []
    for _ in range(300):
        some = taps(rng, 14, shared=0.0)
        some = _Taps(some.p, np.full(14, 0.1**2), some.x, some.powers, 0.8, "both")
        off = 2.0 * rng.normal(0, 0.03, 14)  # what x itself is off by moves the readings by the slope
        some.p[:] += off
        inside, outside = _tests(some, np.arange(10), np.arange(14), trimmed=False)
        assert np.isnan(inside[10:]).all()
        assert np.isnan(outside[:10]).all()
        sizes[0].append(inside[:10])
        sizes[1].append(outside[10:])
    for found in sizes:
        assert 0.82 < np.sqrt(np.mean(np.square(found))) < 1.03  # a scale below 1 is not believed


def test_nobody_stands_out_of_too_few():
    """With two more than there are unknowns all stay; with one more of these the odd one goes."""
    for count, left in ((4, 4), (8, 7)):
        some = taps(np.random.default_rng(1), count, shared=0.0, sigma=1e-3)
        some.p[0] += 50.0
        assert len(_backward(some, np.arange(count), np.arange(count), 2)) == left


def test_scatter_is_that_which_explains_the_residuals():
    rng = np.random.default_rng(9)
    some = taps(rng, 60, shared=0.0)
    assert _scatter(taps(rng, 60, shared=0.0, sigma=1e-4), np.arange(60), np.array([2.0, 1.6])) == pytest.approx(
        0.0, abs=1e-2
    )
    more = _Taps(some.p + rng.normal(0, 1.0, 60), some.variance, some.x, some.powers, 0.8, "both")
    found = _scatter(more, np.arange(60), np.array([2.0, 1.6]))
    assert 0.75 < found < 1.3  # 60 residuals: 9 % each way
    total = more.covariance(np.arange(60), np.array([2.0, 1.6]), found)
    r = more.p - more.powers @ more.solve(np.arange(60), total)[0]
    assert r @ np.linalg.solve(total, r) == pytest.approx(58, rel=1e-6)
    assert _scatter(more, np.arange(2), np.array([2.0, 1.6])) == 0.0


def test_blocked_taps_are_told_and_how_far_they_are_off():
    rng = np.random.default_rng(12)
    x = np.linspace(0, 1, 20)
    p = 3.0 + 2.0 * x + rng.normal(0, 0.01, 20)
    p[[4, 11]] += [0.5, -0.3]
    have = np.ones(20, bool)
    have[7] = False
    fit = fit_taps(p, np.full(20, 0.01), NodeField.make(x, 1e-3), have, 0.5, 0.5, 1, "both")
    assert np.flatnonzero(~fit.used).tolist() == [4, 7, 11]
    assert set(fit.reasons) == {4, 11}
    assert fit.reasons[4].startswith("+0.")
    assert fit.reasons[11].startswith("-0.")
    np.testing.assert_allclose(fit.coefficients, [4.0, 1.0], atol=0.02)
    assert np.isnan(fit.residuals[7])
    assert np.sqrt(np.diag(fit.cov))[0] == pytest.approx(0.01 / np.sqrt(17), rel=0.35)
