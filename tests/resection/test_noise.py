"""The noise of a picture from itself: known laws, and what must not be taken for noise."""

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.resection import NoiseLaw, noise_law, sample_points
from windmark.resection.noise import BINS, LEAST
from windmark.scene import Mesh


def light(rows=300, columns=300, low=100.0, high=900.0):
    return np.tile(np.linspace(low, high, columns), (rows, 1))


@pytest.mark.parametrize(("slope", "constant"), [(0.04, 0.0), (0.5, 20.0), (0.2, -10.0)])
def test_shot_noise_and_black_level_are_found(rng, slope, constant):
    """Medians of 90,000 differences: 1 to 2 % of the variance, ten seeds were within 4 %."""
    level = light()
    law = noise_law(rng.normal(level, np.sqrt(constant + slope * level)))
    for at in (150.0, 500.0, 850.0):
        assert law.variance(at) == pytest.approx(constant + slope * at, rel=0.06)
    assert law.slope == pytest.approx(slope, rel=0.08)


def test_surfaces_that_are_smooth_along_rows_or_columns_are_no_noise(rng):
    along, across = 50 * rng.normal(size=(1, 80)), 50 * rng.normal(size=(60, 1))
    law = noise_law(1000.0 + along + across)  # upright stripes and lying ones of any height
    assert law.variance(1000.0) < 1e-18


def test_no_noise_at_all_is_rounding_in_whole_numbers_and_nothing_else(rng):
    for kind in (np.uint8, np.int16, bool):
        law = noise_law(np.ones((40, 40), kind))
        assert (law.constant, law.slope, law.least) == (1 / 12, 0.0, 1 / 12)
    law = noise_law(np.full((40, 40), 7.0))
    assert (law.constant, law.slope, law.least) == (0.0, 0.0, 0.0)
    faint = noise_law(np.rint(rng.normal(light(), 0.05)).astype(np.uint16))
    assert faint.variance(500.0) >= 1 / 12


@pytest.mark.parametrize("shape", [(2, 50), (50, 2), (1, 1), (0, 5), (3, 0)])
def test_pictures_without_three_by_three_pixels_say_nothing(shape):
    assert noise_law(np.zeros(shape)).variance(1.0) == 0.0
    assert noise_law(np.zeros(shape, np.uint8)).variance(1.0) == 1 / 12


def test_three_by_three_pixels_are_enough():
    """One mixed second difference: 1 -2 1 in both directions, of variance 36 of one pixel's, and a median of one."""
    image = np.zeros((3, 3))
    image[1, 1] = 3.0
    assert noise_law(image).variance(0.0) == pytest.approx((3 * 4 / 6 / 0.6744897501960817) ** 2)
    image[0, 0] = np.nan
    assert noise_law(image).variance(0.0) == 0.0


def test_noise_that_falls_with_the_light_is_one_number(rng):
    level = light()
    law = noise_law(rng.normal(level, np.sqrt(60 - 0.05 * level)))
    assert law.slope == 0.0
    assert law.variance(500.0) == pytest.approx(35, rel=0.1)


def test_far_below_all_groups_the_law_stays_half_of_the_least_one(rng):
    """A law with a negative constant crosses zero where no pixel is."""
    level = light(low=200.0)
    law = noise_law(rng.normal(level, np.sqrt(0.2 * level - 30.0)))
    assert law.constant < -20
    darkest = 0.2 * (200 + 700 / BINS / 2) - 30
    assert law.variance(-1000.0) == pytest.approx(darkest / 2, rel=0.15)


def test_levels_with_texture_do_not_lift_the_law(rng):
    level = light()
    image = rng.normal(level, np.sqrt(0.1 * level))
    texture = (level > 550) & (level < 650)
    image[texture] += 40 * rng.normal(size=texture.sum())
    law = noise_law(image)
    for at in (200.0, 400.0, 800.0):
        assert law.variance(at) == pytest.approx(0.1 * at, rel=0.1)


@pytest.mark.parametrize(("columns", "told"), [(78, False), (82, True)])
def test_a_group_needs_enough_pixels_for_its_median(rng, columns, told):
    """Below, all pixels are one group: one number, and no law."""
    level = light(60 + 2, columns + 2)
    assert (60 * columns >= BINS * LEAST) == told
    law = noise_law(rng.normal(level, np.sqrt(0.5 * level)))
    assert (law.slope > 0) == told
    assert law.variance(500.0) == pytest.approx(250.0, rel=0.2)


