"""Covariances of networks: against the whole matrix, between datums, and against the scatter of many solutions."""

from dataclasses import replace

import networks
import numpy as np
import pytest

from windmark.adjust.levenberg_marquardt import minimise
from windmark.adjust.network import NetworkProblem, linear, numpy_path
from windmark.adjust.network.covariance import network_covariance
from windmark.adjust.network.datum import in_datum
from windmark.geometry import DegenerateGeometry, Pose
from windmark.geometry.similarity import Similarity, align


def solved(case):
    problem = NetworkProblem(case.network, case.start)
    values, system, report = minimise(problem, case.start)
    assert report.converged
    return problem, values, system


def inner(information, motions, condition):
    """Covariance under condition^T dx = 0, by the bordered matrix."""
    n, g = motions.shape
    border = np.zeros((n + g, n + g))
    border[:n, :n], border[:n, n:], border[n:, :n] = information, condition, condition.T
    return np.linalg.inv(border)[:n, :n]


@pytest.mark.parametrize("away", ["points", "frames"])
def test_any_datum_is_that_of_the_bordered_matrix(away):
    case = networks.make(11, points=15, eliminate=away)
    problem, _, system = solved(case)
    cov = network_covariance(system, problem.layout)
    information, motions = networks.whole(system)
    lay = problem.layout
    for points in (None, np.arange(15) % 3 == 0):
        datum = in_datum(cov, points)
        condition = np.zeros_like(motions)
        for p in range(15) if points is None else np.flatnonzero(points):
            at = lay.dense + 3 * lay.columns.point_block[p] if away == "points" else lay.columns.point[p]
            condition[at : at + 3] = motions[at : at + 3]
        expected = inner(information, motions, condition)
        got = datum.points()
        for p in range(15):
            at = lay.dense + 3 * lay.columns.point_block[p] if away == "points" else lay.columns.point[p]
            want = expected[at : at + 3, at : at + 3] * lay.unit**2
            np.testing.assert_allclose(got[p], want, rtol=2e-4, atol=1e-6 * np.abs(want).max())
        d = lay.dense
        np.testing.assert_allclose(datum.dense(), expected[:d, :d], rtol=1e-3, atol=1e-6 * np.abs(expected).max())
        seen = information @ np.random.default_rng(1).normal(size=(len(information), 3))  # pictures tell no free motion
        want = expected @ seen
        np.testing.assert_allclose(datum.through(seen), want, atol=1e-4 * np.abs(want).max())


@pytest.mark.parametrize("away", ["points", "frames"])
def test_marginal_of_single_parameters_is_that_of_the_whole_matrix(away):
    problem, _, system = solved(networks.make(12, points=15, eliminate=away))
    cov = network_covariance(system, problem.layout)
    d, size = len(cov.dense), cov.blocks.shape[1]
    every = cov.product(np.eye(d + len(cov.half)))
    block = d + 2 * size + np.arange(size)
    some, rows = np.random.default_rng(2).normal(size=(len(every), 4)), np.array([3, 0])
    upper, form = cov.quadratic(some, rows)
    np.testing.assert_allclose(upper, every[rows] @ some, rtol=1e-9, atol=1e-9 * np.abs(every @ some).max())
    np.testing.assert_allclose(form, some.T @ every @ some, rtol=1e-9, atol=1e-9 * np.abs(form).max())
    product = sum(half.T @ half for half in cov.rooted(some))
    np.testing.assert_allclose(product, form, rtol=1e-9, atol=1e-9 * np.abs(form).max())
    gone = replace(cov, dense=cov.dense - 2 * np.linalg.eigvalsh(cov.dense)[0] * np.eye(d))  # no factor any more
    np.testing.assert_allclose(
        gone.quadratic(some, rows)[1], some.T @ gone.product(some), atol=1e-3 * np.abs(form).max()
    )
    for index in (np.array([1, 4, 7]), block, np.concatenate([[0, 3], block[[2, 0]]])):
        np.testing.assert_allclose(cov.marginal(index), every[np.ix_(index, index)], rtol=1e-7, atol=1e-18)
    with pytest.raises(ValueError, match="one block"):
        cov.marginal(np.array([d, d + size]))


def test_interior_parameters_are_the_same_in_every_datum():
    case = networks.make(12)
    problem, _, system = solved(case)
    cov = network_covariance(system, problem.layout)
    some = in_datum(cov, np.arange(25) < 6).dense()[:8, :8]
    np.testing.assert_allclose(in_datum(cov).dense()[:8, :8], some, rtol=1e-6)
    np.testing.assert_allclose(cov.dense[:8, :8], some, rtol=1e-6)


