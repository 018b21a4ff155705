"""Order and choice of spots, and what a fit's answers mean, against loops and definitions."""

from types import SimpleNamespace

import numpy as np
import pytest

from windmark.detection.decide_fits import has_shape, matched_filter, shape_correlation
from windmark.detection.search import TILE, at_tiles, bin_factor
from windmark.detection.spots import FULL_EVIDENCE_PX, MERIT_FLOOR, distinct, quality
from windmark.detection.template.blocks import FEW, in_blocks
from windmark.detection.template.crlb import window_radius


def spots(count=60, seed=0):
    rng = np.random.default_rng(seed)
    return SimpleNamespace(
        xy=rng.uniform(0, 60, (count, 2)), r0=rng.choice([1.5, 3.0, 5.0], count), merit=rng.uniform(0, 1, count),
        depth=rng.uniform(1, 9, count), noise=rng.uniform(0.5, 1, count),
    )  # fmt: skip


def test_quality_is_depth_over_noise_and_merit_less_for_small_holes():
    some = spots()
    for k, got in enumerate(quality(some, some.depth, some.noise)):
        small = min(np.sqrt(some.r0[k] / FULL_EVIDENCE_PX), 1.0)
        assert got == pytest.approx(small * some.depth[k] / some.noise[k] / max(some.merit[k], MERIT_FLOOR))


@pytest.mark.parametrize("seed", range(4))
def test_of_spots_too_near_to_each_other_the_best_one_stays(seed):
    some = spots(seed=seed)
    for width in (None, some.r0 * 1.7):
        size, kept = some.r0 if width is None else width, []
        for k in np.argsort(-quality(some, some.depth, some.noise), kind="stable").tolist():
            if all(np.hypot(*(some.xy[k] - some.xy[j])) >= 1.5 * (size[k] + size[j]) / 2 for j in kept):
                kept.append(k)
        assert distinct(some, width).tolist() == kept
    one = spots(1)
    assert distinct(one).tolist() == [0]


def test_points_have_the_noise_of_their_tile():
    noise = np.arange(12.0).reshape(3, 4)
    side = TILE * bin_factor(2.0)
    xy = np.array([[0.0, 0.0], [side - 0.1, side + 0.1], [3.5 * side, 2.5 * side], [9 * side, 9 * side]])
    np.testing.assert_array_equal(at_tiles(noise, xy, 2.0), [0.0, 4.0, 11.0, 11.0])


def fits(correlation, noise, radius=4.0, blur=0.7):
    n = len(correlation)
    return SimpleNamespace(
        correlation=np.array(correlation), noise=np.array(noise, float), radius_px=np.full(n, radius),
        blur_px=np.full(n, blur),
    )  # fmt: skip


def test_the_matched_filter_is_signal_over_noise():
    """Of a window whose variance the disc explains by rho^2: root of the pixels times explained over noise."""
    pixels = np.pi * window_radius(np.array([4.0]), np.array([0.7]))[0] ** 2
    for rho, noise, sigma in ((0.9, 2.0, 2.0), (0.5, 3.0, 1.0), (-0.8, 1.0, 2.0)):
        explained = noise**2 * rho**2 / (1 - rho**2)  # beside the residuals' variance
        got = matched_filter(fits([rho], [noise]), np.array([sigma**2]))
        assert got[0] == pytest.approx(np.sqrt(pixels * explained) / sigma)
    assert np.isinf(matched_filter(fits([1.0], [1.0]), np.ones(1)))[0]


def test_the_shape_is_what_noise_does_not_explain():
    pixels = np.pi * window_radius(np.array([4.0]), np.array([0.7]))[0] ** 2
    most = 1 + 2 * np.sqrt(2 / pixels)
    rho = 0.8
    for ratio in (0.0, 0.3, 0.99 / most):
        left = 1 - ratio * most  # part of the residuals' variance that is no noise
        got = shape_correlation(fits([rho], [1.0]), np.array([ratio]))
        assert got[0] == pytest.approx(np.sqrt(1 - left * (1 - rho**2)))
    assert shape_correlation(fits([rho], [1.0]), np.array([1.0]))[0] == 1.0
    assert shape_correlation(fits([-0.8], [1.0]), np.array([0.0]))[0] == 0.0
    assert has_shape(fits([1, 1], [1, 1], 50.0), [0.1]).all()
    assert has_shape(fits([1], [1], 0.1), [50.0]).all()
    assert not has_shape(fits([1], [1], 0.1), [0.1, 50.0]).any()


@pytest.mark.parametrize(("count", "known"), [(FEW - 1, False), (3 * FEW, True)])
def test_residuals_that_jump_along_a_grid_are_of_blocks(count, known):
    rng = np.random.default_rng(2)
    size = 21
    pixel = rng.integers(50, 500, (count, 2))
    residual, noise = np.empty((count, size, size)), rng.normal(0, 1, (count, size, size))
    for k, (px, py) in enumerate(pixel):
        x, y = (p - size // 2 + np.arange(size) for p in (px, py))
        level = rng.normal(0, 4, (90, 90))
        residual[k] = level[y[:, None] // 8, x[None] // 8] + 0.3 * noise[k]
    used = np.ones(residual.shape, bool)
    assert in_blocks(residual, used, pixel) == known
    assert not in_blocks(noise, used, pixel)
    along = residual.mean(axis=1, keepdims=True) + 0.3 * noise  # upright edges alone are something else
    assert not in_blocks(along, used, pixel)
