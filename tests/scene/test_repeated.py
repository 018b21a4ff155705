"""Pictures that are one, by their spots."""

from itertools import pairwise

import numpy as np
import pytest

from windmark.scene.repeated import is_repeated, repeated_views


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


@pytest.mark.parametrize("labelled", [True, False])
def test_of_many_pictures_each_copy_has_its_original(labelled):
    """Three times one, twice another, most spots of a third; some share single places by chance."""
    rng = np.random.default_rng(3)
    view, point = np.repeat(np.arange(12), 50), np.tile(np.arange(50), 12)
    xy, cov = rng.uniform(0, 900, (600, 2)), np.tile(1e-4 * np.eye(2), (600, 1, 1))
    for copy, original, part in ((5, 2, 1.0), (7, 2, 1.0), (9, 1, 0.9), (11, 3, 0.5)):
        same = rng.random(50) <= part
        xy[view == copy] = np.where(same[:, None], xy[view == original] + rng.uniform(-4e-4, 4e-4, (50, 2)),
                                    xy[view == copy])  # fmt: skip
    order = rng.permutation(600)
    found = repeated_views(view[order], point[order] if labelled else None, xy[order], cov[order])
    assert found == {5: 2, 7: 2, 9: 1}
    nothing = np.zeros(0, np.int64)
    assert repeated_views(nothing, nothing, np.zeros((0, 2)), np.zeros((0, 2, 2))) == {}
