"""Joint covariances of markers: what a whitener must do, and which matrices are refused."""

import numpy as np
import pytest

from windmark.errors import UsageError
from windmark.scene import MarkerCovariance, MarkerSet
from windmark.scene.marker_covariance import ROUNDING

NAMES = ("a", "b", "c")


def made(seed=3, scales=(0.01, 1.0, 40.0)):
    """Nine coordinates that are correlated, markers known to very different sigmas."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(9, 9)) * np.repeat(scales, 3)[:, None]
    return root @ root.T


def test_the_whitener_is_the_inverse_root_and_whitens_draws():
    cov = made()
    w = MarkerCovariance(NAMES, cov).whitener()
    np.testing.assert_allclose(w.T @ w @ cov, np.eye(9), atol=1e-6)
    np.testing.assert_allclose(w @ cov @ w.T, np.eye(9), atol=1e-6)


def test_what_is_known_exactly_counts_as_known_a_thousand_times_better():
    """An inner datum: the mean of all markers is known exactly, so the covariance has three zero eigenvalues."""
    centred = np.kron(np.eye(3) - 1 / 3, np.eye(3))
    known = MarkerCovariance(NAMES, 0.04 * centred)
    w = known.whitener()
    assert np.isfinite(w).all()
    apart = np.array([1.0, 0, 0, -1.0, 0, 0, 0, 0, 0])
    assert np.sum((w @ apart) ** 2) == pytest.approx(2 / 0.04)
    together = np.tile([1.0, 0, 0], 3)
    sigma = np.sqrt(0.04 * 2 / 3)
    assert np.sum((w @ together) ** 2) == pytest.approx(3 / sigma**2 / ROUNDING, rel=1e-6)


def test_sigmas_parts_and_multiples():
    cov = made()
    known = MarkerCovariance(NAMES, cov)
    assert len(known) == 3
    np.testing.assert_allclose(known.sigma.ravel() ** 2, np.diagonal(cov))
    some = known.take(["c", "a"])
    assert some.name.tolist() == ["c", "a"]
    np.testing.assert_array_equal(some.cov[:3, 3:], known.cov[6:, :3])
    np.testing.assert_array_equal(some.cov[3:, 3:], known.cov[:3, :3])
    np.testing.assert_allclose(known.scaled(3.0).sigma, 3 * known.sigma)


def test_a_table_takes_the_sigmas_by_name():
    table = MarkerSet.make(["x", "b", "a", "c"], np.zeros((4, 3)), sigma=7.0)
    out = MarkerCovariance(NAMES, made()).on(table)
    known = MarkerCovariance(NAMES, made()).sigma
    np.testing.assert_array_equal(out.sigma, [[7.0] * 3, known[1], known[0], known[2]])
    assert (table.sigma == 7.0).all()
    with pytest.raises(UsageError, match="names the marker 'c'"):
        MarkerCovariance(NAMES, made()).on(MarkerSet.make(["a", "b"], np.zeros((2, 3))))


def spoiled(row, column, value, *, both=True):
    cov = made()
    cov[row, column] = value
    if both:
        cov[column, row] = value
    return cov


@pytest.mark.parametrize(
    ("names", "cov", "words"),
    [
        (("a", "b"), made(), r"must be \(6, 6\) for 2 names, got \(9, 9\)"),
        (("a", "b", "a"), made(), "name must be unique, more than once: a"),
        (NAMES, spoiled(4, 4, np.nan), "must be finite; it is not for b"),
        (NAMES, spoiled(8, 8, 0.0), "of variances > 0; it is not for c"),
        (NAMES, spoiled(2, 5, 1.5e-2, both=False), "must be symmetric, not for a and b"),
        (NAMES, spoiled(3, 4, 2 * np.sqrt(made()[3, 3] * made()[4, 4])), "no errors can be correlated so"),
    ],
)
def test_what_is_no_covariance_is_refused_with_the_reason(names, cov, words):
    with pytest.raises(UsageError, match=words):
        MarkerCovariance(names, cov)


def test_digits_that_were_cut_off_are_no_reason_to_refuse():
    """A singular covariance written to seven digits has eigenvalues below zero by what was cut off."""
    centred = np.kron(np.eye(3) - 1 / 3, np.eye(3)) * 0.0123456789
    rough = np.round(centred, 9)
    assert np.linalg.eigvalsh(rough).min() < 1e-8
    assert np.isfinite(MarkerCovariance(NAMES, rough).whitener()).all()
    flipped = centred - 2e-5 * 0.0123456789 * np.eye(9)
    with pytest.raises(UsageError, match="positive semidefinite"):
        MarkerCovariance(NAMES, flipped)


@pytest.mark.parametrize(("below", "fine"), [(0.8, True), (1.2, False)])
def test_how_far_below_zero_an_eigenvalue_may_be_grows_with_the_size(below, fine):
    """Rounding adds up over the rows: `ROUNDING` for each of them."""
    correlation = np.eye(9)
    correlation[0, 1] = correlation[1, 0] = 1 + 9 * below * ROUNDING  # eigenvalues 1 +- this
    sigma = np.linspace(1.0, 3.0, 9)
    cov = correlation * np.outer(sigma, sigma)
    if fine:
        assert len(MarkerCovariance(NAMES, cov)) == 3
    else:
        with pytest.raises(UsageError, match="positive semidefinite"):
            MarkerCovariance(NAMES, cov)
