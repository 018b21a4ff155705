"""Candidates, noise tiles and the whole-image kernels, against SciPy."""

import numpy as np
import pytest
from scipy import ndimage

from windmark.detection._kernels.map import bin_mean, depth_peaks, fill_rows, ranked
from windmark.detection._kernels.shape import median
from windmark.detection._kernels.spot import smallest
from windmark.detection.image import prepare
from windmark.detection.search import TILE, at_tiles, bin_factor, box_sizes, candidates, noise_tiles, surface_noise


def box_depth(image, core, window):
    inner = ndimage.uniform_filter(image, 2 * core + 1, mode="nearest") * (2 * core + 1) ** 2
    outer = ndimage.uniform_filter(image, 2 * window + 1, mode="nearest") * (2 * window + 1) ** 2
    n, m = (2 * core + 1) ** 2, (2 * window + 1) ** 2
    return (outer - inner) / (m - n) - inner / n


@pytest.mark.parametrize(("core", "window"), [(1, 3), (2, 5), (4, 8)])
def test_depth_peaks_are_the_local_maxima_of_the_box_depth(core, window):
    image = np.random.default_rng(0).integers(0, 256, (70, 93)).astype(np.float32)
    want = box_depth(image.astype(float), core, window)
    tile, gate = 32, np.linspace(2, 30, 9).reshape(3, 3).astype(np.float32)
    limit = np.kron(gate, np.ones((tile, tile)))[:70, :93]
    peaks = (want == ndimage.maximum_filter(want, 3, mode="constant", cval=-np.inf)) & (want > limit)
    x, y, depth = depth_peaks(image, core, window, gate, tile).T
    index = y.astype(int), x.astype(int)
    got = np.zeros_like(peaks)
    got[index] = True
    np.testing.assert_array_equal(got, peaks)
    np.testing.assert_allclose(depth, want[index], atol=1e-3)


def test_depth_peaks_and_bins_see_missing_pixels_filled():
    image = np.random.default_rng(0).integers(0, 256, (70, 93)).astype(np.float32)
    image[np.random.default_rng(1).random(image.shape) < 0.05] = np.nan
    image[30] = np.nan
    gate = np.full((2, 2), 5.0, np.float32)
    found = depth_peaks(image, 2, 5, gate, 64)
    np.testing.assert_array_equal(found, depth_peaks(fill_rows(image), 2, 5, gate, 64))
    np.testing.assert_array_equal(bin_mean(image, 3), bin_mean(fill_rows(image), 3))


