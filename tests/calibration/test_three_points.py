"""What three known markers that hold a network leave unchecked, and that it is said of a good one."""

from types import SimpleNamespace

import numpy as np
import pytest

from windmark.calibration import Fixed, Free, Weighted
from windmark.calibration.three_points import turn_of_three
from windmark.geometry import align
from windmark.pipeline.verdict.network import _unchecked
from windmark.scene import MarkerSet

MARKERS = MarkerSet.make(["a", "b", "c", "far", "d"], [[0.0, 0, 0], [4, 0, 0], [0, 2, 0], [1, 10, 3], [2, 1, 0]])


def network(datum):
    return SimpleNamespace(markers=MARKERS, options={"datum": datum}, unchecked="")


@pytest.mark.parametrize("datum", [Fixed(["a", "b", "c"]), Weighted(("a", "b", "c")),
                                   Weighted(["a", "b", "c", "no"])])  # fmt: skip
def test_an_error_across_the_plane_of_three_points_moves_the_farthest_marker_most(datum):
    """Turned about a and b, 2 from c: a marker that is 10.4 from that line moves 5.2 times as far as c."""
    turn = turn_of_three(network(datum))
    assert turn.names[0] == "c"
    assert set(turn.names) == {"a", "b", "c"}
    assert turn.marker == "far"
    assert np.isclose(turn.times, np.hypot(10, 3) / 2)
    said, step = _unchecked(network(datum))
    assert "an error of c there turns everything about a and b, and moves far 5.2 times as far" in said
    assert "a fourth known marker" in step


@pytest.mark.parametrize("datum", [Free(), Fixed(), Weighted(), Fixed(["a", "b", "c", "d"])])
def test_of_more_points_or_none_nothing_is_said(datum):
    assert turn_of_three(network(datum)) is None
    assert _unchecked(network(datum)) == ("", "")


def test_the_turn_is_that_of_the_similarity_through_the_three():
    """A marker that is moved across the plane by a small e moves the others by the factor that is told."""
    e, held = 1e-4, [0, 1, 2]
    wrong = MARKERS.xyz[held] + np.array([[0, 0, 0], [0, 0, 0], [0, 0, e]])
    moved = align(MARKERS.xyz[held], wrong).apply(MARKERS.xyz) - MARKERS.xyz
    times = turn_of_three(network(Fixed(["a", "b", "c"]))).times
    assert np.isclose(np.linalg.norm(moved, axis=1).max() / e, times, rtol=1e-3)