def test_points_of_the_datum_are_the_best_known():
    case = networks.make(13)
    problem, _, system = solved(case)
    cov = network_covariance(system, problem.layout)
    every, few = in_datum(cov).points(), in_datum(cov, np.arange(25) < 4).points()
    trace = [np.trace(c, axis1=1, axis2=2).sum() for c in (every, few)]
    assert trace[0] < trace[1]
    assert np.trace(few[:4], axis1=1, axis2=2).sum() < np.trace(every[:4], axis1=1, axis2=2).sum()


def test_held_coordinates_have_no_variance_and_the_others_all():
    case = networks.make(14)
    held = np.zeros((25, 3), bool)
    held[:3], held[3, 2] = True, True
    network = replace(case.network, held=held)
    start = replace(case.start, points=np.where(held, case.truth.points, case.start.points))
    problem, values, system = solved(networks.Case(network, case.truth, start))
    assert (values.points[held] == case.truth.points[held]).all()
    cov = in_datum(network_covariance(system, problem.layout)).points()
    sigma = np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
    assert (sigma[held] == 0).all()
    assert (sigma[~held] > 0).all()


@pytest.mark.parametrize("away", ["points", "frames"])
def test_scatter_of_many_solutions_is_the_covariance(away):
    """Aligned to the truth (inner constraints over all points), 80 solutions; chi-square per point and interior."""
    case = networks.make(15, points=20, views=8, noise=0.1, eliminate=away)
    net, rng = case.network, np.random.default_rng(0)
    exact, _ = networks.project(case.truth, net.view_frame, net.view_offset, net.view_camera, net.view, net.point)
    at_points, at_lens = [], []
    for _ in range(80):
        noisy = replace(net, xy=exact + rng.normal(0, 0.1, exact.shape))
        problem = NetworkProblem(noisy, case.truth)
        values, system, _ = minimise(problem, case.truth)
        cov = network_covariance(system, problem.layout)
        moved = align(values.points, case.truth.points).apply(values.points) - case.truth.points
        at_points.append(np.einsum("ni,nij,nj->n", moved, np.linalg.inv(in_datum(cov).points()), moved))
        units = problem.units(values).camera[0][:8]
        change = (values.cameras[0].parameters() - case.truth.cameras[0].parameters())[:8] / units
        at_lens.append(change @ np.linalg.solve(cov.dense[:8, :8], change))
    assert np.mean(at_points) == pytest.approx(3.0, rel=0.1)
    assert np.mean(at_lens) == pytest.approx(8.0, rel=0.12)


def test_pictures_from_one_place_are_refused():
    case = networks.make(16)
    rotation = case.truth.frames.rotation
    place = np.broadcast_to(np.array([0.0, 0.0, 1300.0]), (8, 3))
    turned = Pose(rotation, -(rotation @ place[..., None])[..., 0])
    truth = replace(case.truth, frames=turned)
    net = case.network
    v, p = np.divmod(np.arange(8 * 25), 25)
    xy, inside = networks.project(truth, net.view_frame, net.view_offset, net.view_camera, v, p)
    network = replace(
        net, view=v[inside], point=p[inside], xy=xy[inside],
        cov=np.broadcast_to(0.01 * np.eye(2), (int(inside.sum()), 2, 2)).copy(), free_camera=(("focal_px",),),
    )  # fmt: skip
    problem = NetworkProblem(network, truth)
    system = problem.linearise(truth)
    with pytest.raises(DegenerateGeometry):
        network_covariance(system, problem.layout)


def test_a_datum_on_a_line_is_refused():
    case = networks.make(17)
    problem, _, system = solved(case)
    with pytest.raises(DegenerateGeometry, match="three"):
        in_datum(network_covariance(system, problem.layout), np.arange(25) < 2)


