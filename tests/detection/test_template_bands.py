"""Wide discs: the rim's pixels apart from the others give the equations that all pixels give."""

import numpy as np
import pytest

from windmark.detection.template._kernels.algebra import normal_equations
from windmark.detection.template._kernels.bands import ROWS, banded, extremes, forget, used_runs
from windmark.detection.template._kernels.model import SHAPE, evaluate, points_needed, rim_sums

SIZE = 61
TUKEY_CUT = 1.0 / (4.685 * 4.0) ** 2


def window(seed):
    """A noisy patch with a hole, its weights: a round window, of which a part and single pixels are missing."""
    rng = np.random.default_rng(seed)
    x = np.arange(SIZE) - SIZE // 2
    away = np.hypot(x[None, :] - 1.0, x[:, None])
    weight = (away < 28.0).astype(float)
    weight[20:24, 40:] = 0.0
    weight[rng.random(weight.shape) < 0.02] = 0.0
    return 180.0 - 120.0 * (away < 15.0) + rng.normal(0.0, 5.0, weight.shape), weight


def by_all_pixels(patch, weight, p, cut, multiplicative):
    jac, res, table = np.zeros((10, SIZE, SIZE)), np.empty((SIZE, SIZE)), np.empty((8, SIZE + 6))
    cost = evaluate(patch, weight, p, points_needed(p), True, cut, multiplicative, table, jac, res)
    matrix, rhs = np.empty((10, 10)), np.empty(10)
    normal_equations(jac, res, True, np.eye(5), matrix, rhs, np.empty(10))
    left_out = int(((weight > 0) & (jac[7] == 0)).sum())
    return cost, matrix, rhs, np.abs(res).max(), left_out


@pytest.mark.parametrize("multiplicative", [1.0, 0.0])
@pytest.mark.parametrize("cut", [0.0, TUKEY_CUT])
@pytest.mark.parametrize(
    "shape",
    [
        (1.2, -0.4, 15.0, 0.0, 15.0, 0.8),  # hollow
        (0.3, 0.2, 16.0, 3.0, 9.0, 1.1),  # at an angle
        (0.0, 0.0, 3.0, 0.4, 2.5, 0.9),  # no pixel without rim
        (24.0, -22.0, 14.0, -1.0, 12.0, 0.7),  # cut by two borders of the patch
        (2.0, 1.0, 45.0, 0.0, 44.0, 0.8),  # larger than the patch
    ],
)
def test_runs_of_pixels_give_the_same_equations(shape, cut, multiplicative):
    patch, weight = window(3)
    slope = (2e-3, -1e-3) if multiplicative else (0.3, -0.2)
    p = np.array([*shape, 110.0, 180.0, *slope])
    expected = by_all_pixels(patch, weight, p, cut, multiplicative)
    g, bands, spans = np.zeros((10, SIZE, SIZE)), np.zeros((SIZE, 4), np.int64), np.empty((SIZE, 2), np.int64)
    rows, table = np.empty((ROWS, SIZE * SIZE)), np.empty((8, SIZE + 6))
    matrix, rhs = np.empty((10, 10)), np.empty(10)
    used_runs(weight, spans)
    for other in (p + np.array([3.0, -2.0, 1.0, 0.0, 1.0, 0.2, 0, 0, 0, 0]), p):  # nothing is left of the one before
        forget(g, bands)
        rim_sums(other, points_needed(other), SHAPE, table, g, bands)
        cost = banded(patch, weight, spans, other, cut, multiplicative, g, bands, rows, matrix, rhs)
    np.testing.assert_allclose(cost, expected[0], rtol=1e-11)
    scale = np.sqrt(np.maximum(np.diag(expected[1]), 1e-12))
    np.testing.assert_allclose(matrix / np.outer(scale, scale), expected[1] / np.outer(scale, scale), atol=1e-10)
    np.testing.assert_allclose(rhs / scale, expected[2] / scale, atol=1e-8 * np.sqrt(expected[0]))
    largest, left_out = extremes(patch, weight, spans, p, cut, multiplicative, g, bands)
    assert largest == pytest.approx(expected[3], rel=1e-9)
    assert left_out == expected[4]
    assert (left_out > 0) == (cut > 0)