def test_smallest_and_median_are_those_of_a_sort():
    rng = np.random.default_rng(0)
    for values in (rng.normal(size=256), rng.integers(0, 4, 77).astype(np.float32), np.zeros(16), np.arange(9.0)):
        n = len(values) - 1
        for k in (0, n // 4, n - 1):
            assert smallest(values.copy(), n, k) == np.sort(values[:n])[k]
        assert median(values.copy(), n) == np.median(values[:n])
        assert median(values.copy(), n - 1) == np.median(values[: n - 1])


def test_ranked_by_bisection_is_that_of_a_sort():
    rng = np.random.default_rng(0)
    for values in (rng.exponential(size=256), rng.integers(0, 4, 77), np.zeros(16), 1e-38 * rng.random(20)):
        values = values.astype(np.float32)
        for k in (0, len(values) // 4, len(values) - 1):
            assert ranked(values.copy(), k) == np.sort(values)[k]


def test_noise_of_tiles_with_missing_pixels(draw):
    image = np.random.default_rng(0).normal(0, 3.0, (200, 200)).astype(np.float32)
    image[:, 70:120] = np.nan
    image[130:, :60] = np.nan
    noise = noise_tiles(image, 64, 2)
    rows, cols = (np.arange(4) + 0.5).astype(int) * 16 + 8, np.arange(64)
    bend = np.abs(image[rows][:, np.maximum(cols, 2) - 2] - 2 * image[rows][:, np.maximum(cols, 2)]
                  + image[rows][:, np.maximum(cols, 2) + 2])  # fmt: skip
    bend = np.sort(bend[np.isfinite(bend)])
    assert noise[0, 0] == pytest.approx(bend[len(bend) // 4] / (0.3186 * np.sqrt(6)), rel=1e-6)
    known = np.isfinite(image[2::64][:4][:, 2::64]).sum()  # a tile without pixels has the median's
    assert known < 16
    assert noise[2, 0] == pytest.approx(np.median(noise), rel=0.2)


def test_a_plateau_is_one_peak():
    image = np.zeros((40, 40), np.float32)
    image[20:22, 20:22] = -10
    assert len(depth_peaks(image, 1, 3, np.zeros((1, 1), np.float32), 64)) == 1


def test_boxes_have_the_discs_areas():
    for r0 in (2.0, 3.0, 5.0, 5.9):
        core, window = box_sizes(r0)
        assert (2 * core + 1) ** 2 == pytest.approx(np.pi * r0**2, rel=0.35)
        assert (2 * window + 1) ** 2 == pytest.approx(4 * np.pi * r0**2, rel=0.25)
        assert window > core
    assert box_sizes(1.0) == (1, 2)


def test_radii_are_searched_at_3_to_6_pixels():
    for r0 in (6.0, 7.9, 19.0, 46.0, 100.0):
        assert 3.0 <= r0 / bin_factor(r0) < 6.0
    assert bin_factor(5.9) == 1


@pytest.mark.parametrize("radius", [6.0, 9.0, 15.0])
def test_starts_of_a_binned_picture_are_where_its_discs_are(radius, draw):
    """A binned pixel's middle is that of its pixels: without the half pixel starts are off by (factor - 1) / 2."""
    rng, factor = np.random.default_rng(0), bin_factor(radius)
    pitch, across = int(5 * radius), 5
    places = (np.argwhere(np.ones((across, across))) + 0.5) * pitch + rng.uniform(-0.5, 0.5, (across**2, 2)) * factor
    image = prepare(draw((across * pitch,) * 2, [(*p, radius) for p in places]), 1.0)
    start = candidates(image, radius, 0.7, surface_noise(image, radius))
    away = (places[:, None] - start)[np.arange(len(places)), np.hypot(*(places[:, None] - start).T).T.argmin(axis=1)]
    assert np.abs(away).max() < 0.5 * factor
    np.testing.assert_allclose(away.mean(axis=0), 0.0, atol=0.1)


@pytest.mark.parametrize("factor", [2, 3, 5])
def test_bin_mean(factor):
    image = np.random.default_rng(1).normal(size=(23, 31)).astype(np.float32)
    h, w = 23 // factor, 31 // factor
    want = image[: h * factor, : w * factor].reshape(h, factor, w, factor).mean(axis=(1, 3))
    np.testing.assert_allclose(bin_mean(image, factor), want, atol=1e-6)


def test_fill_rows_draws_straight_lines():
    nan = np.nan
    rows = np.array([[nan, 1, nan, nan, 4, nan], [nan] * 6, [1, 2, 3, 4, 5, 6]], dtype=np.float32)
    np.testing.assert_allclose(fill_rows(rows), [[1, 1, 2, 3, 4, 4], [0] * 6, [1, 2, 3, 4, 5, 6]], atol=1e-6)


@pytest.mark.parametrize("sigma", [0.7, 5.0])
def test_noise_of_a_sloping_surface_with_markers(sigma, draw):
    rng = np.random.default_rng(0)
    grid = [(x, y, 3.0) for x in range(8, 250, 12) for y in range(8, 250, 12)]
    y, x = np.mgrid[:256, :256]
    image = draw((256, 256), grid) + 0.5 * x - 0.3 * y + rng.normal(0, sigma, (256, 256))
    noise = noise_tiles(image.astype(np.float32), 64, 1)
    assert noise.shape == (4, 4)
    assert np.median(noise) == pytest.approx(sigma, rel=0.5)


def test_correlated_texture_counts_in_full_at_the_marker_s_scale():
    texture = ndimage.gaussian_filter(np.random.default_rng(0).normal(size=(512, 512)), 1.5)
    texture = (10 * texture / texture.std()).astype(np.float32)
    assert np.median(noise_tiles(texture, 64, 1)) < 4.0
    assert np.median(noise_tiles(texture, 64, 6)) == pytest.approx(10.0, rel=0.1)


def test_surface_noise_is_at_least_one_grey_level():
    image = prepare(np.arange(10000).reshape(100, 100).astype(np.uint16) * 16, 1.0)
    noise = surface_noise(image, 3.0)
    np.testing.assert_array_equal(noise, np.full((2, 2), 16.0))
    assert at_tiles(np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([[TILE + 1.0, 5.0], [5.0, 99.0]]), 3.0).tolist() == [
        2,
        3,
    ]
