"""Temperatures: recovery, thermocouples by draws of whole fields, temperature paint."""

import numpy as np
import pytest

from windmark.errors import DataError, UsageError
from windmark.paint import (
    NodeField,
    TemperaturePaint,
    TunnelConditions,
    fit_temperature_paint,
    given_temperature,
    recovery_temperature,
    thermocouple_temperature,
    varying,
)


def test_recovery_temperature_and_its_errors():
    c = TunnelConditions.from_mach(1e5, 0.8, 300.0)
    t = recovery_temperature(c, 4, recovery=0.896, recovery_sigma=0.01, t_0_sigma=0.4)
    t_inf = 300 / 1.128
    np.testing.assert_allclose(t.value, t_inf + 0.896 * (300 - t_inf))
    np.testing.assert_allclose(t.sigma, np.hypot(0.01 * (300 - t_inf), 0.4 * t.value / 300), rtol=1e-9)
    assert t.modes.shape == (4, 2)
    with pytest.raises(DataError, match="no Mach number"):
        recovery_temperature(TunnelConditions.of(1e5, 2e4), 4)


def test_given():
    t = given_temperature(300.0, 0.1, common_sigma=0.2, count=3)
    assert t.sigma == pytest.approx(np.sqrt(0.05) * np.ones(3))
    assert t.names == ("temperature",)
    with pytest.raises(UsageError, match="needs count"):
        given_temperature(300.0)


def draw(rng, xyz, length, spread):
    k = spread**2 * np.exp(-0.5 * ((xyz[:, None] - xyz[None]) ** 2).sum(axis=2) / length**2)
    return 300 + np.linalg.cholesky(k + 1e-8 * np.eye(len(k))) @ rng.normal(size=len(k))


@pytest.mark.slow
def test_thermocouples_cover_near_and_far_node_by_node_and_in_the_mean():
    rng = np.random.default_rng(0)
    z, means = [], []
    for _ in range(60):
        node = rng.uniform(0, 4, (300, 3)) * [1, 0.5, 0]
        at = rng.uniform(0, 2, (8, 3)) * [1, 1, 0]  # none in the farther half
        true = draw(rng, np.concatenate([node, at]), 0.8, 2.0)
        t = thermocouple_temperature(node, at, true[300:] + 0.1 * rng.normal(size=8), sigma=0.1, length=0.8, spread=2.0)
        z.append((t.value - true[:300]) / t.sigma)
        mean_sigma = np.sqrt(t.white.sum() + (t.modes.sum(axis=0) ** 2).sum()) / 300
        means.append((t.value.mean() - true[:300].mean()) / mean_sigma)
    assert 0.93 < np.mean(np.abs(z) < 1.96) < 0.97
    assert 0.8 < np.std(means) < 1.2
    assert t.sigma[node[:, 0] > 3.5].min() > 4 * t.sigma[node[:, 0] < 1].min()


def test_thermocouples_without_spread_or_value():
    node = np.zeros((3, 3))
    at = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0.0]])
    t = thermocouple_temperature(node, at, [300.0, 303.0, np.nan], sigma=0.1, length=1.0, spread=2.0, common_sigma=0.3)
    assert t.sigma.min() > 0.3
    with pytest.raises(DataError, match="2 thermocouples have a value; expected at least 3"):
        thermocouple_temperature(node, at, [300.0, 303.0, np.nan], sigma=0.1, length=1.0)
    with pytest.raises(UsageError, match="above zero"):
        thermocouple_temperature(node, at, [300.0, 303.0, 304.0], sigma=0.0, length=1.0)


def tsp():
    return TemperaturePaint(np.array([0.0, 0.02, 5e-5]), 293.0, (280.0, 330.0))


@pytest.mark.slow
def test_temperature_paint_fit_and_map_cover():
    law, z, orders = tsp(), [], []
    rng = np.random.default_rng(1)
    for _ in range(80):
        t = np.repeat(np.linspace(280, 330, 9), 3)
        fit = fit_temperature_paint(t, np.exp(law.log_ratio(t)) * (1 + 0.004 * rng.normal(size=27)), t_ref=293.0)
        assert fit
        orders.append(len(fit.coefficients) - 1)
        true = rng.uniform(282, 328, 100)
        r = np.exp(law.log_ratio(true) - law.log_ratio(295.0))
        sigma = 0.003 * r
        got, flags = fit.temperature_map(NodeField.make(r + sigma * rng.normal(size=100), sigma), t_off=295.0,
                                         t_off_sigma=0.0)  # fmt: skip
        assert flags.max() <= 2
        z.append((got.value - true) / got.sigma)
    assert np.mean(np.array(orders) == 2) > 0.75
    assert 0.93 < np.mean(np.abs(z) < 1.96) < 0.97


def test_temperature_paint_inverts_exactly_and_flags():
    law = tsp()
    t = np.array([281.0, 300.0, 329.0, 350.0])
    got, flags = law.temperature_map(NodeField.make(np.append(np.exp(law.log_ratio(t)), -1.0)), t_off=293.0)
    np.testing.assert_allclose(got.value[:3], t[:3], rtol=1e-10)
    assert flags.tolist() == [0, 0, 0, 2, 4]
    assert np.isnan(got.value[4])
    off, _ = law.temperature_map(NodeField.make(np.exp(law.log_ratio(t))), t_off=293.0, t_off_sigma=0.5)
    high, _ = law.temperature_map(NodeField.make(np.exp(law.log_ratio(t))), t_off=293.5)
    np.testing.assert_allclose(off.modes[:3, 0], (high.value - got.value[:4])[:3], rtol=0.02)


def test_temperature_paint_refusals():
    assert "needs 2 different temperatures" in fit_temperature_paint([300.0] * 5, [1.0] * 5, t_ref=300.0).reason
    t = np.linspace(280, 320, 9)
    assert "does not rise" in fit_temperature_paint(t, np.linspace(2, 1, 9), t_ref=300.0, order=1).reason
    with pytest.raises(UsageError, match="does not rise"):
        TemperaturePaint(np.array([0.0, -0.01]), 300.0, (280.0, 320.0))


def test_a_wall_that_varies_has_an_error_that_neighbours_share_and_distant_places_do_not():
    places = np.column_stack([np.linspace(0, 10, 101), np.zeros((101, 2))])
    wall = varying(given_temperature(300.0, 0.1, count=101), places, spread=1.0, length=1.0)
    np.testing.assert_allclose(wall.sigma, np.sqrt(1.01), rtol=1e-6)
    shared = wall.modes @ wall.modes.T
    assert shared[50, 51] > 0.9
    assert abs(shared[20, 80]) < 0.1
    np.testing.assert_allclose(shared[50, 60], np.exp(-0.5), atol=0.1)
    unseen = np.where(np.arange(101)[:, None] < 50, places, np.nan)
    half = varying(given_temperature(300.0, 0.1, count=101), unseen, spread=1.0, length=1.0)
    assert not half.modes[50:].any()
    np.testing.assert_allclose(half.sigma, np.sqrt(1.01), rtol=1e-6)
