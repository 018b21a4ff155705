"""The fit of a paint's law: least squares, leave-one-out by refits, choice and mean of orders, refusals."""

import numpy as np
import pytest

from windmark.errors import UsageError
from windmark.paint import fit_paint
from windmark.paint.cell_fit import LITTLE, MOST_P, MOST_T, _averaged, _Candidate, _candidate, _chosen, _levels, _table

P, T = (v.ravel() for v in np.meshgrid(np.linspace(2e4, 1.2e5, 7), [285.0, 295.0, 300.0, 312.0]))


def law(p, t):
    x, d = p / 1e5, t - 300.0
    return 0.2 + 0.003 * d + (0.7 - 0.002 * d) * x + 0.1 * x**2


def table(ratio, sigma=None, p_sigma=0.0, t_sigma=0.0, p=P, t=T):
    return _table(p, t, ratio, 1e5, 300.0, sigma, p_sigma, t_sigma, ("Pa", "K"))


def noisy(seed=0, sigma=0.002):
    return law(P, T) + np.random.default_rng(seed).normal(0, sigma, P.size)


def powers(k, j, p=P, t=T):
    return np.stack([(p / 1e5) ** a * (t - 300.0) ** b for a in range(k + 1) for b in range(j + 1)], axis=1)


@pytest.mark.parametrize("order", [(1, 0), (2, 1), (3, 3)])
def test_coefficients_and_covariance_are_those_of_least_squares(order):
    ratio, sigma = noisy(), np.random.default_rng(1).uniform(0.001, 0.004, P.size)
    got = _candidate(table(ratio, sigma), *order)
    design = powers(*order) / sigma[:, None]
    expected, squares = np.linalg.lstsq(design, ratio / sigma, rcond=None)[:2]
    np.testing.assert_allclose(got.coefficients.ravel(), expected, rtol=1e-6, atol=1e-12)
    assert got.dof == P.size - expected.size
    assert got.squares == pytest.approx(squares[0], rel=1e-8)
    larger = max(squares[0] / got.dof, 1.0)
    np.testing.assert_allclose(got.cov, np.linalg.inv(design.T @ design) * larger, rtol=1e-4, atol=1e-18)
    # Sigmas that are not known come from the residuals, also where these are small.
    own = _candidate(table(ratio), *order)
    plain, left = np.linalg.lstsq(powers(*order), ratio, rcond=None)[:2]
    np.testing.assert_allclose(own.coefficients.ravel(), plain, rtol=1e-6, atol=1e-12)
    cov = np.linalg.inv(powers(*order).T @ powers(*order)) * left[0] / own.dof
    np.testing.assert_allclose(own.cov, cov, rtol=1e-4, atol=1e-20)


def test_errors_of_pressure_and_temperature_count_by_the_laws_slopes():
    ratio, h = noisy(), 1e-4
    got = _candidate(table(ratio, 0.001, 300.0, 0.4), 2, 1)
    c = got.coefficients.ravel()
    by_p = (powers(2, 1, P + 1.0) @ c - powers(2, 1, P - 1.0) @ c) / 2
    by_t = (powers(2, 1, t=T + h) @ c - powers(2, 1, t=T - h) @ c) / (2 * h)
    sigma = np.sqrt(0.001**2 + (300 * by_p) ** 2 + (0.4 * by_t) ** 2)
    again = np.linalg.lstsq(powers(2, 1) / sigma[:, None], ratio / sigma, rcond=None)[0]
    np.testing.assert_allclose(c, again, rtol=1e-6)
    assert got.squares == pytest.approx((((ratio - powers(2, 1) @ c) / sigma) ** 2).sum(), rel=1e-6)


def test_cross_validation_is_that_of_fits_without_each_row():
    ratio = noisy()
    got = _candidate(table(ratio), 2, 1)
    for row in (0, 9, P.size - 1):
        rest = np.arange(P.size) != row
        c = np.linalg.lstsq(powers(2, 1)[rest], ratio[rest], rcond=None)[0]
        assert got.press[row] == pytest.approx(ratio[row] - powers(2, 1)[row] @ c, rel=1e-6)


def fake(order, press, squares=1.0, coefficients=None, rows=28):
    shape = order[0] + 1, order[1] + 1
    a = np.ones(shape) if coefficients is None else coefficients
    return _Candidate(a, 0.01 * np.eye(a.size), press, press, squares, rows - a.size)


