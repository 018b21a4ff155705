"""The network: derivatives, kernels and NumPy, Schur complement, gauge, priors, and the minimum."""

from dataclasses import replace

import networks
import numpy as np
import pytest

from windmark.adjust.levenberg_marquardt import SolveOptions, minimise
from windmark.adjust.loss import Loss
from windmark.adjust.network import Bars, Network, NetworkProblem, numpy_path
from windmark.adjust.network import _block_kernels as block_kernels
from windmark.adjust.network import _kernels as kernels
from windmark.adjust.network._arrays import ROOM, Equations
from windmark.geometry.camera import LENS_PARAMETERS

ALL = (*networks.NAMES, "k3", "tilt_x", "tilt_y", "shear")


def variant(name):
    """Networks of every kind."""
    if name == "points out":
        return networks.make(1, free=ALL, eliminate="points")
    if name == "frames out":
        return networks.make(2, free=("focal_px", "k1"), eliminate="frames")
    if name == "rig":
        return networks.make(3, rig=True, eliminate="points")
    if name in WIDE:
        return networks.make(5, free=WIDE_FREE[name], camera=WIDE[name], eliminate="points")
    if name == "rig, frames out":
        return networks.make(3, rig=True, eliminate="frames")
    case = networks.make(4, views=5, points=12)
    held = np.zeros((12, 3), bool)
    held[0], held[1, :2] = True, True
    sigma = np.full((12, 3), np.inf)
    sigma[4:6] = 0.5
    known = [{"focal_px": 1530.0, "k2": 0.05}]
    bars = Bars(np.array([2, 0]), np.array([3, 7]), np.array([200.0, 150.0]), np.array([0.1, 0.2]))
    network = replace(
        case.network, held=held, point_value=case.truth.points, point_sigma=sigma, bars=bars, loss=Loss("cauchy", 2.0),
        camera_value=known, camera_sigma=[{"focal_px": 5.0, "k2": 0.01}],
        free_change=np.array([[0, 0, 0], [1, 1, 1], [0, 1, 0], [1, 0, 1], [1, 0, 0]], bool),
        change_sigma=np.tile([0.01, 4.0, 6.0], (5, 1)), eliminate="points",
    )  # fmt: skip
    return replace_network(case, network)


def replace_network(case, network):
    return networks.Case(network, case.truth, case.start)


NUMERATOR_HELD = ("focal_px", "aspect", "cx", "cy", "p1", "p2")
WIDE = {
    "rational": replace(networks.CAMERA, k4=0.1, k5=0.2, k6=-0.3, lens="rational"),
    "fisheye": replace(networks.CAMERA, p1=0.0, p2=0.0, k3=0.1, k4=-0.2, lens="fisheye"),
}
# Numerator and denominator of a narrow rational lens are all but the same: not both are free.
WIDE_FREE = {"rational": (*NUMERATOR_HELD, "k4", "k5", "k6"), "fisheye": LENS_PARAMETERS["fisheye"]}
VARIANTS = ("points out", "frames out", "rig", "rig, frames out", *WIDE, "everything")


@pytest.mark.parametrize("name", VARIANTS)
def test_gradient_is_that_of_the_cost(name):
    case = variant(name)
    problem = NetworkProblem(replace(case.network, loss=Loss()), case.start)
    system = problem.linearise(case.start)
    gradient = np.concatenate([system.g_d, system.g_e])
    rng = np.random.default_rng(0)
    for _ in range(6):
        direction = rng.normal(size=len(gradient))
        h = 1e-6
        ahead, behind = (problem.cost(problem.retract(case.start, s * h * direction)) for s in (1, -1))
        slope = (ahead - behind) / (2 * h)
        assert slope == pytest.approx(gradient @ direction, rel=2e-5, abs=1e-4 * np.linalg.norm(gradient))


