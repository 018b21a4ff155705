"""Laws of radiance that are none, and Planck's against the constants of black bodies."""

import numpy as np
import pytest
from scipy import constants, integrate

from windmark.errors import UsageError
from windmark.paint import PlanckBand, PolynomialRadiance, TunnelGain, fit_sensor_radiance, fit_temperature_paint
from windmark.paint.modes import NodeField, principal_axes
from windmark.paint.patches import _inside
from windmark.paint.temperature_paint import TemperaturePaint


@pytest.mark.parametrize("band", [(0.9, 1.7), (3.0, 5.0), (7.5, 14.0), (8.0, 9.0)])
@pytest.mark.parametrize("temperature", [280.0, 350.0, 800.0])
def test_bands_have_the_part_of_plancks_law_that_is_in_them(band, temperature):
    def planck(um):
        x = constants.h * constants.c / (um * 1e-6 * constants.k * temperature)
        return 2 * constants.h * constants.c**2 / (um * 1e-6) ** 5 / np.expm1(x) * 1e-6

    whole = integrate.quad(planck, *band, epsrel=1e-10)[0]
    assert PlanckBand(*band).radiance(temperature) == pytest.approx(whole, rel=1e-5)


def test_temperatures_are_those_of_the_radiance_within_the_range_only():
    t = np.array([270.0, 300.0, 340.0])
    narrow = PlanckBand(8.0, 12.0)
    np.testing.assert_allclose(
        (narrow.radiance(t + 0.01) - narrow.radiance(t - 0.01)) / 0.02, narrow.slope(t), rtol=1e-6
    )
    np.testing.assert_allclose(narrow.temperature(narrow.radiance(t)), t, atol=2e-3)
    ends = narrow.radiance(np.array(narrow.t_range))
    assert np.isfinite(narrow.temperature(ends * [1.001, 0.999])).all()
    assert np.isnan(narrow.temperature([*ends * [0.999, 1.001], 0.0, -1.0, np.nan])).all()


@pytest.mark.parametrize(
    ("coefficients", "t_range"),
    [([1.0], (1.0, 2.0)), ([[1.0, 2.0]], (1.0, 2.0)), ([0.0, 1.0], (2.0, 2.0)), ([0.0, 1.0], (2.0, 1.0)),
     ([0.0, -1.0], (1.0, 2.0)), ([0.0, 1.0, -0.5], (0.0, 1.0)), ([0.0, 0.0], (1.0, 2.0))],
)  # fmt: skip
def test_polynomials_that_are_no_law(coefficients, t_range):
    for kind in (lambda c, r: PolynomialRadiance(c, r), lambda c, r: TemperaturePaint(np.array(c), 0.0, r)):
        with pytest.raises(UsageError, match="rise"):
            kind(coefficients, t_range)
        kind([0.0, 1.0], (1.0, 2.0))
        kind([0.0, 1.0, -0.49], (0.0, 1.0))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"temperature": [[1.0, 2.0]]}, r"must be \(M,\)"),
        ({"ratio": [1.0]}, r"must be \(M,\), got \(6,\) and \(1,\)"),
        ({"temperature": [np.nan, 1, 2, 3, 4, 5]}, "must be finite"), ({"ratio": [0.0, 1, 1, 1, 1, 1]}, "above zero"),
        ({"ratio": [np.inf, 1, 1, 1, 1, 1]}, "above zero"), ({"t_ref": np.inf}, "must be finite"),
        ({"order": 0}, "order must be 1 to 4, got 0"), ({"order": 5}, "order must be 1 to 4, got 5"),
    ],
)  # fmt: skip
def test_temperature_paints_that_cannot_be_fitted(change, words):
    t = np.array([280.0, 285, 290, 295, 300, 305])
    good = {"temperature": t, "ratio": np.exp(0.01 * (t - 290)), "t_ref": 290.0}
    for order in (1, 4):
        law = fit_temperature_paint(**good, order=order)
        np.testing.assert_allclose(law.log_ratio(t), 0.01 * (t - 290), atol=1e-9)
    with pytest.raises((UsageError, ValueError), match=words):
        fit_temperature_paint(**(good | change))


@pytest.mark.parametrize(("rows", "order", "fits"), [(3, 1, True), (2, 1, False), (5, 3, True), (4, 3, False)])
def test_an_order_needs_one_temperature_and_two_rows_more(rows, order, fits):
    t = 290.0 + 5.0 * np.arange(rows)
    law = fit_temperature_paint(t, np.exp(0.01 * (t - 290)), t_ref=290.0, order=order)
    assert bool(law) == fits
    if not fits:
        assert (
            f"order {order} needs {order + 1} different temperatures and {order + 2} rows, there are {rows} and {rows}"
            in (law.reason)
        )
    # Readings within a hundredth of the span are of one temperature.
    near = np.r_[290.0, 290.09, 290.0, 300.0, 300.05]
    assert not fit_temperature_paint(near, np.exp(0.01 * (near - 290)), t_ref=290.0, order=2)
    apart = np.r_[290.0, 290.12, 290.0, 300.0, 300.05]
    assert fit_temperature_paint(apart, np.exp(0.01 * (apart - 290)), t_ref=290.0, order=2)


