"""In-situ calibration: coverage with blocked taps and a shared temperature error, refusals."""

import numpy as np
import pytest

from windmark.errors import UsageError
from windmark.paint import NodeField, in_situ


def case(seed, n=20, blocked=0, mode=500.0):
    """Readings, a-priori pressures at taps and at three nodes, the truth there, and which taps are blocked."""
    rng = np.random.default_rng(seed)
    true = rng.uniform(4e4, 9e4, n)
    nodes = np.array([4.2e4, 6e4, 8.8e4])
    e = rng.standard_normal()

    def x(p):
        column = mode + 0.01 * (p - 6e4)
        return NodeField.make((p - 3000) / 1.1 + e * column + rng.normal(0, 200, len(p)), 200.0).with_mode(
            "temperature", column)  # fmt: skip

    p = true + rng.normal(0, 100, n)
    bad = rng.choice(n, blocked, replace=False)
    p[bad] = true[bad] + rng.choice([-1, 1], blocked) * rng.uniform(3e3, 3e4, blocked)
    return [f"t{k}" for k in range(n)], p, x(true), x(nodes), nodes, {f"t{k}" for k in bad}


@pytest.mark.slow
@pytest.mark.parametrize("blocked", [0, 3, 7])
def test_sigmas_cover_and_blocked_taps_are_named(blocked):
    z, wrong = [], 0
    for seed in range(40):
        names, p, x, at, true, bad = case(seed + 100 * blocked, blocked=blocked)
        fit = in_situ(names, p, x, pressure_sigma=100.0)
        assert fit
        assert bad <= set(fit.blocked)
        wrong += bool(set(fit.blocked) - bad)
        got = fit.applied(at)
        z.append((got.value - true) / got.sigma)
    assert 0.89 < np.mean(np.abs(z) < 1.96) < 0.99
    assert wrong <= 7


def test_taps_take_up_a_temperature_error_that_all_share():
    names, p, x, at, _, _ = case(1, mode=1500.0)
    got = in_situ(names, p, x, pressure_sigma=100.0).applied(at)
    assert (np.abs(at.modes[:, 0]) > 1300).all()
    assert (np.abs(got.modes[:, got.names.index("temperature")]) < 100).all()


def test_an_error_of_all_readings_stays():
    names, p, x, at, _, _ = case(2)
    got = in_situ(names, p, x, pressure_sigma=100.0, common_sigma=70.0).applied(at)
    np.testing.assert_allclose(np.abs(got.modes[:, got.names.index("taps")]), 70.0, rtol=1e-6)


def test_leave_one_out_is_that_of_fits_without_the_tap():
    names, p, x, _, _, _ = case(3, n=8)
    fit = in_situ(names, p, x, pressure_sigma=300.0)
    assert fit.used.all()
    off = []
    for k in range(8):
        rest = np.arange(8) != k
        other = in_situ([names[i] for i in np.flatnonzero(rest)], p[rest], x.take(rest), pressure_sigma=300.0)
        off.append(p[k] - other.applied(x.take([k])).value[0])
    assert fit.loo_rms == pytest.approx(np.sqrt(np.mean(np.square(off))), rel=0.05)


def test_scatter_beyond_the_sigmas_is_found_and_is_in_every_node():
    names, p, x, at, _, _ = case(4, n=60)
    p = p + np.random.default_rng(0).normal(0, 800, 60)
    fit = in_situ(names, p, x, pressure_sigma=100.0)
    assert 550 < fit.scatter < 1050
    assert (fit.applied(at).sigma > fit.scatter).all()
    assert any("beyond their sigmas" in w for w in fit.warnings)


@pytest.mark.slow
@pytest.mark.parametrize("n", [6, 20])
def test_sigmas_that_are_stated_too_small_do_not_make_the_result_too_sure(n):
    """Readings that scatter five times as stated: few taps tell the scatter badly, and none of them is blocked."""
    hold, left = [], 0
    nodes = np.linspace(4.5e4, 8.5e4, 5)
    for seed in range(60):
        rng = np.random.default_rng(500 + seed)
        true = rng.uniform(4e4, 9e4, n)
        fit = in_situ([str(k) for k in range(n)], true + rng.normal(0, 500, n), NodeField.make(true, 50.0),
                      pressure_sigma=100.0)  # fmt: skip
        left += n - fit.used.sum()
        got = fit.applied(NodeField.make(nodes, 50.0))
        hold.append(np.abs(got.value - nodes) < 1.96 * np.sqrt(got.variance - got.white))
    assert 0.88 < np.mean(hold) < 0.985
    assert left < 7


