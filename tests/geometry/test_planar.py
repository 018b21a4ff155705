"""Planar transformations: exact where they should be, honest about what they predict, refused where not determined."""

import json
from dataclasses import replace

import numpy as np
import pytest

from windmark.geometry import DegenerateGeometry
from windmark.geometry.planar import (
    KINDS,
    NEEDED,
    bases,
    choose,
    fit_planar,
    hull_of,
    inside_hull,
    planar_from_record,
    sound_pairs,
)
from windmark.geometry.planar._kernels import plate_places
from windmark.geometry.planar.fit import FLAT, _check_spread
from windmark.geometry.planar.outliers import NEIGHBOURS, _local_worst

TURN = np.array([[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]])
OWN = {
    "similarity": lambda x: 1.3 * x @ TURN.T + np.array([80.0, -40.0]),
    "affine": lambda x: x @ [[1.1, 0.1], [-0.2, 0.9]] + [5.0, 7.0],
    "projective": lambda x: (x @ [[1.1, 0.1], [-0.2, 0.9]] + [5.0, 7.0]) / (1 + x @ [1e-4, -5e-5])[:, None],
    "poly2": lambda x: x @ TURN.T + 1e-5 * x**2 + 2e-5 * x[:, :1] * x[:, 1:],
    "poly3": lambda x: x @ TURN.T + 1e-8 * x**3 + 2e-5 * x[:, :1] * x[:, 1:],
}


def places(n=40, seed=0):
    return np.random.default_rng(seed).uniform(0, 1000, (n, 2))


def cov(n, sigma=0.03):
    return np.tile(sigma**2 * np.eye(2), (n, 1, 1))


@pytest.mark.parametrize("kind", OWN)
def test_each_kind_reproduces_its_own_transformation(kind):
    x = places()
    fit = fit_planar(kind, x, OWN[kind](x), cov(40), cov(40))
    other = places(100, 5)
    assert np.abs(fit.transform.apply(other) - OWN[kind](other)).max() < 1e-6
    assert fit.transform.misfit_px < 1e-6
    assert np.abs(fit.held_out).max() < 1e-6


@pytest.mark.parametrize("kind", KINDS)
def test_residuals_jacobian_and_inverse_agree_with_apply(kind):
    rng = np.random.default_rng(1)
    x = places()
    y = OWN["poly2"](x) + rng.normal(0, 0.05, x.shape)
    fit = fit_planar(kind, x, y, cov(40), cov(40))
    t, at, step = fit.transform, places(20, 3), 1e-4
    assert np.allclose(t.apply(x) - y, fit.residual, atol=1e-9)
    by_hand = np.stack([(t.apply(at + step * e) - t.apply(at - step * e)) / (2 * step) for e in np.eye(2)], axis=-1)
    assert np.abs(t.jacobian(at) - by_hand).max() < 1e-6
    assert np.abs(t.inverse(t.apply(at)) - at).max() < 1e-6
    again = planar_from_record(json.loads(json.dumps(t.record())))
    assert np.array_equal(again.apply(at), t.apply(at))
    assert np.array_equal(again.cov_at(at), t.cov_at(at))


def test_the_splines_kernel_is_its_readable_twin():
    rng = np.random.default_rng(11)
    u, nodes, weights = rng.normal(size=(50, 2)), rng.normal(size=(9, 2)), rng.normal(size=(2, 12))
    u[3] = nodes[4]  # r = 0
    got = np.empty_like(u)
    plate_places(u, nodes, weights, got)
    assert np.allclose(got, np.column_stack([np.ones(50), u, bases.plate(u, nodes)]) @ weights.T, atol=1e-12)


