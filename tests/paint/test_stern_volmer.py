"""The paint's law and its inverse, pressure with all its errors, the tunnel gain form, the cell fit."""

import sys
from pathlib import Path

import numpy as np
import pytest

from windmark.errors import UsageError
from windmark.paint import NodeField, SternVolmer, TunnelGain, fit_paint, pressure_map

sys.path.insert(0, str(Path(__file__).parent))
from paint_shapes import paint


def test_inverse_of_the_law_everywhere_in_its_range_and_by_another_reference():
    rng = np.random.default_rng(0)
    p, t = rng.uniform(10e3, 160e3, 5000), rng.uniform(270, 325, 5000)
    law = paint()
    inv = law.invert(law.ratio(p, t) / law.ratio(9e4, 290.0), t, p_off=9e4, t_off=290.0)
    assert not inv.flags.any()
    np.testing.assert_allclose(inv.pressure, p, rtol=1e-9)
    assert law.ratio(law.p_ref, law.t_ref) == pytest.approx(1.0)


@pytest.mark.parametrize("p", [3e3, 60e3, 190e3])
def test_slopes_of_the_inverse_are_those_of_differences(p):
    """Also beyond the range, where the law goes on straight."""
    law, t, p0, t0 = paint(), 300.0, 9e4, 290.0
    r = float(law.ratio(p, t) / law.ratio(p0, t0))

    def at(r=r, t=t, p0=p0, t0=t0, a=law.coefficients):
        other = SternVolmer(a, law.p_ref, law.t_ref, law.p_range, law.t_range)
        return float(other.invert([r], t, p_off=p0, t_off=t0).pressure[0])

    inv = law.invert([r], t, p_off=p0, t_off=t0)
    for name, got, h in (("r", inv.by_ratio, 1e-5), ("t", inv.by_temperature, 1e-3), ("p0", inv.by_p_off, 1.0),
                         ("t0", inv.by_t_off, 1e-3)):  # fmt: skip
        base = {"r": r, "t": t, "p0": p0, "t0": t0}[name]
        slope = (at(**{name: base + h}) - at(**{name: base - h})) / (2 * h)
        assert got[0] == pytest.approx(slope, rel=2e-4), name
    for k in range(6):
        a, b = law.coefficients.copy(), law.coefficients.copy()
        a.flat[k] += 1e-7
        b.flat[k] -= 1e-7
        assert inv.by_coefficients[0, k] == pytest.approx((at(a=a) - at(a=b)) / 2e-7, rel=2e-4, abs=1e-3)


def test_what_is_outside_or_missing_is_flagged_and_never_guessed():
    law = paint()
    r = np.array([0.05, 0.9, 3.0, -1.0, np.nan, 0.9, 0.9])
    t = np.array([293.0, 293.0, 293.0, 293.0, 293.0, np.nan, 400.0])
    inv = law.invert(r, t)
    assert inv.flags.tolist() == [1, 0, 1, 4, 4, 8, 2]
    assert np.isnan(inv.pressure[[3, 4, 5]]).all()
    got = pressure_map(law, NodeField.make(r, 0.01), NodeField.make(t, 0.1, unit="K"))
    assert np.isnan(got.field.value[[3, 4, 5]]).all()
    np.testing.assert_array_equal(got.flags, inv.flags)
    assert (law.invert([0.9], 293.0, p_off=np.nan).flags == 16).all()
    assert np.isnan(got.field.sigma[[3, 4, 5]]).all()
    assert not len(law.invert([], 293.0).pressure)


@pytest.mark.parametrize(
    ("a", "words"),
    [([[1.0], [-0.2]], "does not rise with pressure"), ([[0.1], [2.0], [-1.0]], "does not rise"),
     ([[-0.5], [1.0]], "is not above zero")],
)  # fmt: skip
def test_a_law_without_inverse_is_refused_with_the_place(a, words):
    with pytest.raises(UsageError, match=words + ".* at p = "):
        SternVolmer(np.array(a), 1e5, 290.0, (1e4, 1.5e5), (280.0, 300.0))


@pytest.mark.slow
def test_pressure_has_the_errors_that_draws_show():
    law = paint(np.diag([1e-6, 1e-9, 1e-6, 1e-9, 1e-6, 1e-9]))
    rng = np.random.default_rng(8)
    p, t = np.array([40e3, 80e3, 120e3]), np.array([290.0, 295.0, 300.0])
    r = law.ratio(p, t) / law.ratio(9e4, 291.0)
    ratio = NodeField.make(r, 0.003)
    temperature = NodeField.make(t, 0.05, unit="K").with_mode("temperature", 0.2)
    got = pressure_map(law, ratio, temperature, p_off=9e4, p_off_sigma=30.0, t_off=291.0, t_off_sigma=0.2).field
    root = np.sqrt(np.diag(law.cov))
    seen = []
    for _ in range(2000):
        a = law.coefficients + (root * rng.normal(size=6)).reshape(3, 2)
        other = SternVolmer(a, law.p_ref, law.t_ref, law.p_range, law.t_range)
        seen.append(other.invert(r + 0.003 * rng.normal(size=3), t + 0.05 * rng.normal(size=3) + 0.2 * rng.normal(),
                                 p_off=9e4 + 30 * rng.normal(), t_off=291 + 0.2 * rng.normal()).pressure)  # fmt: skip
    cov = got.modes @ got.modes.T + np.diag(got.white)
    np.testing.assert_allclose(np.cov(np.array(seen).T), cov, atol=0.12 * cov.max())
    assert {n.split(":")[0] for n in got.names} == {
        "temperature", "wind-off temperature", "wind-off pressure", "calibration"}  # fmt: skip