def test_the_simplest_order_within_one_standard_error_is_chosen():
    rng = np.random.default_rng(3)
    best = rng.normal(size=28)
    error = (best**2).std() / np.sqrt(28) / (best**2).mean()
    for more, chosen in ((0.9, (1, 1)), (1.1, (2, 1))):
        found = {(3, 2): fake((3, 2), best), (2, 1): fake((2, 1), best * 1.001),
                 (1, 1): fake((1, 1), best * np.sqrt(1 + more * error))}  # fmt: skip
        assert _chosen(found) == chosen
    # Of as many unknowns the one that predicts better.
    assert _chosen({(1, 2): fake((1, 2), best * 1.01), (2, 1): fake((2, 1), best)}) == (2, 1)


def test_the_mean_of_orders_has_akaikes_weights_and_their_scatter():
    n, some = 28, table(law(P, T))
    a, b = np.array([[1.0, 0.0], [2.0, 0.5]]), np.array([[1.2], [1.5], [0.3]])
    found = {(1, 1): fake((1, 1), np.ones(n), 1.0, a), (2, 0): fake((2, 0), np.ones(n), 1.02, b)}
    score = []
    for squares, unknowns in ((1.0, 4), (1.02, 3)):
        k = unknowns + 1  # and the scatter
        score.append(n * np.log(squares / n) + 2 * k + 2 * k * (k + 1) / (n - k - 1))
    w = np.exp(-0.5 * (np.array(score) - min(score)))
    w /= w.sum()
    assert w.min() > LITTLE
    one, other = np.zeros((3, 2)), np.zeros((3, 2))
    one[:2], other[:, :1] = a, b
    mean, cov = _averaged(some, found)
    np.testing.assert_allclose(mean, w[0] * one + w[1] * other)
    expected = np.zeros((6, 6))
    for each, weight, known in ((one, w[0], [0, 1, 2, 3]), (other, w[1], [0, 2, 4])):
        off = (each - mean).ravel()
        expected += weight * np.outer(off, off)
        expected[known, known] += weight * 0.01
    np.testing.assert_allclose(cov, expected, atol=1e-15)
    alone = {(1, 1): found[1, 1], (2, 0): fake((2, 0), np.ones(n), 9.0, b)}  # so much worse that it has no weight
    np.testing.assert_array_equal(_averaged(some, alone)[0], a)


def test_levels_are_apart_by_a_hundredth_of_the_span():
    assert _levels(np.array([3.0, 3.0])) == 1
    assert _levels(np.array([0.0, 100.0, 100.9, 0.5])) == 2
    assert _levels(np.array([0.0, 100.0, 98.0])) == 3


@pytest.mark.parametrize(
    ("p", "t", "order", "words"),
    [
        (P[:14] * 0 + 5e4, T[:14], (1, 0), r"needs 2 different pressures, the table has 1"),
        (P, T * 0 + 300.0, (1, 1), r"needs 2 different temperatures, the table has 1"),
        (P[:4] + np.arange(4), np.array([290.0, 300.0, 290.0, 300.0]), (1, 1), r"has 4 unknowns, the table 4 rows"),
        (np.linspace(2e4, 1e5, 9), np.linspace(290.0, 310.0, 9), (1, 1), "its terms cannot be told apart"),
    ],
)
def test_tables_that_do_not_determine_an_order(p, t, order, words):
    found = fit_paint(p, t, law(p, t), p_ref=1e5, t_ref=300.0, order=order)
    assert not found
    import re

    assert re.search(words, found.reason)


def test_a_law_that_falls_is_refused():
    falling = fit_paint(P, T, 2.0 - P / 1e5, p_ref=1e5, t_ref=300.0, order=(1, 0))
    assert "does not rise with pressure" in falling.reason


def test_rows_that_alone_decide_a_term_are_predicted_by_no_other():
    """Two rows at the second temperature: a slope of their own goes through them exactly."""
    p, t = np.array([2e4, 7e4, 1.2e5, 4e4, 1e5]), np.array([285.0, 285.0, 285.0, 295.0, 295.0])
    fit = fit_paint(p, t, law(p, t), p_ref=1e5, t_ref=300.0, order=(1, 1))
    assert fit.order == (1, 1)
    assert fit.cv_rms == np.inf
    assert fit_paint(p, t, law(p, t), p_ref=1e5, t_ref=300.0).cv_rms < np.inf  # another order is


