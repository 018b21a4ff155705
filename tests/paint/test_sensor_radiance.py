"""A camera's calibration by black bodies: the law, its covariance by draws, and what a table does not say."""

import numpy as np
import pytest

from windmark.errors import UsageError
from windmark.paint import EmissivityTable, NodeField, NotFitted, PlanckBand, fit_sensor_radiance, surface_temperature

BAND, KELVIN = PlanckBand(8.0, 12.0), np.linspace(275.0, 345.0, 15)


def counts(t):
    return 3000 + 5000 * BAND.radiance(t) / BAND.radiance(300.0)


def test_the_law_follows_a_band_to_millikelvins():
    law = fit_sensor_radiance(KELVIN, counts(KELVIN))
    t = np.linspace(278, 342, 50)
    assert np.abs(law.temperature(counts(t)) - t).max() < 0.01
    np.testing.assert_allclose(law.slope(t), (law.radiance(t + 0.01) - law.radiance(t - 0.01)) / 0.02, rtol=1e-6)
    assert np.isnan(law.temperature(counts(np.array([260.0, 360.0])))).all()  # beyond the table


def test_temperatures_have_the_calibrations_errors():
    rng, noise = np.random.default_rng(2), 2.0
    e, true, around = np.array([0.9, 0.8, 0.95]), np.array([290.0, 310.0, 335.0]), 285.0
    law = fit_sensor_radiance(KELVIN, counts(KELVIN), signal_sigma=noise)
    signal = NodeField.make(e * law.radiance(true) + (1 - e) * law.radiance(around), 1e-9)
    found, flags = surface_temperature(signal, law, emissivity=e, surroundings=around)
    assert not flags.any()
    np.testing.assert_allclose(found.value, true, atol=1e-6)
    draws = []
    for _ in range(300):
        other = fit_sensor_radiance(KELVIN, counts(KELVIN) + noise * rng.standard_normal(15), signal_sigma=noise)
        draws.append(surface_temperature(signal, other, emissivity=e, surroundings=around)[0].value)
    np.testing.assert_allclose(np.std(draws, axis=0), found.sigma, rtol=0.13)


def test_the_windows_transmission_has_its_error():
    law, tau = BAND, 0.9
    signal = tau * law.radiance(330.0) + 0.1 * law.radiance(295.0)
    kwargs = {"emissivity": 1.0, "surroundings": 295.0, "window_temperature": 295.0}
    found, _ = surface_temperature(NodeField.make([signal]), law, transmission=tau, transmission_sigma=0.01, **kwargs)
    low, high = (surface_temperature(NodeField.make([signal]), law, transmission=tau + d, **kwargs)[0].value[0]
                 for d in (-0.01, 0.01))  # fmt: skip
    assert found.names == ("window",)
    assert found.modes[0, 0] == pytest.approx((high - low) / 2, rel=0.02)


def test_tables_that_say_too_little_are_refused():
    assert not fit_sensor_radiance([290.0, 300.0, 310.0], [1.0, 2.0, 3.0])
    assert "over 3 K" in fit_sensor_radiance([300.0, 301.0, 302.0, 303.0], [1.0, 2.0, 3.0, 4.0]).reason
    falling = fit_sensor_radiance(KELVIN, -counts(KELVIN))
    assert isinstance(falling, NotFitted)
    assert "does not rise" in falling.reason


def test_an_emissivity_table_is_not_extrapolated():
    table = EmissivityTable([0.0, 40.0, 60.0], [0.92, 0.9, 0.82])
    np.testing.assert_allclose(table.at([0.0, 50.0, 60.0]), [0.92, 0.86, 0.82])
    assert np.isnan(table.at([60.5, 80.0])).all()
    field, flags = surface_temperature(NodeField.make([30.0, 30.0]), BAND, emissivity=table.at([30.0, 70.0]),
                                       surroundings=290.0)  # fmt: skip
    assert np.isfinite(field.value).tolist() == [True, False]
    assert flags[1]
    with pytest.raises(UsageError, match="angles must rise"):
        EmissivityTable([0.0, 0.0], [0.9, 0.9])
    with pytest.raises(UsageError, match="above 0 and at most 1"):
        EmissivityTable([0.0, 60.0], [92.0, 80.0])