@pytest.mark.parametrize("kind", ["similarity", "affine", "poly2"])
def test_held_out_residuals_are_those_of_a_fit_without_the_pair(kind):
    """Exact for linear kinds with equal weights: one covariance for all, and noise alone, so that these stay equal."""
    rng = np.random.default_rng(2)
    x = places(15)
    y = OWN["similarity"](x) + rng.normal(0, 0.01, x.shape)
    spread = cov(15, 0.1)  # larger than the noise: no misfit is added, the weights stay
    fit = fit_planar(kind, x, y, spread, spread)
    for k in range(15):
        rest = np.arange(15) != k
        other = fit_planar(kind, x[rest], y[rest], spread[rest], spread[rest])
        assert np.abs(other.transform.apply(x[k]) - y[k] - fit.held_out[k]).max() < 1e-4


@pytest.mark.slow
def test_held_out_residuals_of_the_spline_are_close_to_those_of_a_fit_without_the_pair():
    rng = np.random.default_rng(3)
    x = places(60)
    y = x + 3 * np.sin(x / 150) + rng.normal(0, 0.05, x.shape)
    fit = fit_planar("spline", x, y, cov(60), cov(60))
    rest = [np.delete(np.arange(60), k) for k in range(60)]
    by_hand = np.array([
        fit_planar("spline", x[r], y[r], cov(59), cov(59)).transform.apply(x[k]) - y[k] for k, r in enumerate(rest)
    ])  # fmt: skip
    assert fit.held_out_px == pytest.approx(np.sqrt((by_hand**2).sum(axis=1).mean()), rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["similarity", "affine", "projective", "poly2", "poly3", "spline"])
def test_covariance_of_the_mapped_place_is_what_repeated_noise_does(kind):
    rng = np.random.default_rng(4)
    x, at = places(40), np.array([[500.0, 500.0], [100.0, 800.0], [1300.0, 500.0]])
    truth = OWN["affine"]
    off, said = [], []
    for _ in range(150):
        seen = x + rng.normal(0, 0.03, x.shape), truth(x) + rng.normal(0, 0.05, x.shape)
        if kind == "similarity":
            seen = seen[0], OWN["similarity"](x) + rng.normal(0, 0.05, x.shape)
        t = fit_planar(kind, *seen, cov(40, 0.03), cov(40, 0.05)).transform
        off.append(t.apply(at) - (OWN["similarity"] if kind == "similarity" else truth)(at))
        own = replace(t, left_out_px=0.0)  # the kind is right here, and nothing is left out
        said.append(np.trace(own.cov_at(at) - t.misfit_px**2 * np.eye(2), axis1=1, axis2=2) / 2)
    ratio = np.sqrt((np.array(off) ** 2).mean(axis=(0, 2)) / np.mean(said, axis=0))
    assert (ratio > 0.75).all()
    assert (ratio < 1.3).all()


@pytest.mark.parametrize(("kind", "power"), [("similarity", 2), ("affine", 2), ("projective", 2), ("poly2", 3)])
def test_beyond_the_markers_sigma_holds_what_the_kind_leaves_out(kind, power):
    """A motion that bends so little that the markers hardly tell: where it is extrapolated it is many sigmas off."""
    rng = np.random.default_rng(8)
    count = 20
    x = places(count) / 4 + [300, 300]
    at = np.stack([g.ravel() for g in np.meshgrid(np.linspace(0, 1400, 8), np.linspace(0, 1000, 6))], axis=1)
    share = {True: [], False: []}
    for _ in range(30):
        bend = rng.normal(0, 0.06, (power + 1, 2))

        def truth(p, bend=bend):
            u = (p - x.mean(axis=0)) / np.ptp(x)
            return p + 2 + sum(c * u[:, :1] ** k * u[:, 1:] ** (power - k) for k, c in enumerate(bend))

        t = fit_planar(kind, x, truth(x) + rng.normal(0, 0.02, x.shape), cov(count, 1e-3), cov(count, 0.02)).transform
        for kept in share:
            off = np.abs(t.apply(at) - truth(at)) / replace(t, left_out_px=t.left_out_px * kept).sigma_px(at)[:, None]
            share[kept].append((off < 1.96).mean())
    assert np.mean(share[True]) > 0.95
    assert np.mean(share[False]) < 0.8


