"""The paper's growing and shrinking steps on networks: the same minimum, at another price."""

from dataclasses import replace

import networks
import numpy as np
import pytest

from windmark.adjust import PaperOptions, minimise
from windmark.adjust.network import Bars, NetworkProblem, minimise_network_by_steps


def held(case, count):
    """Some markers do not move; the cameras are known."""
    fixed = case.network.held.copy()
    fixed[:count] = True
    points = np.where(fixed, case.truth.points, case.start.points)
    return replace(case.network, held=fixed), replace(case.start, points=points, cameras=case.truth.cameras)


def test_poses_and_markers_reach_the_minimum():
    network, start = held(networks.make(3, views=4, points=12, seen=1.0, free=()), 8)
    problem = NetworkProblem(network, start)
    exact, _, newton = minimise(problem, start)
    found, steps = minimise_network_by_steps(problem, start, PaperOptions(step_tol=1e-7))
    assert steps.reason == "converged_step"
    assert steps.final_cost == pytest.approx(newton.final_cost, rel=1e-7)
    assert steps.final_cost >= newton.final_cost * (1 - 1e-12)
    assert np.abs(found.points - exact.points).max() < 1e-3
    assert newton.evaluations < 10
    assert steps.evaluations > 50 * newton.evaluations


def with_everything(seed):
    """A rig with priors and known distances, some of its focal lengths changed."""
    case = networks.make(seed, views=4, points=10, rig=True, seen=0.9, free=("focal_px", "k1"))
    net, rng = case.network, np.random.default_rng(seed)
    sigma = np.full((10, 3), np.inf)
    sigma[2:6] = 0.5
    length = np.linalg.norm(case.truth.points[[0, 3]] - case.truth.points[[1, 7]], axis=1)
    network = replace(
        net, point_value=case.truth.points, point_sigma=sigma, camera_value=[{"focal_px": 1530.0}] * 2,
        camera_sigma=[{"focal_px": 5.0}] * 2, change_sigma=np.tile([0.01, 5.0, 5.0], (8, 1)),
        free_change=rng.random((8, 3)) < 0.4,
        bars=Bars(np.array([0, 3]), np.array([1, 7]), length, np.full(2, 0.01)),
    )  # fmt: skip
    return network, replace(case.start, change=np.zeros((8, 3)))


@pytest.mark.parametrize("away", ["points", "frames"])
def test_the_cost_that_is_kept_is_that_of_the_values(away):
    network, start = with_everything(5)
    problem = NetworkProblem(replace(network, eliminate=away), start)
    found, report = minimise_network_by_steps(problem, start, PaperOptions(max_passes=6))
    assert report.reason == "max_iterations"
    assert report.initial_cost == pytest.approx(problem.cost(start), rel=1e-12)
    assert report.final_cost == pytest.approx(problem.cost(found), rel=1e-9)
    assert report.final_cost < report.initial_cost
    # What is free moved, what is not did not.
    free = network.free_change
    assert (found.change[free] != 0).all()
    assert (found.change[~free] == 0).all()
    np.testing.assert_array_equal(found.offsets.translation[0], start.offsets.translation[0])
    assert (found.offsets.translation[1] != start.offsets.translation[1]).any()


def test_all_at_once_is_one_after_the_other():
    network, start = held(networks.make(7, views=3, points=9, seen=1.0, free=("focal_px",)), 4)
    problem, options = NetworkProblem(network, start), PaperOptions(max_passes=3)
    found, report = minimise_network_by_steps(problem, start, options)
    lay = problem.layout
    assert lay.dense in (1 + 6 * 3, 1 + 3 * 5)
    frame, point = (lay.dense, 1) if lay.size == 6 else (1, lay.dense)
    order = [frame + 6 * v + k for k in range(6) for v in range(3)] + [0]
    order += [point + 3 * p + k for k in range(3) for p in range(5)]
    state, steps = start, np.full(problem.size, options.initial_step)
    for _ in range(3):
        for n in order:
            for _ in range(options.tries):
                delta = np.zeros(problem.size)
                delta[n] = steps[n]
                trial = problem.retract(state, delta)
                if problem.cost(trial) < problem.cost(state):
                    state, steps[n] = trial, steps[n] * options.grow
                else:
                    steps[n] *= -options.shrink
    np.testing.assert_allclose(found.points, state.points, rtol=1e-9, atol=1e-7)
    np.testing.assert_allclose(found.frames.translation, state.frames.translation, rtol=1e-9)
    assert found.cameras[0].focal_px == pytest.approx(state.cameras[0].focal_px, rel=1e-12)
    assert report.final_cost == pytest.approx(problem.cost(state), rel=1e-9)


def test_a_start_without_images_is_refused():
    case = networks.make(3)
    behind = replace(case.start, points=case.start.points + np.array([0, 0, 5000.0]))
    problem = NetworkProblem(case.network, behind)
    with pytest.raises(ValueError, match="start"):
        minimise_network_by_steps(problem, behind)