@pytest.mark.parametrize("name", VARIANTS)
def test_information_is_the_jacobian_squared(name):
    case = variant(name)
    problem = NetworkProblem(replace(case.network, loss=Loss()), case.start)
    bare = NetworkProblem(without_knowledge(problem.network), case.start).linearise(case.start)
    n, d = len(bare.g_d) + len(bare.g_e), len(bare.g_d)
    h = 1e-6
    columns = []
    for k in range(n):
        step = np.zeros(n)
        step[k] = h
        ahead, behind = (problem.residual(problem.retract(case.start, s * step)).ravel() for s in (1, -1))
        columns.append((ahead - behind) / (2 * h))
    j = np.stack(columns, axis=1)
    expected = j.T @ j
    got = np.triu(bare.h_dd)
    got = got + np.triu(got, 1).T
    scale = np.sqrt(np.outer(np.diagonal(expected), np.diagonal(expected))) + 1e-6
    np.testing.assert_allclose(got / scale[:d, :d], expected[:d, :d] / scale[:d, :d], atol=2e-5)
    np.testing.assert_allclose(bare.h_ed / scale[d:, :d], expected[d:, :d] / scale[d:, :d], atol=2e-5)


def without_knowledge(network: Network) -> Network:
    """The same numbering, nothing but the pictures."""
    weak = replace(network.bars, sigma=np.full(len(network.bars.sigma), 1e12))
    return replace(
        network, bars=weak, point_sigma=None, point_value=None, camera_sigma=(), camera_value=(), change_sigma=None
    )


