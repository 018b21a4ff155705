"""Pictures that are one, by their spots."""

from itertools import pairwise

import numpy as np
import pytest

from windmark.scene.repeated import is_repeated


@pytest.mark.parametrize(("count", "moved", "expected"), [(6, 1, True), (6, 2, False), (5, 0, False), (40, 10, True)])
def test_a_picture_is_another_one_where_most_spots_are_the_same_but_for_a_tenth_of_their_noise(count, moved, expected):
    rng = np.random.default_rng(count)
    xy = rng.uniform(0, 500, (count, 2))
    again = xy + rng.uniform(-0.09, 0.09, xy.shape) * 0.02
    again[:moved] += 0.5
    order = rng.permutation(count)
    assert is_repeated(np.arange(count), xy, np.arange(count)[order], again[order], 0.02) == expected


def test_the_same_scene_with_noise_of_its_own_is_no_copy():
    rng = np.random.default_rng(2)
    xy, every = rng.uniform(0, 500, (6, 2)), np.arange(6)
    noisy = [xy + rng.normal(0, 0.02, xy.shape) for _ in range(200)]
    assert not any(is_repeated(every, a, every, b, 0.02) for a, b in pairwise(noisy))
    assert not is_repeated(every, xy, every + 9, xy, 0.02)