def test_pressure_is_relative_to_the_wind_off_state_that_is_given():
    """Else to that of the calibration."""
    law, p, t = paint(), np.array([40e3, 80e3, 120e3]), np.array([290.0, 295.0, 300.0])
    temperature = NodeField.make(t, unit="K")
    for off in ({"p_off": 8e4, "t_off": 292.0}, {}):
        r = law.ratio(p, t) / law.ratio(off.get("p_off", law.p_ref), off.get("t_off", law.t_ref))
        got = pressure_map(law, NodeField.make(r), temperature, **off).field
        np.testing.assert_allclose(got.value, p, rtol=1e-9)


def test_units_that_differ_are_refused():
    with pytest.raises(UsageError, match="degC, the calibration in K"):
        pressure_map(paint(), NodeField.make([1.0]), NodeField.make([20.0], unit="degC"))


def test_tunnel_gain_form():
    gain = TunnelGain([40e3, 100.0, 0.5, 0.6, 1e-3, 1e-5], (2e4, 1.2e5), (0.0, 60.0), np.diag([1e4, 1, 0, 0, 0, 0]),
                      temperature_unit="degC")  # fmt: skip
    ratio, t, p = NodeField.make([1.02, 0.97], 0.001), NodeField.make([20.0, 70.0], 0.5), NodeField.make([8e4, 5e4], 50)
    got = gain.pressure_map(ratio, t, p)
    by_hand = 40e3 + 100 * 20 + 0.5 * 400 + (0.6 + 0.02 + 0.004) * 8e4
    assert got.field.value[0] == pytest.approx(8e4 + by_hand * 0.02)
    assert got.flags.tolist() == [0, 2]
    rng = np.random.default_rng(0)
    seen = []
    for _ in range(4000):
        c = gain.coefficients + np.array([100 * rng.normal(), rng.normal(), 0, 0, 0, 0])
        tt, pp = 20 + 0.5 * rng.normal(), 8e4 + 50 * rng.normal()
        g = c[0] + c[1] * tt + c[2] * tt**2 + (c[3] + c[4] * tt + c[5] * tt**2) * pp
        seen.append(pp + g * (0.02 + 0.001 * rng.normal()))
    assert np.std(seen) == pytest.approx(got.field.sigma[0], rel=0.05)
    with pytest.raises(UsageError, match="above zero"):
        TunnelGain([-1, 0, 0, 0, 0, 0], (1.0, 2.0), (0.0, 1.0))


def cell(rng, sigma=0.003, p_levels=8, t_levels=5):
    p, t = (g.ravel() for g in np.meshgrid(np.linspace(2e4, 1.5e5, p_levels), np.linspace(280, 315, t_levels)))
    return p, t, paint().ratio(p, t) + rng.normal(0, sigma, p.size)


@pytest.mark.parametrize("stated", [True, False])
def test_cell_fit_finds_the_order_and_its_sigma_covers(stated):
    law, z, orders = paint(), [], []
    for seed in range(30):
        rng = np.random.default_rng(1000 + seed)
        fit = fit_paint(*cell(rng), p_ref=101325.0, t_ref=293.15, ratio_sigma=0.003 if stated else None)
        assert fit
        orders.append(fit.order)
        p, t = rng.uniform(2.2e4, 1.45e5, 50), rng.uniform(281, 314, 50)
        inv = fit.law.invert(law.ratio(p, t) / law.ratio(9e4, 290.0), t, p_off=9e4, t_off=290.0)
        sigma = np.sqrt(np.einsum("nk,kl,nl->n", inv.by_coefficients, fit.law.cov, inv.by_coefficients))
        z.append((inv.pressure - p) / sigma)
    assert np.mean([o == (2, 1) for o in orders]) > 0.8
    assert 0.91 < np.mean(np.abs(z) < 1.96) < 0.98


@pytest.mark.slow
def test_cell_fit_by_errors_of_pressure_and_temperature():
    rng = np.random.default_rng(3)
    p, t, _ = cell(rng)
    squares = []
    for _ in range(40):
        r = paint().ratio(p + 300 * rng.normal(size=p.size), t + 0.3 * rng.normal(size=p.size))
        fit = fit_paint(p, t, r, p_ref=101325.0, t_ref=293.15, ratio_sigma=1e-5, pressure_sigma=300.0,
                        temperature_sigma=0.3, order=(2, 1))  # fmt: skip
        squares.append(fit.sigma0**2)
    assert np.mean(squares) == pytest.approx(1.0, abs=0.15)