def test_what_the_fit_says_of_itself():
    loud = fit_paint(P, T, noisy(sigma=0.02), p_ref=1e5, t_ref=300.0, ratio_sigma=0.002, order=(2, 1))
    assert loud.sigma0 == pytest.approx(10, rel=0.35)
    assert f"the residuals are {loud.sigma0:.3g} times their stated sigmas" in loud.warnings[0]
    assert not fit_paint(P, T, noisy(), p_ref=1e5, t_ref=300.0, ratio_sigma=0.002, order=(2, 1)).warnings
    one = fit_paint(P[:7], np.full(7, 300.0), law(P[:7], 300.0), p_ref=1e5, t_ref=300.0, order=(1, 0))
    assert "one temperature alone" in one.warnings[0]
    assert np.isnan(one.sigma0)
    free = fit_paint(P, T, noisy(), p_ref=1e5, t_ref=300.0)
    assert set(free.orders) == {(k, j) for k in range(1, MOST_P + 1) for j in range(MOST_T + 1)}
    np.testing.assert_allclose(free.residuals, noisy() - free.law.ratio(P, T))
    assert free.rms == pytest.approx(np.sqrt((free.residuals**2).mean()))
    assert free.law.p_range == (2e4, 1.2e5)
    assert free.law.t_range == (285.0, 312.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"order": (0, 1)}, "order must be 1 to 4 and 0 to 3"), ({"order": (5, 1)}, "order must be"),
        ({"order": (1, 4)}, "order must be"), ({"order": (1, -1)}, "order must be"),
        ({"ratio": [1.0, 0.0, 1.0]}, "row 2: ratio is 0; expected a number above zero"),
        ({"pressure": [1.0, 2.0, -3.0]}, "row 3: pressure is -3"),
        ({"temperature": [np.nan, 1.0, 1.0]}, "row 1: temperature is nan; expected a number finite"),
        ({"p_ref": 0.0}, "p_ref must be > 0"), ({"t_ref": np.inf}, "t_ref finite"),
        ({"ratio_sigma": 0.0}, "above zero"),
        ({"pressure_sigma": np.inf}, "sigmas must be finite"), ({"ratio": [1.0]}, r"got \(3,\), \(3,\), \(1,\)"),
        ({"pressure": [], "temperature": [], "ratio": []}, "no rows"),
    ],
)  # fmt: skip
def test_wrong_use(change, words):
    good = {
        "pressure": [1.0, 2.0, 3.0],
        "temperature": [-5.0, 1.0, 1.0],
        "ratio": [1.0, 2.0, 3.0],
        "p_ref": 1.0,
        "t_ref": 0.0,
    }
    with pytest.raises((UsageError, ValueError), match=words):
        fit_paint(**(good | change))


def own_reference_of(p, t, ratio):
    return [said for said in fit_paint(p, t, ratio, p_ref=1e5, t_ref=300.0).warnings if "exactly 1" in said]


PRESSURES, LEVELS = np.linspace(4e4, 1.2e5, 5), np.array([285.0, 295.0, 300.0, 312.0])


@pytest.mark.parametrize("digits", [15, 4])
def test_isotherms_that_have_a_reference_each_are_found(digits):
    """Whatever the paint, and where the cell's temperature wanders a little on each isotherm."""
    p, t = (v.ravel() for v in np.meshgrid(PRESSURES, LEVELS))
    ratio = noisy_law(p, t)
    ratio = (ratio.reshape(4, 5) / ratio.reshape(4, 5)[:, [3]]).ravel().round(digits)
    (said,) = own_reference_of(p, t + np.random.default_rng(1).normal(0, 0.05, t.size), ratio)
    assert said.startswith("I_ref / I is exactly 1 at 100000 Pa at all temperatures (28")
    assert "what temperature does to the paint is not in the table" in said


def noisy_law(p, t):
    return law(p, t) * (1 + np.random.default_rng(2).normal(0, 0.001, p.size))


def test_one_reference_of_all_rows_is_none_of_each():
    p, t = (v.ravel() for v in np.meshgrid(PRESSURES, LEVELS))
    ratio = noisy_law(p, t)
    at = (p == 1e5) & (t == 300.0)
    ratio = ratio / ratio[at]
    assert own_reference_of(p, t, ratio) == []
    # Nor is one that is measured again and again, before every isotherm.
    again = np.full(4, 1e5), np.full(4, 300.0), np.ones(4)
    assert own_reference_of(*(np.concatenate(v) for v in zip((p, t, ratio), again, strict=True))) == []
    # Nor are temperatures so near each other that three digits do not tell them apart.
    close = 300.0 + 0.05 * (t - 300.0)
    assert own_reference_of(p, close, np.where(p == 1e5, 1.0, noisy_law(p, close).round(3))) == []
