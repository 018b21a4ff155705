"""What moved as a whole between the pictures is named, though each of its markers tells too little alone."""

from dataclasses import replace

import numpy as np
import pytest

from windmark.scene import MarkerSet
from windmark.tasks.reconstruct.doubts import Sight
from windmark.tasks.reconstruct.two_places import two_places

VIEWS, RATE = 6, 0.85
STEP = np.array([0.4, 0.0, 3.0])


def scene(rng, moved, step=STEP, sides=None):
    """A plate of 60 markers in six pictures; of the ``moved`` each is two, one in every second picture."""
    xyz = rng.uniform(-300, 300, (60, 3)) * [1, 1, 0.02]
    seen = rng.random((VIEWS, 60)) < RATE
    first = np.arange(VIEWS) % 2 == 0
    twins, shown = [xyz[:0]], [seen[:, :0]]
    for k in range(moved):
        side = first if sides is None else sides[k]
        twins.append(xyz[k] + (step if np.ndim(step) == 1 else step[k]))
        shown.append(rng.random(VIEWS) < RATE)
        seen[:, k], shown[-1] = seen[:, k] & side, (shown[-1] & ~side)[:, None]
    markers = MarkerSet.make([f"m{k:02d}" for k in range(60 + moved)], np.vstack([xyz, *twins]))
    seen = np.hstack([seen, *shown])
    # Pictures lie in pairs: of the three that should show the other place, each has one picture from its side.
    alike = np.kron(np.eye(VIEWS // 2), np.ones((2, 2))) > 0
    return markers, Sight(seen, np.ones_like(seen), alike, around(VIEWS), RATE)


def around(count):
    """Places of pictures round the plate, two and two beside each other."""
    angle = 2 * np.pi * (np.arange(count) // 2) / (count // 2) + 0.2 * (np.arange(count) % 2)
    return np.stack([900 * np.cos(angle), 900 * np.sin(angle), np.full(count, 2500.0)], axis=1)


def named(doubts):
    return {name for doubt in doubts for name in doubt.names}


@pytest.mark.parametrize("seed", range(8))
def test_a_flap_that_moved_is_named_as_a_whole(seed):
    markers, sight = scene(np.random.default_rng(seed), 8)
    found = named(two_places(markers, sight))
    assert found <= {f"m{k:02d}" for k in [*range(8), *range(60, 68)]}
    assert len(found) >= 8


@pytest.mark.parametrize("seed", range(8))
def test_one_pair_in_so_few_pictures_is_chance(seed):
    markers, sight = scene(np.random.default_rng(seed), 1)
    assert two_places(markers, sight) == []


@pytest.mark.parametrize("seed", range(8))
def test_pairs_that_divide_the_pictures_and_lie_in_ways_of_their_own_are_no_group(seed):
    rng = np.random.default_rng(seed)
    steps = rng.normal(size=(4, 3))
    steps *= 30 * 2.0 ** np.arange(4)[:, None] / np.linalg.norm(steps, axis=1, keepdims=True)
    sides = [np.isin(np.arange(VIEWS), s) for s in ([0, 2, 4], [0, 3, 4], [1, 2, 4], [0, 3, 5])]
    markers, sight = scene(rng, 4, steps, sides)
    assert two_places(markers, sight) == []


@pytest.mark.parametrize("seed", range(8))
def test_markers_that_are_missed_at_random_are_no_doubt(seed):
    rng = np.random.default_rng(100 + seed)
    markers, sight = scene(rng, 0)
    assert two_places(markers, sight) == []
    poor = rng.random(sight.seen.shape) < 0.4
    assert two_places(markers, replace(sight, seen=sight.seen & poor, rate=0.34)) == []


@pytest.mark.parametrize("seed", range(8))
def test_what_is_hidden_from_one_side_has_not_moved(seed):
    """The pictures that show the one are taken from the left, those of the other from the right of something before."""
    markers, sight = scene(np.random.default_rng(seed), 8)
    place = sight.place.copy()
    place[:, 0] = np.where(np.arange(VIEWS) % 2 == 0, -300.0, 300.0)
    assert two_places(markers, replace(sight, place=place)) == []