def test_cell_fit_refuses_with_the_reason():
    rng = np.random.default_rng(4)
    p, t, r = cell(rng)
    some = np.isin(p, np.unique(p)[:2])
    assert "needs 4 different pressures, the table has 2" in fit_paint(
        p[some], t[some], r[some], p_ref=1e5, t_ref=290.0, order=(3, 0)).reason  # fmt: skip
    one_t = t == t[0]
    fit = fit_paint(p[one_t], t[one_t], r[one_t], p_ref=1e5, t_ref=290.0)
    assert fit.order[1] == fit.law.order[1] == 0
    assert any("temperature coefficient is not known" in w for w in fit.warnings)
    assert "does not rise" in fit_paint(p, t, 2 - r, p_ref=1e5, t_ref=290.0, order=(1, 0)).reason
    assert "unknowns, the table 3 rows" in fit_paint(p[:3], t[:3], r[:3], p_ref=1e5, t_ref=290.0, order=(2, 0)).reason
    # Pressure and temperature that rise together tell no product of the two.
    line = fit_paint(p[:8], 280 + p[:8] / 1e4, r[:8], p_ref=1e5, t_ref=290.0, order=(1, 1))
    assert not line
    assert "cannot be told apart" in line.reason
    with pytest.raises(UsageError, match="no rows"):
        fit_paint([], [], [], p_ref=1e5, t_ref=290.0)
    with pytest.raises(UsageError, match="row 2: ratio is -1"):
        fit_paint([1e5, 2e5], [290.0, 290.0], [1.0, -1.0], p_ref=1e5, t_ref=290.0)


def test_residuals_larger_than_stated_scale_the_covariance_and_are_said():
    fit = fit_paint(*cell(np.random.default_rng(5)), p_ref=101325.0, t_ref=293.15, ratio_sigma=0.0005)
    assert fit.sigma0 > 4
    assert any("times their stated sigmas" in w for w in fit.warnings)


def test_flags_on_both_sides_of_every_end():
    law, h = paint(), 1e-6
    (p0, p1), (t0, t1) = law.p_range, law.t_range
    middle_p, middle_t = (p0 + p1) / 2, (t0 + t1) / 2

    def flags(p=middle_p, t=middle_t, p_off=middle_p, t_off=middle_t):
        return int(law.invert(law.ratio(p, t) / law.ratio(p_off, t_off), t, p_off=p_off, t_off=t_off).flags[0])

    for low, high, name, flag in (
        (p0, p1, "p", 1), (t0, t1, "t", 2), (p0, p1, "p_off", 1), (t0, t1, "t_off", 2),
    ):  # fmt: skip
        for inside, outside in ((low * (1 + h), low * (1 - h)), (high * (1 - h), high * (1 + h))):
            assert flags(**{name: inside}) == 0
            assert flags(**{name: outside}) == flag
    ratio = law.ratio(middle_p, middle_t)
    assert law.invert([0.0, -1.0, np.inf], middle_t).flags.tolist() == [4, 4, 4]
    assert law.invert(ratio, np.inf).flags.tolist() == [8]
    for p_off, t_off in ((0.0, middle_t), (np.nan, middle_t), (middle_p, np.nan)):
        assert law.invert(ratio, middle_t, p_off=p_off, t_off=t_off).flags.tolist() == [16]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"coefficients": [[1.0]]}, "with K >= 1"), ({"coefficients": [0.0, 1.0]}, "with K >= 1"),
        ({"coefficients": [[0.1], [np.nan]]}, "finite"), ({"cov": np.eye(3)}, r"cov must be \(2, 2\), got \(3, 3\)"),
        ({"p_ref": 0.0}, "p_ref must be > 0"), ({"t_ref": np.nan}, "t_ref finite"),
        ({"p_range": (-1.0, 2.0)}, "must rise, p >= 0"), ({"p_range": (2.0, 2.0)}, "must rise"),
        ({"p_range": (1.0, np.inf)}, "must rise"), ({"t_range": (2.0, 1.0)}, "must rise"),
        ({"t_range": (1.0, np.inf)}, "must rise"), ({"t_range": (-np.inf, 1.0)}, "must rise"),
    ],
)  # fmt: skip
def test_laws_that_are_none(change, words):
    good = {
        "coefficients": [[0.1], [0.9]],
        "p_ref": 1.0,
        "t_ref": 300.0,
        "p_range": (0.0, 2.0),
        "t_range": (300.0, 300.0),
    }
    assert SternVolmer(**good).order == (1, 0)
    with pytest.raises((UsageError, ValueError), match=words):
        SternVolmer(**(good | change))
