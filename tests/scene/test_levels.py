"""Where a picture clips, by its levels."""

import numpy as np
import pytest

from windmark.scene.levels import clipped_level, full_scale, saturated_as_missing, saturation_level, unused_bits


def picture(top, sigma=30.0):
    levels = np.random.default_rng(1).normal(200, sigma, (80, 100))
    return np.minimum(np.maximum(levels, 0), top).astype(np.uint16)


def test_a_plateau_below_the_largest_number_is_where_it_clips():
    assert clipped_level(picture(240)) == 240
    assert clipped_level(picture(10_000)) == np.inf


@pytest.mark.parametrize("kind", [np.uint16, np.float32])
def test_what_is_brighter_than_the_level_where_it_clips_hides_it_not(kind):
    """A hot pixel; a number that was written into the picture."""
    clipped = picture(240).astype(kind)
    clipped[3, 4] = 900
    assert clipped_level(clipped) == 240
    clipped[40:46, 10:60] = 1000
    assert clipped_level(clipped) == 240
    bright = picture(10_000).astype(kind)
    bright[40:46, 10:60] = 1000
    assert clipped_level(bright) == 1000


@pytest.mark.parametrize("factor", [16, 257])
def test_levels_that_lie_several_apart_clip_only_where_they_pile_up(factor):
    """Twelve bits in sixteen, or eight: one below the largest level there is no pixel, and a few dozen are at it."""
    few = np.concatenate([picture(10_000, 1.0).ravel(), np.full(30, 204), np.full(25, 203)]).astype(np.uint16)
    few = few[few <= 204]
    assert (few == 204).sum() >= 20
    assert clipped_level(few * np.uint16(factor)) == np.inf
    assert clipped_level(picture(240) * np.uint16(factor)) == 240 * factor


@pytest.mark.parametrize("levels", [
    np.full((40, 40), 90, np.uint8), np.zeros((0, 0), int), np.full((9, 9), np.nan), picture(240) > 200,
    np.where(picture(240) > 200, 0.5, 0.0),
])  # fmt: skip
def test_even_pictures_and_numbers_that_are_no_levels_clip_nowhere(levels):
    assert clipped_level(levels) == np.inf


def test_a_picture_of_which_all_but_its_markers_may_be_clipped_is_not_surely():
    y, x = np.indices((120, 160))
    rims = np.clip(np.hypot((x % 40) - 20.3, (y % 40) - 19.6) - 4.0, 0, 1)
    drawn = np.rint(60 + 80 * np.minimum(rims, 1)).astype(np.uint8)
    assert (clipped_level(drawn), clipped_level(drawn, surely=False)) == (np.inf, 140)


@pytest.mark.parametrize("scale", [1.0, 1 / 255])
@pytest.mark.parametrize("noise", [0.0, 0.05, 3.0])
def test_pictures_of_floats_clip_where_noise_ends_at_one_number(scale, noise):
    """A smooth picture with an even plate does not: its second differences do not change their sign at every pixel."""
    y, x = np.indices((240, 320))
    light = 100 + 80 * np.sin(x / 75) * np.cos(y / 65) + noise * np.random.default_rng(5).normal(size=x.shape)
    for kind in (np.float32, np.float64):
        clipped = (np.minimum(light, 160.0) * scale).astype(kind)
        clipped[3, 5:9] = np.nan
        assert clipped_level(clipped) == (np.fmax.reduce(clipped, axis=None) if noise else np.inf)
        assert clipped_level((light * scale).astype(kind)) == np.inf


def test_floats_that_lie_on_levels_clip_as_whole_numbers_do():
    assert clipped_level(picture(240) / 255) == 240 / 255
    assert clipped_level(picture(10_000) / 255) == np.inf


@pytest.mark.parametrize(("noise", "clipped"), [(0.0, False), (0.1, False), (1.0, False)])
def test_an_even_plate_with_hardly_any_noise_is_not_clipped(noise, clipped):
    """Its levels pile up as those of a clipped one do; where noise is more than rounding they do not."""
    rng, (y, x) = np.random.default_rng(3), np.indices((240, 320))
    plate = np.where((np.abs(x - 160) < 120) & (np.abs(y - 120) < 90), 180.3, 20.0)
    edge = np.clip(1.5 - np.hypot(x - 160, y - 120) / 20, 0, 1) * 100
    levels = np.rint(plate - edge + noise * rng.normal(size=x.shape)).astype(np.uint8)
    assert np.isfinite(clipped_level(levels)) == clipped


def test_masks_have_no_saturated_pixels():
    mask = np.where(np.random.default_rng(4).random((40, 50)) < 0.4, 255, 0).astype(np.uint8)
    assert saturation_level(mask) == np.inf
    assert saturation_level(picture(240)) == 240


@pytest.mark.parametrize("times", [1, 4, 16, 12])
def test_bits_that_no_level_has_are_unused(times):
    own = picture(10_000) * np.uint16(times)
    bits = {1: 0, 4: 2, 16: 4, 12: 2}[times]
    assert unused_bits(own) == (bits, bits)
    own[0, :5] += np.uint16(1)  # a number that the camera writes into its first pixels
    assert unused_bits(own) == (bits, bits)


def test_few_levels_and_no_whole_numbers_tell_little_of_their_bits():
    assert unused_bits(np.full((40, 40), 96, np.uint8)) == (0, 5)
    assert unused_bits(picture(10_000).astype(float)) == (0, 8)


@pytest.mark.parametrize(("count", "least"), [(19, 0), (20, 4)])
def test_twenty_levels_are_enough_to_tell_unused_bits(count, least):
    levels = 16 * (1 + np.arange(count, dtype=np.uint16))
    assert unused_bits(levels.repeat(50).reshape(count, 50)) == (least, 4)


@pytest.mark.parametrize(("top", "kind", "level"), [
    (255, np.uint8, 255), (254, np.uint8, 255), (4095, np.uint16, 4095), (4095 << 4, np.uint16, 4095 << 4),
    (4000, np.uint16, 65535), (1.0, float, np.inf),
])  # fmt: skip
def test_full_scale_is_that_of_the_type_or_of_the_bits_that_a_picture_ends_at(top, kind, level):
    assert full_scale(np.array([[0, 7], [12, top]], kind)) == level


def test_pixels_at_the_highest_level_have_no_value():
    """A lone one of the type's full scale, too; clipping below that by what piles up."""
    image = np.full((30, 30), 90, np.uint8)
    image[3, 4] = 255
    light, level = saturated_as_missing(image)
    assert (light.dtype, level, np.flatnonzero(np.isnan(light)).tolist()) == (np.float32, 255, [94])
    clipped = picture(240)
    assert saturation_level(clipped) == 240
    light, level = saturated_as_missing(clipped * 2.0 - 5.0, clipped)
    assert level == 240
    np.testing.assert_array_equal(np.isnan(light), clipped >= 240)


def test_a_picture_below_its_highest_level_is_handed_on_as_it_is():
    image = picture(10_000)
    assert saturated_as_missing(image) == (image, np.inf)