@pytest.mark.parametrize("name", ["points", "frames"])
def test_what_marks_follow_is_their_derivative_in_the_whole_covariance(name, monkeypatch):
    """J C J^T of every mark, J by differences of the residuals, C of all parameters; by kernels and by NumPy."""
    case = networks.make(6, views=6, points=14, eliminate=name)
    problem = NetworkProblem(case.network, case.start)
    state = minimise(problem, case.start)[0]
    covariance = network_covariance(problem.linearise(state), problem.layout)
    whole = covariance.product(np.eye(problem.size))
    columns = []
    for step in 1e-6 * np.eye(problem.size):
        ahead, behind = (problem.residual(problem.retract(state, s * step)) for s in (1, -1))
        columns.append((ahead - behind) / 2e-6)
    j = np.stack(columns, axis=2)
    expected = j @ whole @ j.transpose(0, 2, 1)
    jd, je, cols, block = problem.jacobian(state)
    cross = -covariance.half @ covariance.dense
    monkeypatch.setattr(numpy_path, "CHUNK", 50)
    for of in (numpy_path.influences, linear.influences):
        out = np.empty((len(jd), 2, 2))
        of(jd, je, cols, block, np.ascontiguousarray(covariance.dense.T), cross, covariance.blocks, out)
        np.testing.assert_allclose(out, expected, atol=2e-5)
    b, group = np.random.default_rng(3).normal(size=(len(jd), 2, 3)), np.arange(len(jd)) % 5 - 1
    for of in (numpy_path.gather, linear.gather):
        sums = np.zeros((problem.size, 4, 3))
        one, first = np.ones((1, 1)), np.zeros(len(jd), int)
        of(jd, je, cols, block, b, one, first, group, *np.split(sums, [problem.layout.dense]))
        for g in range(4):
            mine = group == g
            np.testing.assert_allclose(sums[:, g], np.einsum("oip,oik->pk", j[mine], b[mine]), rtol=1e-5, atol=1e-4)
    trace = np.einsum("nii->", expected)
    assert trace == pytest.approx(problem.size - covariance.motions.shape[1], rel=1e-3)  # unknowns that marks determine


@pytest.mark.parametrize("name", ["points", "frames"])
def test_in_another_frame_the_covariance_is_that_of_the_network_there(name):
    case = networks.make(7, views=6, points=14, eliminate=name)
    problem = NetworkProblem(case.network, case.start)
    state = minimise(problem, case.start)[0]
    covariance = network_covariance(problem.linearise(state), problem.layout)
    fit = Similarity(2.5, Pose.from_rotvec([0.3, -1.0, 0.6], [0, 0, 0]).rotation, np.array([10.0, -300.0, 50.0]))
    there = problem.moved(fit)
    placed = replace(state, points=fit.apply(state.points), frames=fit.moved(state.frames))
    assert there.cost(placed) == pytest.approx(problem.cost(state), rel=1e-9)
    anew = in_datum(network_covariance(there.linearise(placed), there.layout))
    moved, before = in_datum(covariance.moved(fit.rotation, there.layout)), in_datum(covariance).points()
    np.testing.assert_allclose(moved.points(), anew.points(), rtol=1e-4, atol=1e-6 * anew.points().max())
    turned = 2.5**2 * fit.rotation @ before @ fit.rotation.T
    np.testing.assert_allclose(moved.points(), turned, rtol=1e-4, atol=1e-6 * turned.max())
    scale = np.sqrt(np.outer(*[np.diagonal(anew.dense())] * 2))
    np.testing.assert_allclose(moved.dense() / scale, anew.dense() / scale, atol=1e-4)


@pytest.mark.parametrize("kept", [0, 30_000])
def test_derivatives_are_those_of_the_values_that_are_asked_for(kept, monkeypatch):
    """Kept for who asks again, and no others'."""
    monkeypatch.setattr("windmark.adjust.network.problem.KEPT", kept)
    case = networks.make(8, views=4, points=10)
    problem = NetworkProblem(case.network, case.start)
    expected = {}
    for state in (case.start, case.truth):
        expected[id(state)] = NetworkProblem(case.network, case.start).jacobian(state)
    first, other = (expected[id(s)][0] for s in (case.start, case.truth))
    assert not np.allclose(first, other)
    for state in (case.start, case.start, case.truth, case.start, case.truth):
        for got, want in zip(problem.jacobian(state), expected[id(state)], strict=True):
            np.testing.assert_array_equal(got, want)
    assert (problem.jacobian(case.truth)[0] is problem.jacobian(case.truth)[0]) == (kept > 0)
    for state in (case.start, case.truth):
        units, fresh = problem.units(state), NetworkProblem(case.network, case.start).units(state)
        np.testing.assert_array_equal(units.frame_pivot, fresh.frame_pivot)


def test_a_root_where_rounding_has_left_nothing_of_a_pose():
    """Of a pose that few marks hold the own part may have lost its sign."""
    problem, _, system = solved(networks.make(12, points=15, eliminate="frames"))
    cov = network_covariance(system, problem.layout)
    value, axes = np.linalg.eigh(cov.own)
    value[0] *= [-1e-12, 1.0, 1.0, 1.0, 1.0, 1.0]
    cov = replace(cov, own=(axes * value[:, None, :]) @ axes.transpose(0, 2, 1))
    vectors = np.random.default_rng(1).normal(size=(len(cov.dense) + cov.half.shape[0], 3))
    roots = cov.rooted(vectors)
    want = vectors.T @ cov.product(vectors)
    np.testing.assert_allclose(sum(r.T @ r for r in roots), want, rtol=1e-6, atol=1e-6 * np.abs(want).max())