def test_the_spline_does_not_interpolate_noise():
    rng = np.random.default_rng(5)
    x = places(200)
    y = OWN["affine"](x) + rng.normal(0, 0.3, x.shape)
    fit = fit_planar("spline", x, y, cov(200, 0.2), cov(200, 0.2))
    assert fit.freedom < 30
    assert fit.rms_px == pytest.approx(0.3 * np.sqrt(2), rel=0.1)


def test_uneven_marks_are_weighted():
    """A tenth of the marks is fifty times as bad: weighted they hardly matter."""
    rng = np.random.default_rng(6)
    x = places(50)
    sigma = np.where(np.arange(50) < 5, 1.0, 0.02)
    y = OWN["affine"](x) + rng.normal(size=x.shape) * sigma[:, None]
    both = np.tile(np.eye(2), (50, 1, 1)) * sigma[:, None, None] ** 2
    weighted = fit_planar("affine", x, y, cov(50, 1e-3), both).transform
    plain = fit_planar("affine", x, y).transform
    at = places(100, 9)
    error = [np.sqrt(((t.apply(at) - OWN["affine"](at)) ** 2).sum(axis=1).mean()) for t in (weighted, plain)]
    assert error[0] < 0.02
    assert error[0] < 0.2 * error[1]


@pytest.mark.parametrize("kind", KINDS)
def test_too_few_pairs_are_refused_with_the_number_needed(kind):
    x = places(NEEDED[kind] - 1)
    with pytest.raises(DegenerateGeometry, match=f"{kind} needs at least {NEEDED[kind]} pairs"):
        fit_planar(kind, x, x)


def test_markers_on_a_line_bear_a_similarity_only():
    x = np.column_stack([np.linspace(0, 900, 12), np.linspace(0, 300, 12)])
    y = OWN["similarity"](x)
    choice = choose(x, y, cov(12), cov(12))
    assert choice.chosen.kind == "similarity"
    assert "of a line" in next(t.reason for t in choice.trials if t.kind == "affine")


def test_a_kind_that_hangs_on_one_marker_is_refused():
    """All on a line but one: the slope across is this one marker's word."""
    x = np.vstack([np.column_stack([np.linspace(0, 900, 12), np.zeros(12)]), [[450.0, 700.0]]])
    with pytest.raises(DegenerateGeometry, match="hangs on the marker at x 450, y 700"):
        fit_planar("affine", x, x + 3)


def test_markers_in_one_place_are_refused():
    with pytest.raises(DegenerateGeometry, match="in one place"):
        fit_planar("similarity", np.ones((5, 2)), places(5))


@pytest.mark.parametrize("kind", OWN)
def test_auto_takes_the_kind_that_made_the_pairs(kind):
    """Noise grows the more flexible ones; the simplest that predicts as well is taken."""
    rng = np.random.default_rng(8)
    x = places(80)
    y = OWN[kind](x) + rng.normal(0, 0.02, x.shape)
    assert choose(x, y, cov(80, 0.01), cov(80, 0.02)).chosen.kind == kind


def test_one_wrong_pair_with_high_leverage_is_found():
    rng = np.random.default_rng(9)
    x = np.vstack([rng.uniform(400, 600, (12, 2)), [[3000.0, 2500.0]]])
    y = OWN["similarity"](x) + rng.normal(0, 0.02, x.shape)
    y[-1] += [4.0, -3.0]
    kept = sound_pairs(x, y, cov(13), cov(13))
    assert kept.tolist() == [True] * 12 + [False]


