"""Temperatures between thermocouples against ordinary kriging, written down as least squares of a Gaussian field."""

import numpy as np
import pytest

from windmark.errors import DataError, UsageError
from windmark.paint import thermocouple_temperature

LENGTH, SPREAD, SIGMA = 0.8, 2.0, 0.3


def places(seed, nodes=30, points=6):
    rng = np.random.default_rng(seed)
    return rng.uniform(0, 3, (nodes, 3)), rng.uniform(0, 3, (points, 3)), 300 + rng.normal(0, SPREAD, points)


def field(a, b):
    return SPREAD**2 * np.exp(-(np.linalg.norm(a[:, None] - b[None], axis=2) ** 2) / (2 * LENGTH**2))


def kriged(node, at, t):
    """Mean and covariance of the field at nodes given readings, the mean of all unknown: a very large common part."""
    vague = 1e5**2
    k = field(at, at) + vague + SIGMA**2 * np.eye(len(at))
    cross = field(node, at) + vague
    gain = np.linalg.solve(k, cross.T).T
    middle = t.mean()
    return middle + gain @ (t - middle), field(node, node) + vague - gain @ cross.T


@pytest.mark.parametrize("seed", range(3))
def test_values_and_the_whole_covariance_are_those_of_kriging(seed):
    node, at, t = places(seed)
    got = thermocouple_temperature(node, at, t, sigma=SIGMA, length=LENGTH, spread=SPREAD)
    value, cov = kriged(node, at, t)
    np.testing.assert_allclose(got.value, value, atol=1e-4)
    np.testing.assert_allclose(got.sigma**2, np.diag(cov), rtol=2e-3, atol=2e-3)
    # Errors of neighbours belong together. A few modes hold those of a line of nodes, all but rounding.
    node[:, 1:] = 1.0
    got, cov = thermocouple_temperature(node, at, t, sigma=SIGMA, length=LENGTH, spread=SPREAD), kriged(node, at, t)[1]
    np.testing.assert_allclose(got.modes @ got.modes.T + np.diag(got.white), cov, atol=0.01 * SPREAD**2)
    assert np.abs(cov - np.diag(np.diag(cov))).max() > 1.0


def test_near_one_it_is_its_reading_and_far_from_all_their_mean():
    at = np.array([[0.0, 0, 0], [0.1, 0, 0], [9.0, 0, 0]])
    t = np.array([310.0, 310.0, 300.0])
    node = np.array([[9.0, 0, 0], [500.0, 0, 0]])
    got = thermocouple_temperature(node, at, t, sigma=0.01, length=1.0, spread=5.0)
    assert got.value[0] == pytest.approx(300.0, abs=0.05)
    assert got.value[1] == pytest.approx(305.0, abs=0.1)  # two side by side count as one
    assert got.sigma[0] == pytest.approx(0.01, rel=0.05)
    assert got.sigma[1] == pytest.approx(np.hypot(5.0, 5.0 / np.sqrt(2)), rel=0.02)


def test_the_spread_is_what_the_readings_have_beyond_their_noise():
    rng = np.random.default_rng(5)
    at, far = 100.0 * rng.normal(size=(200, 3)), np.array([[1e6, 0, 0]])
    got = thermocouple_temperature(far, at, 300 + rng.normal(0, np.hypot(3.0, 1.0), 200), sigma=1.0, length=1.0)
    assert got.sigma[0] == pytest.approx(3.0, rel=0.2)  # 200 readings: 5 % each way
    # No less than the noise: readings that agree by chance are no proof of an even temperature.
    even = thermocouple_temperature(far, at[:4], np.full(4, 300.0), sigma=1.0, length=1.0)
    assert even.sigma[0] == pytest.approx(np.sqrt(1 + 2 / 4), rel=1e-6)


def test_what_all_share_stays_and_what_is_missing_does_not_count():
    node, at, t = places(9)
    plain = thermocouple_temperature(node, at, t, sigma=SIGMA, length=LENGTH, spread=SPREAD)
    common = thermocouple_temperature(node, at, t, sigma=SIGMA, length=LENGTH, spread=SPREAD, common_sigma=0.7)
    np.testing.assert_allclose(common.sigma**2 - plain.sigma**2, 0.49)
    assert "thermocouples common" in common.names
    less, gone = t.copy(), at.copy()
    less[2], gone[4, 1] = np.nan, np.nan
    kept = [0, 1, 3, 5]
    some = thermocouple_temperature(node, gone, less, sigma=SIGMA, length=LENGTH, spread=SPREAD)
    only = thermocouple_temperature(node, at[kept], t[kept], sigma=SIGMA, length=LENGTH, spread=SPREAD)
    np.testing.assert_allclose(some.value, only.value)
    np.testing.assert_allclose(some.sigma, only.sigma)
    lost = node.copy()
    lost[3] = np.nan
    holed = thermocouple_temperature(lost, at, t, sigma=SIGMA, length=LENGTH, spread=SPREAD)
    assert np.isnan(holed.value[3])
    np.testing.assert_allclose(np.delete(holed.value, 3), np.delete(plain.value, 3))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"length": 0.0}, "above zero"), ({"sigma": 0.0}, "above zero"), ({"spread": 0.0}, "above zero"),
        ({"sigma": [1.0, -1.0, 1.0]}, "above zero"), ({"sigma": np.inf}, "finite"), ({"length": np.inf}, "finite"),
        ({"xyz": np.zeros((2, 2))}, r"got \(2, 2\), \(3, 3\), \(3,\)"),
        ({"points": np.zeros((2, 3))}, r"got \(1, 3\), \(2, 3\), \(3,\)"), ({"xyz": np.zeros(3)}, r"got \(3,\)"),
    ],
)  # fmt: skip
def test_wrong_use(change, words):
    good = {"xyz": np.zeros((1, 3)), "points": np.eye(3), "values": np.arange(3.0), "sigma": 1.0, "length": 1.0}
    with pytest.raises((UsageError, ValueError), match=words):
        thermocouple_temperature(**(good | change))


@pytest.mark.parametrize(("count", "spread", "least"), [(2, None, 3), (0, 1.0, 1), (1, None, 3)])
def test_too_few_thermocouples(count, spread, least):
    values = np.where(np.arange(3) < count, 300.0, np.nan)
    with pytest.raises(DataError, match=f"{count} thermocouples have a value; expected at least {least}"):
        thermocouple_temperature(np.zeros((1, 3)), np.eye(3), values, sigma=1.0, length=1.0, spread=spread)
    assert len(
        thermocouple_temperature(np.zeros((1, 3)), np.eye(3), [1.0, np.nan, np.nan], sigma=1.0, length=1.0, spread=2.0)
    )
