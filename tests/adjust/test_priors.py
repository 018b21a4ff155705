"""What is known besides the pictures, against its residuals written down one by one."""

from dataclasses import replace

import networks
import numpy as np
import pytest

from windmark.adjust.network import Bars, NetworkProblem, NetworkState
from windmark.adjust.network.model import KnownTogether

TOGETHER = np.array([6, 8])


def knowing(away):
    """A rig of which something is known of every kind, at values that are off all of it."""
    case = networks.make(5, views=4, points=10, rig=True, seen=0.9, free=("focal_px", "k1"), eliminate=away)
    rng = np.random.default_rng(5)
    sigma = np.full((10, 3), np.inf)
    sigma[2:5] = rng.uniform(0.4, 3.0, (3, 3))
    sigma[4, 1] = np.inf
    held = np.zeros((10, 3), bool)
    held[0], held[2, 1], held[3, :2] = True, True, True
    length = np.linalg.norm(case.truth.points[[0, 3, 9]] - case.truth.points[[1, 7, 2]], axis=1)
    root = rng.normal(size=(6, 6))
    network = replace(
        case.network, held=held, point_value=case.truth.points, point_sigma=sigma,
        camera_value=[{"focal_px": 1530.0, "k2": 0.0}, {"focal_px": 1500.0, "k1": -0.02}],
        camera_sigma=[{"focal_px": 5.0, "k2": 0.1}, {"focal_px": 4.0, "k1": 0.01}],
        change_sigma=rng.uniform(0.005, 0.02, (8, 3)) * [1, 500, 500], free_change=rng.random((8, 3)) < 0.4,
        bars=Bars(np.array([0, 3, 9]), np.array([1, 7, 2]), length, np.array([0.1, 0.2, 0.3])),
        together=KnownTogether(TOGETHER, case.truth.points[TOGETHER], root),
    )  # fmt: skip
    change = np.where(network.free_change, rng.normal(0, 0.01, (8, 3)) * [1, 500, 500], 0.0)
    return network, replace(case.start, change=change), root


def residuals(network, root, state: NetworkState):
    """All whitened differences to what is known, of the parameters that are free."""
    out = []
    for n in range(len(state.points)):
        for k in range(3):
            if not network.held[n, k] and np.isfinite(network.point_sigma[n, k]):
                out.append((state.points[n, k] - network.point_value[n, k]) / network.point_sigma[n, k])
    out += list(root @ (state.points[TOGETHER] - network.point_value[TOGETHER]).ravel())
    for camera, free, value, sigma in zip(
        state.cameras, network.free_camera, network.camera_value, network.camera_sigma, strict=True
    ):
        out += [(getattr(camera, name) - value[name]) / sigma[name] for name in sigma if name in free]
    for v, k in np.argwhere(network.free_change):
        out.append(state.change[v, k] / network.change_sigma[v, k])
    bars = network.bars
    for a, b, length, sigma in zip(bars.first, bars.second, bars.length, bars.sigma, strict=True):
        out.append((np.linalg.norm(state.points[a] - state.points[b]) - length) / sigma)
    return np.array(out)


@pytest.mark.parametrize("away", ["points", "frames"])
def test_cost_gradient_and_information_are_those_of_the_residuals(away):
    network, start, root = knowing(away)
    problem = NetworkProblem(network, start)
    r = residuals(network, root, start)
    assert problem.prior_cost(start) == pytest.approx(0.5 * r @ r, rel=1e-12)
    lay, n = problem.layout, problem.size
    h_dd, h_ee = np.zeros((lay.dense, lay.dense)), np.zeros((lay.blocks, lay.size, lay.size))
    g_d, g_e = np.zeros(lay.dense), np.zeros(lay.blocks * lay.size)
    problem._priors(start, problem.units(start), (h_dd, h_ee, g_d, g_e))
    columns = []
    for step in 1e-6 * np.eye(n):
        ahead, behind = (residuals(network, root, problem.retract(start, s * step)) for s in (1, -1))
        columns.append((ahead - behind) / 2e-6)
    j = np.stack(columns, axis=1)
    scale = np.abs(j.T @ r).max()
    np.testing.assert_allclose(np.concatenate([g_d, g_e]) / scale, j.T @ r / scale, atol=1e-7)
    expected = j.T @ j
    # A distance bends, too: the information is of first order only, as Gauss and Newton have it.
    got = np.triu(h_dd) + np.triu(h_dd, 1).T
    scale = np.abs(expected).max()
    np.testing.assert_allclose(got / scale, expected[: lay.dense, : lay.dense] / scale, atol=1e-7)
    for e, block in enumerate(h_ee):
        own = slice(lay.dense + e * lay.size, lay.dense + (e + 1) * lay.size)
        np.testing.assert_allclose(block / scale, expected[own, own] / scale, atol=1e-7)


@pytest.mark.parametrize("away", ["points", "frames"])
def test_the_whole_cost_is_that_of_the_pictures_and_of_what_is_known(away):
    network, start, root = knowing(away)
    problem = NetworkProblem(network, start)
    seen, r = problem.residual(start), residuals(network, root, start)
    expected = 0.5 * (np.vdot(seen, seen) + r @ r)
    assert problem.cost(start) == pytest.approx(expected, rel=1e-12)
    assert problem.linearise(start).cost == pytest.approx(expected, rel=1e-12)
