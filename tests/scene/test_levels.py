"""Where a picture clips, by its levels."""

import numpy as np
import pytest

from windmark.scene.levels import clipped_level


def picture(top):
    levels = np.random.default_rng(1).normal(200, 30, (80, 100))
    return np.minimum(np.maximum(levels, 0), top).astype(np.uint16)


def test_a_plateau_below_the_largest_number_is_where_it_clips():
    assert clipped_level(picture(240)) == 240
    assert clipped_level(picture(10_000)) == np.inf


@pytest.mark.parametrize("levels", [np.full((40, 40), 90, np.uint8), picture(240).astype(float), np.zeros((0, 0), int)])
def test_even_pictures_and_numbers_that_are_no_levels_clip_nowhere(levels):
    assert clipped_level(levels) == np.inf
