"""Which of three primaries that hold a frame may be the wrong one instead of a fourth that was not recognised."""

from types import SimpleNamespace

import numpy as np

from windmark.calibration import Weighted
from windmark.geometry import Pose
from windmark.scene import MarkerSet
from windmark.tasks.reconstruct.off_table import _as_well

NAMES, TRUE = ["a", "b", "c", "d"], np.array([[0.0, 0, 0], [400, 0, 10], [50, 300, 0], [300, 250, 40]])
OTHERS = np.random.default_rng(3).uniform([-100, -100, 0], [500, 400, 60], (40, 3))


def network(turn, extra=(), held=("a", "b", "c")):
    """The true places turned by a little about an axis; the last one of `TRUE` has no name."""
    xyz = Pose.from_rotvec(turn, [0, 0, 0]).apply(np.vstack([TRUE, OTHERS, *extra]))
    markers = MarkerSet.make(["a", "b", "c", *(f"s{k}" for k in range(len(xyz) - 3))], xyz)
    cov = np.tile(0.02**2 * np.eye(3), (len(xyz), 1, 1))
    return SimpleNamespace(markers=markers, marker_cov=cov, options={"datum": Weighted(held)})


def test_each_without_which_the_others_are_where_the_table_says_is_named():
    """c is 3 across the plane of the three, and turned the network about a and b: a and b fit with d."""
    wrong = TRUE + np.array([[0, 0, 0], [0, 0, 0], [0, 0, 3.0], [0, 0, 0]])
    table = MarkerSet.make(NAMES, wrong, sigma=np.full((4, 3), 0.05))
    assert "c" in _as_well(table, network([0.01, 0, 0]), 3)


def test_a_fourth_that_is_wrong_itself_is_named_alone():
    wrong = TRUE + np.array([[0, 0, 0], [0, 0, 0], [0, 0, 0], [9.0, -11.0, 0]])
    table = MarkerSet.make(NAMES, wrong, sigma=np.full((4, 3), 0.05))
    assert _as_well(table, network([0, 0, 0]), 3) == []


def test_more_than_three_check_each_other():
    table = MarkerSet.make([*NAMES, "e"], np.vstack([TRUE, [[100, 100, 3.0]]]), sigma=np.full((5, 3), 0.05))
    assert _as_well(table, network([0, 0, 0], held=("a", "b", "c", "s0")), 4) == []