def test_black_bodies_that_say_no_law():
    t = np.array([280.0, 300.0, 320.0, 340.0, 360.0])
    rising = 1e4 / np.expm1(1450.0 / t)
    assert fit_sensor_radiance(t, rising + 50)
    for wrong, words in ((-rising, "does not rise"), (np.full(5, 3.0), "does not rise")):
        assert words in fit_sensor_radiance(t, wrong).reason
    assert "does not rise" in fit_sensor_radiance(t - 280.0, rising).reason  # 0 K is no temperature
    assert "say no law of three numbers" in fit_sensor_radiance(300.0 + 1e-3 * np.arange(5), rising).reason
    with pytest.raises(UsageError, match=r"must be \(N,\) numbers"):
        fit_sensor_radiance(np.where(t > 350, np.nan, t), rising)


@pytest.mark.parametrize(
    ("cov", "words"),
    [(np.ones(3), "finite"), (np.ones((2, 3)), "finite"), (np.array([[1.0, np.nan], [np.nan, 1.0]]), "finite"),
     (np.array([[1.0, 2.0], [2.0, 1.0]]), "negative eigenvalue"), (-np.eye(2), "negative eigenvalue")],
)  # fmt: skip
def test_matrices_that_are_no_covariance(cov, words):
    if np.shape(cov) == (2, 2) and np.all(np.diagonal(cov) < 0):
        cov = np.array([[1.0, -1.5], [-1.5, 1.0]])
    with pytest.raises(ValueError, match=words):
        principal_axes(cov)


@pytest.mark.parametrize("scale", [1.0, 1e-8])
def test_axes_are_a_root_of_the_covariance_whatever_the_units(scale):
    rng = np.random.default_rng(2)
    root = rng.normal(size=(4, 4)) * [scale, 1.0, 1e6, 0.0]
    cov = root.T @ root
    axes = principal_axes(cov)
    size = np.sqrt(np.maximum(np.diagonal(cov), 1e-300))
    np.testing.assert_allclose(axes @ axes.T / np.outer(size, size), cov / np.outer(size, size), atol=1e-9)
    assert (axes[3] == 0).all()
    unit = axes[:3] / size[:3, None]
    assert (np.diff((unit**2).sum(axis=0)) <= 1e-12).all()  # the largest first
    np.testing.assert_array_equal(axes, principal_axes(cov.copy()))


def test_points_in_polygons_by_their_winding():
    rng = np.random.default_rng(7)
    star = np.stack([(1 + (np.arange(10) % 2)) * np.cos(np.arange(10) * np.pi / 5),
                     (1 + (np.arange(10) % 2)) * np.sin(np.arange(10) * np.pi / 5)], axis=1)  # fmt: skip
    square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    for polygon in (star, star[::-1], square, [[-2.0, -1.0], [2.0, -1.5], [0.3, 2.0]]):
        p = np.array(polygon)
        xy = rng.uniform(-2.2, 2.2, (500, 2))
        to = p[None] - xy[:, None]
        turn = np.arctan2(to[..., 1], to[..., 0])
        step = (np.roll(turn, -1, axis=1) - turn + np.pi) % (2 * np.pi) - np.pi
        np.testing.assert_array_equal(_inside(xy, p), np.abs(step.sum(axis=1)) > np.pi)


def test_tunnel_gain_on_both_sides_of_its_range_and_by_small_changes():
    c = np.array([40e3, 100.0, 0.5, 0.6, 1e-3, 1e-5])
    gain, h = TunnelGain(c, (2e4, 1.2e5), (0.0, 60.0), np.diag([1e4, 1, 1e-4, 1e-4, 0, 0]), temperature_unit="K"), 1e-4

    def field(*values):
        return NodeField.make(np.array(values, float))

    p, t = [1.99e4, 2.01e4, 1.19e5, 1.21e5, 5e4, 5e4, 5e4, 5e4], [30.0, 30, 30, 30, -0.1, 0.1, 59.9, 60.1]
    got = gain.pressure_map(field(*[1.01] * 8), field(*t), field(*p))
    assert got.flags.tolist() == [1, 0, 0, 1, 2, 0, 0, 2]
    odd = gain.pressure_map(field(0.0, -1.0, 1.0, 1.0), field(30, 30, np.nan, 30), field(5e4, 5e4, 5e4, np.nan))
    assert (odd.flags > 0).all()
    assert np.isnan(odd.field.value[[0, 1]]).all()

    def value(r=1.03, t=20.0, p=8e4):
        return gain.pressure_map(field(r), field(t), field(p)).field.value[0]

    slopes = [(value(**{n: v + h}) - value(**{n: v - h})) / (2 * h) for n, v in (("r", 1.03), ("t", 20.0), ("p", 8e4))]
    terms = np.array([1, 20, 400, 8e4, 1.6e6, 3.2e7]) * 0.03
    for k, (r, dt, dp) in enumerate(np.eye(3) * [1e-3, 0.5, 50.0]):
        found = gain.pressure_map(
            NodeField.make([1.03], r), NodeField.make([20.0], dt), NodeField.make([8e4], dp)
        ).field
        own = (slopes[k] * [1e-3, 0.5, 50.0][k]) ** 2 + terms**2 @ np.diagonal(gain.cov)
        assert found.sigma[0] == pytest.approx(np.sqrt(own), rel=1e-5)
    for wrong in (c[:5], np.where(c > 1e4, np.nan, c)):
        with pytest.raises(ValueError, match=r"must be \(6,\) finite"):
            TunnelGain(wrong, (2e4, 1.2e5), (0.0, 60.0))
    with pytest.raises(UsageError, match="above zero everywhere"):
        TunnelGain([0.0, 1.0, 0, 0, 0, 0], (2e4, 1.2e5), (0.0, 60.0))