@pytest.mark.parametrize("wrong", [1, 3, 8])
def test_wrong_pairs_are_found_and_deformation_is_not_taken_for_them(wrong):
    rng = np.random.default_rng(wrong)
    x = places(60, wrong)
    y = x + 100 + 8 * np.sin(x[:, :1] / 250) * [0.3, 1.0] + rng.normal(0, 0.03, x.shape)
    bad = rng.choice(60, wrong, replace=False)
    y[bad] += rng.uniform(8, 30, (wrong, 2)) * rng.choice([-1, 1], (wrong, 2))
    assert sorted(np.flatnonzero(~sound_pairs(x, y, cov(60), cov(60)))) == sorted(bad)


def test_no_pair_is_wrong_where_there_is_noise_only():
    for seed in range(20):
        rng = np.random.default_rng(seed)
        x = places(30, seed)
        assert sound_pairs(x, x + rng.normal(0, 0.3, x.shape), cov(30, 0.2), cov(30, 0.2)).all()


def test_a_folded_transformation_is_not_chosen():
    x = places(40)
    y = x * [-1.0, 1.0]
    choice = choose(x, y, cov(40), cov(40))
    assert all(t.fit is None or np.linalg.det(t.fit.transform.jacobian(x)).min() > 0 for t in choice.trials)


def test_hull():
    square = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0], [2.0, 1.0], [0.0, 0.0]])
    corners = hull_of(square)
    assert sorted(map(tuple, corners)) == [(0, 0), (0, 3), (4, 0), (4, 3)]
    assert inside_hull(corners, [[2, 1], [4.5, 1], [4.5, 1]], 0.0).tolist() == [True, False, False]
    assert inside_hull(corners, [[4.5, 1]], 1.0).all()
    assert not inside_hull(hull_of([[0, 0], [1, 1], [2, 2]]), [[1.0, 1.0]]).any()


def test_wrong_usage_is_said():
    x = places(10)
    with pytest.raises(ValueError, match="kind must be one of"):
        fit_planar("rigid", x, x)
    with pytest.raises(ValueError, match="finite"):
        fit_planar("affine", x, np.where(x > 900, np.nan, x))
    with pytest.raises(ValueError, match="covariances"):
        fit_planar("affine", x, x, np.eye(2))
    record = fit_planar("affine", x, x).transform.record()
    with pytest.raises(ValueError, match="number of parameters"):
        planar_from_record({**record, "kind": "poly2"})
    with pytest.raises(ValueError, match="'cov' is missing"):
        planar_from_record({k: v for k, v in record.items() if k != "cov"})


def test_of_neighbours_that_look_wrong_the_worst_is():
    rng = np.random.default_rng(8)
    x, wrong, evidence = rng.uniform(0, 100, (40, 2)), rng.random(40) < 0.4, rng.uniform(0, 50, 40)
    expected = [
        bool(wrong[k]) and evidence[k] >= evidence[np.argsort(np.hypot(*(x - x[k]).T))[: NEIGHBOURS + 1]].max()
        for k in range(40)
    ]
    np.testing.assert_array_equal(_local_worst(wrong, evidence, x), expected)
    assert any(expected)
    assert not _local_worst(np.zeros(40, bool), evidence, x).any()
    few = x[: NEIGHBOURS - 2], np.ones(NEIGHBOURS - 2, bool)
    assert _local_worst(few[1], evidence[: NEIGHBOURS - 2], few[0]).sum() == 1


@pytest.mark.parametrize(("part", "fits"), [(1.1, True), (0.9, False)])
def test_markers_along_a_line_determine_a_similarity_alone(part, fits):
    """The scatter across is FLAT of that along it, or just not; the message says both."""
    along = np.linspace(-1, 1, 40)
    across = np.where(np.arange(40) % 2, 1.0, -1.0)
    across -= along * (across @ along) / (along @ along)
    u = np.column_stack([along / along.std(), part * FLAT * across / across.std()])
    _check_spread("similarity", u, 500.0)
    if fits:
        _check_spread("affine", u, 500.0)
        return
    with pytest.raises(DegenerateGeometry, match=r"affine is not determined: .* within 9 px .* 500 px long"):
        _check_spread("affine", u, 500.0)
