"""A free network's frame is that of most of the rough table; markers far from their places are named."""

import numpy as np
import pytest

from windmark.calibration.rough_places import held_by_table
from windmark.geometry import Pose
from windmark.geometry.similarity import Similarity

NAMES = [f"m{k:02d}" for k in range(40)]


def rough(rng, sigma=0.5):
    """True places in the network's own frame and scale, and the table's."""
    true = rng.uniform(-300, 300, (40, 3)) * [1, 1, 0.3]
    turn = Pose.from_rotvec([0.2, -0.5, 0.3], [10, 20, 30])
    return true, Similarity(0.01, turn.rotation, turn.translation).apply(true), true + rng.normal(0, sigma, true.shape)


@pytest.mark.parametrize("seed", range(20))
def test_of_a_rough_table_all_hold(seed):
    _, network, table = rough(np.random.default_rng(seed))
    held, doubts = held_by_table(network, table, np.zeros(len(table)), NAMES, "mm", scale=True)
    assert held.all()
    assert doubts == ()


@pytest.mark.parametrize("seed", range(10))
def test_exchanged_rows_are_named_and_hold_nothing(seed):
    rng = np.random.default_rng(seed)
    _, network, table = rough(rng)
    a, b = sorted(rng.choice(40, 2, replace=False).tolist())
    table[[a, b]] = table[[b, a]]
    held, doubts = held_by_table(network, table, np.zeros(len(table)), NAMES, "mm", scale=True)
    assert np.flatnonzero(~held).tolist() == [a, b]
    assert [str(d) for d in doubts] == [f"{NAMES[a]} and {NAMES[b]} are exchanged in the table"]
    assert doubts[0].cause == "swapped"


def test_a_marker_far_from_its_place_is_named_with_how_far():
    _, network, table = rough(np.random.default_rng(3))
    table[7] += [0.0, 30.0, 0.0]
    held, doubts = held_by_table(network, table, np.zeros(len(table)), NAMES, "mm", scale=True)
    assert np.flatnonzero(~held).tolist() == [7]
    assert str(doubts[0]).startswith("m07 is 30 mm from its place in the table, where most are 0.")


def test_few_markers_or_a_table_that_is_all_wrong_hold_as_they_are():
    true, network, table = rough(np.random.default_rng(5))
    table[:4] = table[[1, 0, 2, 3]]
    assert held_by_table(network[:4], table[:4], np.zeros(len(table[:4])), NAMES[:4], "mm", scale=True)[0].all()
    shuffled = table[np.random.default_rng(6).permutation(40)]
    held, _ = held_by_table(network, shuffled, np.zeros(len(shuffled)), NAMES, "mm", scale=True)
    assert 2 * held.sum() > 40
    exact = held_by_table(network, true, np.zeros(len(true)), NAMES, "mm", scale=True)
    assert exact[0].all()


def test_what_the_pictures_hardly_know_is_not_far_from_an_exact_table():
    true, network, _ = rough(np.random.default_rng(7))
    spread = np.full(40, 1e-3)
    spread[9] = 0.05
    table = true + np.random.default_rng(8).normal(0, 1, true.shape) * spread[:, None]
    assert held_by_table(network, table, spread, NAMES, "mm", scale=True)[0].all()
    table[9] += 1.0
    assert np.flatnonzero(~held_by_table(network, table, spread, NAMES, "mm", scale=True)[0]).tolist() == [9]
