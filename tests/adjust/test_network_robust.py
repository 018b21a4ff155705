"""Graduated weights: a third of wrong observations and a rough start do not pull the values."""

from dataclasses import replace

import networks
import numpy as np
import pytest

from windmark.adjust import SolveOptions, minimise
from windmark.adjust.network import NetworkProblem, graduated

STAGE = SolveOptions(max_iterations=8, gradient_tol=1e-2, initial_damping=1e-4)


def test_a_third_of_wrong_observations():
    case, rng = networks.make(51, views=8, points=30), np.random.default_rng(51)
    net = case.network
    bad = rng.random(len(net.xy)) < 0.3
    xy = net.xy + np.where(bad[:, None], rng.uniform(-80, 80, net.xy.shape), 0.0)
    problem, values, scale = graduated(replace(net, xy=xy), case.start, STAGE, stages=15, settled=0.95)
    residual = problem.residual(values)
    length = np.empty(len(bad))
    length[problem.order] = np.linalg.norm(residual, axis=1)
    assert 0.9 < scale < 2.5
    assert problem.network.loss.name == "cauchy"
    assert (length[bad] > 4 * scale).mean() > 0.9
    assert (length[~bad] < 4 * scale).mean() > 0.95
    # Nearer to the values of the good observations alone than least squares of all.
    best = minimise(NetworkProblem(replace(net, weight=(~bad).astype(float)), case.truth), case.truth)[0]
    pulled = minimise(NetworkProblem(replace(net, xy=xy), case.truth), case.truth)[0]
    focal = [v.cameras[0].focal_px for v in (values, best, pulled)]
    assert abs(focal[0] - focal[1]) < 0.1 * abs(focal[2] - focal[1])


def test_the_scale_has_a_floor():
    case = networks.make(52, noise=0.001)
    network = replace(case.network, cov=np.tile(np.eye(2), (len(case.network.xy), 1, 1)))
    problem, _, scale = graduated(network, case.start, STAGE, stages=8, settled=0.7, least=1.0)
    assert scale < 0.1
    free = graduated(network, case.start, STAGE, stages=8, settled=0.7)[0]
    assert problem.network.loss.scale > 10 * free.network.loss.scale


def test_a_start_without_images_is_refused():
    case = networks.make(53)
    behind = replace(case.start, points=case.start.points + np.array([0, 0, 5000.0]))
    with pytest.raises(ValueError, match="behind a camera"):
        graduated(case.network, behind, STAGE, stages=8, settled=0.7)
