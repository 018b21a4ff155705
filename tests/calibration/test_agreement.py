"""Known points beside a free network: what a similarity leaves, and blocks taken out one by one, against refits."""

import numpy as np
import pytest
from scipy import stats

from windmark.calibration.agreement import FALSE, Seen, _left, chance


def model(rng, points=7):
    """Differences of known and seen points with a covariance that lacks the seven motions, and their columns."""
    xyz = rng.normal(size=(points, 3))
    design = np.zeros((3 * points, 7))
    for n, (x, y, z) in enumerate(xyz):
        design[3 * n : 3 * n + 3] = [[0, z, -y, 1, 0, 0, x], [-z, 0, x, 0, 1, 0, y], [y, -x, 0, 0, 0, 1, z]]
    root = rng.normal(size=(3 * points, 3 * points))
    basis = np.linalg.qr(design)[0]
    free = root - basis @ (basis.T @ root)  # of the network: it has no such motion
    return design, 0.1 * free @ free.T + 0.2 * np.eye(3 * points)


def gls(design, spread, y):
    """Least misfit over the unknowns, and the residuals' degrees of freedom."""
    white = np.linalg.inv(np.linalg.cholesky(spread))
    rest = white @ y - white @ design @ np.linalg.lstsq(white @ design, white @ y, rcond=None)[0]
    return float(rest @ rest), len(y) - np.linalg.matrix_rank(design)


def seen(design, spread, y):
    weight, rank = _left(spread, design)
    block = np.repeat(np.arange(len(y) // 3), 3)
    return Seen(None, y, weight, np.linalg.inv(spread).diagonal(), block, len(y) - rank, len(y) // 3)


@pytest.mark.parametrize("seed", range(3))
def test_the_misfit_is_that_after_the_best_similarity(seed):
    rng = np.random.default_rng(seed)
    design, spread = model(rng)
    y = rng.normal(size=21)
    for columns in (design, design[:, :6], np.concatenate([design[:, :6], np.zeros((21, 1))], axis=1)):
        got = seen(columns, spread, y)
        total, free = gls(columns, spread, y)
        assert got.total == pytest.approx(total, rel=1e-6)
        assert got.free == free
        assert got.value == pytest.approx(total / free, rel=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_a_block_less_is_a_fit_without_it(seed):
    rng = np.random.default_rng(10 + seed)
    design, spread = model(rng)
    y = rng.normal(size=21)
    y[6:9] += 4.0
    whole = seen(design, spread, y)
    blocks = whole.blocks()
    for b in (0, 2, 6):
        rest = np.arange(21) // 3 != b
        total, free = gls(design[rest], spread[np.ix_(rest, rest)], y[rest])
        less = whole.without(b)
        assert less.total == pytest.approx(total, rel=1e-5)
        assert less.free == free
        assert blocks.value[b] == pytest.approx(whole.total - total, rel=1e-5)
        assert blocks.dof[b] == 3
        assert blocks.p[b] == pytest.approx(stats.chi2.sf(blocks.value[b], 3))
        assert b not in less.block
    assert blocks.value.argmax() == 2


def test_what_nothing_checks_has_no_test():
    """Three points decide six of the seven numbers and check two; a fourth coordinate alone decides nothing."""
    rng = np.random.default_rng(3)
    design, spread = model(rng, 2)
    got = seen(design[:, :6], spread, rng.normal(size=6))
    assert got.free == 1  # two points and no scale: their distance
    assert got.blocks().dof.max() <= 1
    none = seen(design[:3, 3:6], spread[:3, :3], rng.normal(size=3))
    assert none.free == 0
    assert none.total == pytest.approx(0.0, abs=1e-9)
    assert none.blocks().dof.tolist() == [0]
    assert none.blocks().p.tolist() == [1.0]
    assert none.value == none.total


@pytest.mark.parametrize("free", [1, 6, 50])
def test_chance_is_wrong_once_in_a_thousand(free):
    limit = stats.chi2.isf(FALSE, free)
    assert chance(0.999 * limit, free)
    assert not chance(1.001 * limit, free)
    assert chance(1e9, 0)


@pytest.mark.parametrize("off", [5.7e-14, -5.7e-14, 1.1e-13, 3e-13])
def test_the_same_distance_twice_is_no_contradiction_by_rounding(off):
    """The misfit of two that are equal is zero, and by rounding less than that."""
    spread, design = np.full((2, 2), 2e-6) + 1e-4 * np.eye(2), np.full((2, 1), 345.9158)
    weight, rank = _left(spread, design)
    two = Seen(None, np.full(2, off), weight, np.linalg.inv(spread).diagonal(), np.arange(2), 2 - rank, 2)
    assert chance(two.total, two.free)
    assert chance(-3e-39, 1)
