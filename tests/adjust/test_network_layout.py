"""The units of a network's parameters, and values that no picture can be of."""

from dataclasses import replace

import networks
import numpy as np
import pytest

from windmark.adjust.network import NetworkProblem, numpy_path
from windmark.adjust.network._arrays import Equations


@pytest.mark.parametrize("to", [1.0, 1e-3])
def test_the_unit_of_length_is_the_root_mean_square_distance_from_the_centroid(to):
    """So a network in metres takes the steps of one in millimetres. Points that no view sees do not count."""
    case = networks.make(5)
    start = replace(case.start, points=to * case.start.points)
    layout = NetworkProblem(case.network, start).layout
    seen = start.points[np.unique(case.network.point)]
    np.testing.assert_allclose(layout.center, seen.mean(axis=0))
    assert layout.unit == pytest.approx(np.sqrt(seen.var(axis=0).sum()))


def test_points_in_one_place_have_the_unit_one():
    case = networks.make(5)
    start = replace(case.start, points=np.zeros_like(case.start.points))
    assert NetworkProblem(case.network, start).layout.unit == 1.0


def test_without_an_image_of_every_point_there_are_no_equations():
    case = networks.make(5)
    problem = NetworkProblem(case.network, case.start)
    behind = replace(case.start, points=case.start.points + np.array([0, 0, 5000.0]))
    lay, count = problem.layout, len(problem.marks.views)
    into = Equations(
        np.zeros((lay.dense, lay.dense)), np.zeros((lay.blocks * lay.size, lay.dense)),
        np.zeros((lay.blocks, lay.size, lay.size)), np.zeros(lay.dense), np.zeros(lay.blocks * lay.size),
    )  # fmt: skip
    assert not numpy_path.accumulate(
        problem.marks, problem.scene(behind), problem.units(behind), lay.columns, np.empty((count, 2)), np.ones(count),
        True, into,
    )  # fmt: skip
    assert not any(part.any() for part in into)
