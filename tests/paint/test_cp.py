"""The free stream by isentropic flow, and the pressure coefficient with the errors of both."""

import numpy as np
import pytest

from windmark.errors import UsageError
from windmark.paint import NodeField, TunnelConditions, pressure_coefficient


@pytest.mark.parametrize("mach", [0.3, 0.8, 1.0, 2.0])
def test_free_stream_from_the_settling_chamber(mach):
    """Adiabatic and reversible: T0 / T = 1 + (gamma - 1) / 2 M^2, p ~ T^(gamma / (gamma - 1)), q = rho u^2 / 2."""
    gamma, gas, t_0, p_0 = 1.4, 287.0, 300.0, 1e5
    t = t_0 / (1 + 0.5 * (gamma - 1) * mach**2)
    p = p_0 * (t / t_0) ** 3.5
    u = mach * np.sqrt(gamma * gas * t)
    q = 0.5 * p / (gas * t) * u**2
    got = TunnelConditions.from_mach(p_0, mach, t_0)
    assert (got.p_inf, got.q_inf) == pytest.approx((p, q), rel=1e-12)
    assert (got.mach, got.t_0) == (mach, t_0)
    assert TunnelConditions.from_mach(p_0, 1.0, gamma=1.67).p_inf == pytest.approx(0.4867 * p_0, rel=1e-3)


def test_its_covariance_is_that_of_small_changes_of_both_readings():
    p_sigma, m_sigma, h = 50.0, 0.002, 1e-5
    got = TunnelConditions.from_mach(1e5, 0.8, p_0_sigma=p_sigma, mach_sigma=m_sigma)

    def both(p_0, mach):
        of = TunnelConditions.from_mach(p_0, mach)
        return np.array([of.p_inf, of.q_inf])

    by_p = (both(1e5 + 1, 0.8) - both(1e5 - 1, 0.8)) / 2
    by_m = (both(1e5, 0.8 + h) - both(1e5, 0.8 - h)) / (2 * h)
    np.testing.assert_allclose(
        got.cov, np.outer(by_p, by_p) * p_sigma**2 + np.outer(by_m, by_m) * m_sigma**2, rtol=1e-6
    )
    apart = TunnelConditions.of(5e4, 2e4, 3.0, 4.0)
    np.testing.assert_array_equal(apart.cov, [[9.0, 0.0], [0.0, 16.0]])


@pytest.mark.parametrize("wrong", [(0.0, 1.0), (1.0, 0.0), (np.nan, 1.0), (1.0, np.nan), (np.inf, 1.0), (1.0, np.inf)])
def test_pressures_must_be_some(wrong):
    with pytest.raises(UsageError, match="p_inf and q_inf must be > 0"):
        TunnelConditions(*wrong)
    with pytest.raises(ValueError, match=r"cov must be \(2, 2\), got \(2,\)"):
        TunnelConditions(1.0, 1.0, np.ones(2))


@pytest.mark.parametrize("wrong", [(0.0, 0.8, 1.4), (1e5, 0.0, 1.4), (1e5, 0.8, 1.0), (np.nan, 0.8, 1.4)])
def test_readings_must_be_some(wrong):
    with pytest.raises(UsageError, match="p_0, mach > 0 and gamma > 1 are needed"):
        TunnelConditions.from_mach(wrong[0], wrong[1], gamma=wrong[2])


def test_the_coefficient_has_the_errors_of_pressure_and_conditions():
    rng = np.random.default_rng(3)
    cov = np.array([[400.0, 150.0], [150.0, 900.0]])
    conditions = TunnelConditions(5e4, 2e4, cov)
    p = np.array([4e4, 5e4, 7e4, np.nan])
    field = NodeField.make(p, 100.0, unit="Pa").with_mode("lamp", [30.0, -20.0, 10.0, 0.0])
    cp = pressure_coefficient(field, conditions)
    np.testing.assert_allclose(cp.value, [-0.5, 0.0, 1.0, np.nan])
    # 200,000 draws tell a covariance within 0.7 % (three sigmas).
    draws = rng.multivariate_normal([5e4, 2e4], cov, 200_000)
    drawn = ((p[:3] + rng.normal(size=(len(draws), 1)) * [30.0, -20.0, 10.0]) - draws[:, :1]) / draws[:, 1:]
    expected = np.cov(drawn.T) + np.diag(np.full(3, (100.0 / 2e4) ** 2))
    got = (cp.modes @ cp.modes.T)[:3, :3] + np.diag(cp.white[:3])
    np.testing.assert_allclose(got, expected, rtol=0.02, atol=0.005 * np.abs(expected).max())
    exact = pressure_coefficient(field, TunnelConditions(5e4, 2e4))
    np.testing.assert_allclose(exact.sigma[:3], np.hypot(100.0, [30, -20, 10]) / 2e4)
    assert pressure_coefficient(field, TunnelConditions.of(5e4, 2e4)).modes.shape == exact.modes.shape
    with pytest.raises(UsageError, match="the pressure is in Pa, the conditions in psi"):
        pressure_coefficient(field, TunnelConditions(7.0, 3.0, pressure_unit="psi"))