def test_rows_are_left_out_evenly_where_there_are_many(rng):
    level = light(600, 200)
    full = rng.normal(level, np.sqrt(0.1 * level))
    few, every = noise_law(full, most=30_000), noise_law(full)
    assert few != every
    for at in (200.0, 800.0):
        assert few.variance(at) == pytest.approx(0.1 * at, rel=0.12)
    assert noise_law(full, most=full.size) == every


def test_the_law_keeps_what_is_not_known():
    law = noise_law(np.ones((40, 40), np.uint8))
    np.testing.assert_array_equal(law.variance([np.nan, 3.0]), [np.nan, 1 / 12])
    with pytest.raises(ValueError, match=r"image must be \(H, W\), got \(4, 4, 3\)"):
        noise_law(np.zeros((4, 4, 3)))


def test_noise_of_pixels_far_apart_is_the_same_where_each_has_its_own(rng):
    image = rng.normal(light(), 5.0)
    far = noise_law(image, apart=4)
    assert far.variance(500.0) == pytest.approx(25.0, rel=0.05)
    assert far.alike < 0.05
    assert noise_law(image[:8], apart=4).constant == 0.0
    assert noise_law(np.ones((8, 90), np.uint8), apart=4).constant == 1 / 12
    with pytest.raises(ValueError, match="apart"):
        noise_law(image, apart=0)


def test_means_over_pixels_have_noise_that_is_alike(rng):
    """Of 3 x 3 pixels a ninth of the variance; the mixed difference of neighbours has hardly any of it."""
    from scipy.ndimage import uniform_filter

    law = noise_law(uniform_filter(rng.normal(light(), 9.0), 3), apart=4)
    assert law.variance(500.0) == pytest.approx(9.0, rel=0.1)
    assert law.alike > 0.8


def test_a_value_between_pixels_has_less_noise_only_where_that_of_neighbours_is_not_alike():
    camera, pose = Camera((40, 30), 50.0), Pose.look_at((0, 0, 4.0), np.zeros(3), (0, 1.0, 0))
    plate = Mesh.make([[-2, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0]], [[0, 1, 2], [0, 2, 3]])
    asked = np.stack([np.linspace(-0.5, 0.5, 40), np.zeros(40), np.zeros(40)], axis=1)
    sigma = {}
    for alike in (0.0, 0.5, 1.0):
        law = NoiseLaw(4.0, 0.0, 0.0, alike)
        found = sample_points(np.full((30, 40), 7.0), camera, pose, plate, asked, noise=law, interpolation="linear")
        sigma[alike] = found.sigma
    np.testing.assert_allclose(sigma[1.0], 2.0)
    np.testing.assert_allclose(sigma[0.5] ** 2, (sigma[0.0] ** 2 + 4.0) / 2)
    assert sigma[0.0].min() < 1.5


def test_noise_that_was_spread_over_neighbours_is_told_from_white_noise_and_from_shading(rng):
    from scipy.ndimage import gaussian_filter, zoom

    white, (y, x) = rng.normal(light(), 5.0), np.indices((300, 300))
    for alone in (white, np.rint(white).astype(np.uint16), 1000 * np.sin(x / 20) * np.sin(y / 20) + 0.1 * white):
        assert noise_law(alone) == noise_law(alone, apart=1)
    smooth = gaussian_filter(white, 0.8, mode="reflect")
    true = (smooth - gaussian_filter(light(), 0.8)).var()
    assert noise_law(smooth).variance(500.0) == pytest.approx(true, rel=0.1)
    assert noise_law(smooth).alike > 0.9
    wide = gaussian_filter(white, 1.5)
    assert noise_law(wide).variance(500.0) == pytest.approx((wide - gaussian_filter(light(), 1.5)).var(), rel=0.15)
    for period in (6, 8, 10, 12, 16):  # a woven surface is none
        woven = 10 * white + 200 * np.sin(2 * np.pi * x / period) * np.sin(2 * np.pi * y / period)
        assert noise_law(woven).alike == 0.0
    assert noise_law(zoom(white[:150, :150], 2, order=1)).alike > 0.7
    for flat in (np.zeros((10, 40)), np.ones((40, 40))):
        assert noise_law(flat).alike == 0.0
