"""Fields with shared errors: functions, sums, what dominates, fewer columns."""

import numpy as np
import pytest
from scipy.sparse import csr_array

from windmark.errors import DataError, UsageError
from windmark.paint import NodeField, TunnelConditions, carried, combined, dominant, fewer_modes, interpolated
from windmark.paint import pressure_coefficient as cp_of


def field(rng, n=40, names=("temperature", "pose:1", "pose:2")):
    modes = 0.05 * rng.normal(size=(n, len(names)))
    return NodeField(rng.uniform(1, 2, n), rng.uniform(0.01, 0.1, n) ** 2, modes, names)


def draws(f, factors, rng):
    """One draw of a field's errors with the causes' factors given."""
    return np.sqrt(f.white) * rng.normal(size=len(f)) + f.modes @ [factors[n] for n in f.names]


def test_sums_and_functions_have_the_covariance_that_draws_show():
    rng = np.random.default_rng(5)
    a, b = field(rng), field(rng, names=("temperature", "reference"))
    w = rng.normal(size=(3, 40))
    product = combined(a.value * b.value, [(a, b.value), (b, a.value)])
    got = carried(product, w)
    seen = []
    for _ in range(4000):
        factors = dict(zip(("temperature", "pose:1", "pose:2", "reference"), rng.normal(size=4), strict=True))
        seen.append(w @ ((draws(a, factors, rng)) * b.value + a.value * draws(b, factors, rng)))
    np.testing.assert_allclose(np.cov(np.array(seen).T) / np.outer(got.sigma, got.sigma),
                               got.cov / np.outer(got.sigma, got.sigma), atol=0.08)  # fmt: skip
    assert set(got.causes) == {"temperature", "pose", "reference", "noise"}
    np.testing.assert_allclose(sum(got.causes.values()), np.diag(got.cov))
    assert sum(share for _, share in got.dominant(1)) == pytest.approx(1)


def test_a_shared_cause_cancels_in_a_ratio_and_independent_ones_do_not():
    a = NodeField.make(np.full(5, 2.0)).with_mode("lamp", 0.02)
    b = NodeField.make(np.full(5, 4.0)).with_mode("lamp", 0.04)
    assert combined(a.value / b.value, [(a, 1 / b.value), (b, -a.value / b.value**2)]).sigma.max() < 1e-15
    other = NodeField.make(np.full(5, 4.0)).with_mode("other lamp", 0.04)
    got = combined(a.value / b.value, [(a, 1 / b.value), (other, -a.value / b.value**2)])
    np.testing.assert_allclose(got.sigma, 0.5 * 0.01 * np.sqrt(2))


def test_a_value_without_variance_is_none():
    f = NodeField.make([1.0, 2.0], [0.1, np.nan])
    assert f.known.tolist() == [True, False]
    assert np.isnan(f.sigma[1])


def test_sparse_and_dense_operators_agree_and_unknown_nodes_must_not_count():
    rng = np.random.default_rng(1)
    f = field(rng)
    w = rng.normal(size=(2, 40)) * (rng.uniform(size=(2, 40)) < 0.3)
    w[:, 7] = 0
    f.value[7] = np.nan
    a, b = carried(f, w), carried(f, csr_array(w))
    np.testing.assert_allclose(a.cov, b.cov)
    np.testing.assert_allclose(a.value, b.value)
    w[0, 7] = 1
    with pytest.raises(DataError, match="1 nodes that count have no value"):
        carried(f, w)


def test_with_modes_has_the_parameters_covariance():
    rng = np.random.default_rng(2)
    j = rng.normal(size=(30, 4))
    root = rng.normal(size=(4, 4)) * [1, 10, 1e-3, 1]
    cov = root.T @ root
    f = NodeField.make(np.zeros(30)).with_modes("calibration", j, cov)
    np.testing.assert_allclose(f.modes @ f.modes.T + np.diag(f.white), j @ cov @ j.T, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(f.variance, np.diag(j @ cov @ j.T), rtol=1e-9)


def test_fewer_modes_keep_every_variance_and_are_not_mistaken_for_their_cause():
    rng = np.random.default_rng(3)
    f = field(rng, names=(*(f"pose:{k}" for k in range(6)), "temperature"))
    few = fewer_modes(f, 4)
    assert len(few.names) == 4
    assert {n.split(":")[0] for n in few.names} == {"pose*", "temperature*"}
    np.testing.assert_allclose(few.variance, f.variance)
    assert fewer_modes(f, 7) is f
    with pytest.raises(UsageError, match="no longer the same cause"):
        combined(f.value, [(few, 1.0), (few, 1.0)])
    full = NodeField(f.value, f.white, rng.normal(size=(40, 30)), tuple(f"c{k}" for k in range(30)))
    with pytest.raises(UsageError, match="at most 30 modes, got 31"):
        full.with_mode("one more", 1.0)


def test_interpolated_at_taps():
    f = NodeField(np.array([1.0, 2.0, np.nan]), np.full(3, 0.04), np.array([[1.0], [3.0], [0.0]]), ("t",))
    at = interpolated(f, [[0, 1, 2], [0, 1, 2]], [[0.5, 0.5, 0.0], [0.2, 0.2, 0.6]])
    assert at.value[0] == 1.5
    assert np.isnan(at.value[1])
    np.testing.assert_allclose([at.white[0], at.modes[0, 0]], [0.02, 2.0])


@pytest.mark.parametrize("bad", ["negative", "twice", "shape"])
def test_what_is_no_field(bad):
    v = np.ones(3)
    with pytest.raises(ValueError, match=r"variance|differ|must be \(N,\)"):
        NodeField(v, -v if bad == "negative" else v, np.ones((3, 2)), ("a", "a") if bad == "twice" else ("a", "b")[
            : 1 if bad == "shape" else 2])  # fmt: skip


def test_cp_and_its_conditions():
    """Isentropic flow: NACA 1135's table at M = 0.8; errors of p_inf and q_inf correlated, by Monte-Carlo."""
    c = TunnelConditions.from_mach(100e3, 0.8, p_0_sigma=100, mach_sigma=0.002)
    assert c.p_inf / 100e3 == pytest.approx(0.6560, abs=5e-5)
    assert c.q_inf / 100e3 == pytest.approx(0.2939, abs=5e-5)
    p = NodeField.make([50e3, 90e3, np.nan], 50.0, unit="Pa")
    got = cp_of(p, c)
    rng = np.random.default_rng(4)
    seen = []
    for _ in range(4000):
        d = TunnelConditions.from_mach(100e3 + 100 * rng.normal(), 0.8 + 0.002 * rng.normal())
        seen.append((p.value[:2] + 50 * rng.normal(size=2) - d.p_inf) / d.q_inf)
    np.testing.assert_allclose(np.std(seen, axis=0), got.sigma[:2], rtol=0.05)
    assert np.isnan(got.value[2])
    assert dominant(got)[0][0] == "conditions"
    with pytest.raises(UsageError, match="psf"):
        cp_of(NodeField.make([1.0], unit="psf"), c)