def test_a_curved_paint_needs_a_polynomial():
    rng = np.random.default_rng(6)
    ratio = rng.uniform(0.5, 1.2, 25)
    p = 9e4 * ratio + 2e4 * ratio**2 + rng.normal(0, 50, 25)
    x = NodeField.make(ratio, 0.0003)
    line, curve = (in_situ([str(k) for k in range(25)], p, x, pressure_sigma=50.0, order=o) for o in (1, 2))
    assert curve.loo_rms < 0.4 * line.loo_rms
    np.testing.assert_allclose(curve.applied(NodeField.make([0.8])).value, 9e4 * 0.8 + 2e4 * 0.64, atol=60)


@pytest.mark.parametrize(
    ("p", "x", "kind", "words"),
    [
        ([5e4, 6e4], [5e4, 6e4], {}, "2 unknowns need at least 3"),
        ([5e4, 6e4, np.nan], [5e4, 6e4, 7e4], {}, "2 taps have a reading"),
        ([5e4] * 6, [5e4] * 6, {}, "nothing tells the slope"),
        ([5e4, 5.001e4, 5.002e4, 5.001e4, 5e4], [5e4, 5.002e4, 5.001e4, 5e4, 5.003e4], {}, "do not spread|do not rise"),
        ([5e4] * 5 + [6e4], [5e4] * 5 + [6e4], {}, "too few places along the pressure"),
        ([9e4, 8e4, 7e4, 6e4, 5e4], [5e4, 6e4, 7e4, 8e4, 9e4], {}, "do not rise with what the paint shows"),
    ],
)  # fmt: skip
def test_what_the_taps_do_not_tell_is_refused(p, x, kind, words):
    fit = in_situ([str(k) for k in range(len(p))], p, NodeField.make(x, 100.0), pressure_sigma=100.0, **kind)
    assert not fit
    import re

    assert re.search(words, fit.reason), fit.reason


@pytest.mark.parametrize(("spread", "told"), [(65.0, False), (80.0, True)])
def test_a_slope_whose_interval_holds_none_is_refused(spread, told):
    """Sigma of the slope 0.55 and 0.45 of it: 102 Pa over the root of the sum of eight squares."""
    x = np.repeat([5e4 - spread, 5e4, 5e4 + spread], 4)
    p = x + np.tile([60.0, -60.0, 60.0, -60.0], 3)
    fit = in_situ([str(k) for k in range(12)], p, NodeField.make(x, 20.0), pressure_sigma=100.0)
    assert bool(fit) is told
    assert told or "its sigma is 55" in fit.reason


def test_offset_alone_for_taps_without_spread():
    fit = in_situ(list("abcd"), [5.1e4, 5.11e4, 5.09e4, 5.1e4], NodeField.make([5e4, 5.01e4, 5e4, 5e4], 100.0),
                  pressure_sigma=100.0, free="offset")  # fmt: skip
    assert fit.applied(NodeField.make([7e4])).value[0] == pytest.approx(7.1e4, abs=150)


def test_three_taps_are_enough_and_nodes_beyond_them_are_told():
    fit = in_situ(list("abc"), [5e4, 6e4, 7e4], NodeField.make([5e4, 6e4, 7e4], 10.0), pressure_sigma=10.0)
    assert fit
    assert fit.outside(NodeField.make([4e4, 6e4, 7.1e4, 8e4])).tolist() == [True, False, False, True]


def test_wrong_use():
    x = NodeField.make([1.0, 2.0, 3.0])
    for wrong in ({"order": 4}, {"free": "slope"}, {"order": 2, "free": "offset"}, {"pressure_sigma": 0.0}):
        with pytest.raises(UsageError):
            in_situ(list("abc"), [1.0, 2.0, 3.0], x, **{"pressure_sigma": 1.0, **wrong})
    with pytest.raises(UsageError, match="names of the taps must differ"):
        in_situ(list("aab"), [1.0, 2.0, 3.0], x, pressure_sigma=1.0)


@pytest.mark.parametrize("sigma", [np.inf, np.nan, 0.0])
def test_a_sigma_that_is_no_number_is_refused_in_words(sigma):
    p = np.array([4e4, 5e4, 6e4, 7e4, 8e4])
    with pytest.raises(UsageError, match="pressure_sigma must be finite and > 0"):
        in_situ(list("abcde"), p, NodeField.make(p, 50.0), pressure_sigma=[20.0, sigma, 20.0, 20.0, 20.0])
