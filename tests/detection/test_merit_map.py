"""The merit map, and the search against it."""

import numpy as np
import pytest
from scipy import ndimage

import windmark.detection as wd
from windmark.detection._kernels.merit import merit_pixels
from windmark.detection._kernels.spot import refine_bowl
from windmark.detection.search import Bowl


@pytest.mark.parametrize("polarity", ["dark", "bright"])
@pytest.mark.parametrize("r0", [1.0, 2.0, 3.4])
def test_map_is_the_twin_s_everywhere(r0, polarity, fit_hole):
    rng = np.random.default_rng(0)
    image = rng.normal(1000, 30, (24, 31))
    image[9, 20] = np.nan
    got = wd.merit_map(image, r0, polarity)
    assert got.shape == image.shape
    assert got.dtype == np.float32
    work = image if polarity == "dark" else -image
    for y, x in [(12, 11), (13, 15), (9, 20), (7, 21), (0, 5), (11, 1), (23, 30), (2, 28), (22, 9), (12, 17)]:
        m, depth = fit_hole(work, x, y, r0)
        seen = np.isfinite(got[y, x])
        if seen:
            assert got[y, x] == pytest.approx(m, rel=1e-4)
            assert depth > 0
        elif np.isinf(got[y, x]):
            assert depth < 0
    assert np.isfinite(got).mean() > 0.3
    assert np.isinf(got).any()


@pytest.mark.parametrize("r0", [1.0, 2.6, 4.0])
def test_map_is_that_of_single_pixels(r0):
    """Sums along rows give what the general way gives, also at the border, and however the image is cut into blocks."""
    rng = np.random.default_rng(2)
    y, x = np.mgrid[:300, :600]
    image = np.round(1e4 + 4.0 * y - 2.0 * x + rng.normal(0, 40, x.shape)).astype(np.uint16)
    image[100, 300] = 0
    got, want = wd.merit_map(image, r0), np.full(image.shape, np.nan, np.float32)
    g = image - np.float32(1e4)
    g[100, 300] = np.nan
    merit_pixels(g, np.argwhere(np.ones(g.shape, bool)).copy(), 0, r0, 0.8, want)
    np.testing.assert_array_equal(np.isnan(got), np.isnan(want))
    deep = want < 4
    np.testing.assert_allclose(got[deep], want[deep], rtol=1e-3)
    assert (np.isinf(got) == np.isinf(want)).mean() > 0.999


def test_map_needs_enough_of_hole_and_window():
    image = np.random.default_rng(0).normal(size=(40, 40))
    seen = ~np.isnan(wd.merit_map(image, 4.0))
    assert seen[4:-4, 4:-4].all()
    assert not seen[0].any()
    assert not seen[:, -1].any()


def test_map_of_nothing():
    half_flat = np.zeros((40, 40))
    half_flat[:, 30:] = np.random.default_rng(0).normal(size=(40, 10))
    assert np.isinf(wd.merit_map(half_flat, 3.0)[5:35, 5:20]).all()
    assert np.isinf(wd.merit_map(np.full((20, 20), 7, np.uint8), 3.0)).all()
    assert np.isnan(wd.merit_map(np.full((20, 20), np.nan), 3.0)).all()
    assert np.isnan(wd.merit_map(np.arange(9.0).reshape(3, 3) % 4, 3.0)).all()


def test_map_says_what_is_wrong():
    image = np.zeros((20, 20))
    with pytest.raises(ValueError, match="radius_px"):
        wd.merit_map(image, 0.5)
    with pytest.raises(ValueError, match="polarity"):
        wd.merit_map(image, 3.0, "black")


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float64])
def test_search_finds_what_the_map_shows(dtype, scene):
    """The paper's way (map, threshold, one spot per area, bowl) gives the spots of the fast search."""
    image, centres = scene
    image = np.round(image).astype(dtype)
    areas, count = ndimage.label(wd.merit_map(image, 3.0) < 0.7)
    lowest = ndimage.minimum_position(np.nan_to_num(wd.merit_map(image, 3.0), nan=9), areas, range(1, count + 1))
    bowl = Bowl.of_radius(3.0)
    start = np.array(lowest, dtype=float)[:, ::-1].copy()
    paper = refine_bowl((image - 100.0).astype(np.float32), start, 3.0, 2.0, 0.85, bowl.positions, bowl.functionals)
    fast = wd.detect(image, radius_px=3.0, refine="bowl")
    assert len(fast) == len(centres) == count
    order = np.lexsort(np.round(fast.xy).T)
    want = paper[np.lexsort(np.round(paper[:, :2]).T)]
    np.testing.assert_allclose(fast.xy[order], want[:, :2], atol=1e-3)
    np.testing.assert_allclose(fast.merit[order], want[:, 2], atol=2e-3)
    assert (fast.merit <= wd.merit_map(image, 3.0)[tuple(np.round(fast.xy).astype(int).T[::-1])] + 0.02).all()