@pytest.mark.parametrize("name", VARIANTS)
def test_kernels_and_numpy_agree(name):
    case = variant(name)
    problem = NetworkProblem(case.network, case.start)
    scene, units, columns = problem.scene(case.start), problem.units(case.start), problem.layout.columns
    lay, o = problem.layout, len(problem.marks.views)
    weight = np.random.default_rng(1).uniform(0.2, 1, o)
    results = []
    for code in (kernels, numpy_path):
        r = np.empty((o, 2))
        assert code.residuals(problem.marks, scene, r)
        into = Equations(
            np.zeros((lay.dense, lay.dense)), np.zeros((lay.blocks * lay.size, lay.dense)),
            np.zeros((lay.blocks, lay.size, lay.size)), np.zeros(lay.dense), np.zeros(lay.blocks * lay.size),
        )  # fmt: skip
        again = np.empty((o, 2))
        assert code.accumulate(problem.marks, scene, units, columns, again, weight, True, into)
        np.testing.assert_allclose(again, r, rtol=1e-12)
        jd, je = np.zeros((o, 2, ROOM)), np.zeros((o, 2, lay.size))
        cols, block = np.zeros((o, ROOM), np.int64), np.zeros(o, np.int64)
        code.jacobian_rows(problem.marks, scene, units, columns, jd, je, cols, block)
        # One row per observation over all dense columns: the order of the columns is the code's own.
        dense = np.zeros((o, 2, lay.dense + 1))
        np.put_along_axis(dense, np.broadcast_to(cols[:, None], jd.shape), jd, axis=2)
        results.append((r, *into, dense[..., : lay.dense], je, block))
    for got, expected in zip(*results, strict=True):
        np.testing.assert_allclose(got, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_blocks_of_kernel_and_numpy_agree():
    rng = np.random.default_rng(2)
    root = rng.normal(size=(7, 3, 5))
    h = root @ root.transpose(0, 2, 1)
    floor, w, y = rng.uniform(1, 2, (7, 3)), rng.normal(size=(21, 4)), rng.normal(size=21)
    out = []
    for code in (block_kernels, numpy_path):
        a, b, c = h.copy(), w.copy(), y.copy()
        assert code.factor_blocks(a, floor, 0.1, b, c)
        out.append((np.tril(a), b, c))
    for got, expected in zip(*out, strict=True):
        np.testing.assert_allclose(got, expected, rtol=1e-10)
    h[3] = 0
    for code in (block_kernels, numpy_path):
        assert not code.factor_blocks(h.copy(), floor, 0.0, w.copy(), y.copy())


@pytest.mark.parametrize("name", VARIANTS)
def test_step_solves_the_whole_system(name):
    case = variant(name)
    problem = NetworkProblem(case.network, case.start)
    system = problem.linearise(case.start)
    d = len(system.g_d)
    whole, _ = networks.whole(system)
    gradient = np.concatenate([system.g_d, system.g_e])
    damping = 0.05
    damped = whole + np.diag(damping * np.maximum(np.diagonal(whole), 1.0))
    held = system.gauge.dense
    basis = np.linalg.qr(held)[0] if held.shape[1] else held
    damped[:d, :d] += basis @ basis.T * np.median(np.maximum(np.diagonal(system.h_dd), 1.0))
    expected = -np.linalg.solve(damped, gradient)
    step = system.solve(damping)
    np.testing.assert_allclose(step.delta, expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max())
    assert step.decrease == pytest.approx(-(gradient @ expected + 0.5 * expected @ whole @ expected), rel=1e-3)


@pytest.mark.parametrize("name", VARIANTS[1:])
def test_decrement_is_that_of_the_whole_system(name):
    """By the matrix of one state and the gradient of another."""
    case = variant(name)
    problem = NetworkProblem(case.network, case.start)
    system = problem.linearise(case.start)
    moved = problem.retract(case.start, 1e-4 * np.random.default_rng(3).normal(size=len(system.g_d) + len(system.g_e)))
    other = problem.linearise(moved)
    assert system.decrement(other) == np.inf
    assert system.solve(0.0) is not None
    gradient = np.concatenate([other.g_d, other.g_e])
    matrix, motions = networks.whole(system)
    basis = np.linalg.qr(motions)[0]
    whole = matrix + basis @ basis.T * np.median(np.diagonal(matrix))
    across = gradient - basis @ (basis.T @ gradient)
    assert system.decrement(other) == pytest.approx(np.sqrt(across @ np.linalg.solve(whole, across)), rel=1e-3)


@pytest.mark.parametrize(("name", "free"), [("points out", 7), ("frames out", 7), ("rig", 7), ("everything", 0)])
def test_free_motions_change_no_picture(name, free):
    case = variant(name)
    problem = NetworkProblem(case.network, case.start)
    gauge = problem.linearise(case.start).gauge
    assert gauge.dense.shape[1] == free
    before = problem.residual(case.start)
    for motion in np.concatenate([gauge.dense, gauge.blocks]).T:
        h = 1e-6 / np.abs(motion).max()
        change = (problem.residual(problem.retract(case.start, h * motion)) - before) / h
        assert np.abs(change).max() < 1.0  # in sigma per natural unit, where any other motion gives thousands


@pytest.mark.parametrize("away", ["points", "frames"])
@pytest.mark.parametrize("seed", [5, 6])
def test_both_eliminations_reach_the_same_minimum(away, seed):
    case = networks.make(seed)
    options = SolveOptions(gradient_tol=1e-4)
    costs = []
    for eliminate in (away, "auto"):
        network = replace(case.network, eliminate=eliminate)
        values, _, report = minimise(NetworkProblem(network, case.start), case.start, options)
        assert report.converged
        costs.append(report.final_cost)
    assert costs[0] == pytest.approx(costs[1], rel=1e-6)
    dof = 2 * len(case.network.xy) - 8 - 6 * 8 - 3 * 25 + 7
    assert 0.7 * dof < 2 * costs[0] < 1.35 * dof
    assert values.cameras[0].focal_px == pytest.approx(1530, abs=6)


def test_a_rig_is_found():
    case = networks.make(7, rig=True)
    values, _, report = minimise(NetworkProblem(case.network, case.start), case.start)
    assert report.converged
    off = (values.offsets @ case.truth.offsets.inverse()).log()[1]
    # The scale is free: only the direction of the base is known.
    base = values.offsets.translation[1] / np.linalg.norm(values.offsets.translation[1])
    true = case.truth.offsets.translation[1] / np.linalg.norm(case.truth.offsets.translation[1])
    assert np.abs(off[:3]).max() < 5e-3
    assert np.abs(base - true).max() < 5e-3


def test_known_distances_and_points_fix_the_scale():
    case = networks.make(8)
    first, second = np.array([0, 1, 2]), np.array([5, 6, 7])
    length = np.linalg.norm(case.truth.points[first] - case.truth.points[second], axis=1)
    bars = Bars(first, second, length, np.full(3, 1e-3))
    network = replace(case.network, bars=bars)
    problem = NetworkProblem(network, case.start)
    # What is known to 1e-5 of the size must not hide, by rounding, what is not known at all.
    assert problem.linearise(case.start).gauge.dense.shape[1] == 6
    values, system, report = minimise(problem, case.start)
    assert report.converged
    assert system.gauge.dense.shape[1] == 6
    got = np.linalg.norm(values.points[first] - values.points[second], axis=1)
    np.testing.assert_allclose(got, length, atol=0.02)
    others = np.linalg.norm(values.points[10:12] - values.points[12:14], axis=1)
    true = np.linalg.norm(case.truth.points[10:12] - case.truth.points[12:14], axis=1)
    np.testing.assert_allclose(others, true, atol=0.5)


def test_changes_of_single_views():
    """Focal length, principal point, or both."""
    case = networks.make(9, views=8, points=30)
    change = np.zeros((8, 3))
    change[2, 0], change[5, 1:], change[6] = 0.01, (7.0, -4.0), (-0.015, 2.0, 9.0)
    truth = replace(case.truth, change=change)
    net = case.network
    xy, _ = networks.project(truth, net.view_frame, net.view_offset, net.view_camera, net.view, net.point)
    network = replace(net, xy=xy, free_change=change != 0)
    values, _, report = minimise(NetworkProblem(network, case.start), case.start)
    assert report.converged
    np.testing.assert_allclose(values.change / [1.0, 1500.0, 1500.0], change / [1.0, 1500.0, 1500.0], atol=1e-5)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"view": np.array([99])}, "view"),
        ({"eliminate": "cameras"}, "eliminate"),
        ({"free_camera": (("focus",),)}, "focus"),
        ({"held": np.zeros((3, 2), bool)}, "held"),
    ],
)
def test_wrong_networks_are_named(change, word):
    network = networks.make(1).network
    if "view" in change:
        change = {"view": np.where(np.arange(len(network.view)) == 0, 99, network.view)}
    with pytest.raises(ValueError, match=word):
        replace(network, **change)


@pytest.mark.parametrize(
    ("name", "least", "size"),
    [("view", 0, 8), ("point", 0, 25), ("view_camera", 0, 1), ("view_frame", 0, 8), ("view_offset", -1, 0)],
)
def test_indices_must_be_there(name, least, size):
    network = networks.make(1).network
    for wrong in (least - 1, size):
        index = getattr(network, name).copy()
        index[0] = wrong
        with pytest.raises(ValueError, match=rf"Network: {name} must be {least} \.\.\. {size - 1}, got"):
            replace(network, **{name: index})
    index = getattr(network, name).copy()
    index[:2] = least, size - 1
    assert replace(network, **{name: index})


@pytest.mark.parametrize("wrong", [{"second": [0]}, {"sigma": [0.0]}, {"length": [np.nan]}, {"length": [1.0, 2.0]}])
def test_wrong_bars_are_named(wrong):
    good = {"first": [0], "second": [1], "length": [1.0], "sigma": [0.1]} | wrong
    with pytest.raises(ValueError, match="Bars"):
        Bars(*(np.array(good[name]) for name in ("first", "second", "length", "sigma")))
