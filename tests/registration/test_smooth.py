"""Misfit that is smooth over the image: told from a random one, and what it does to the covariance."""

from itertools import product

import numpy as np
import pytest
import registration_scenes as scenes
import settle_scenes as settling
import settle_twins as twins
from scipy.stats import multivariate_normal

from windmark.registration.settle._kernels import worth
from windmark.registration.settle._kernels.settle import fit_kernel
from windmark.registration.settle._kernels.smooth import smooth_cov_kernel
from windmark.registration.settle._kernels.state import EXCESS, MISFIT
from windmark.registration.settle.solution import Solution, copied


def cosines(solution):
    """(K, SMOOTH) cosines over the image at the spots of the matched markers, long waves first."""
    xy = solution.views.planes[0].task.xy[solution.pairs()[0]]
    u, v = (np.pi * (xy + 0.5) / solution.views.planes[0].task.camera.size_px).T
    orders = [(i, j) for i, j in product(range(worth.ORDERS + 1), repeat=2) if 0 < i + j <= worth.ORDERS]
    return np.stack([np.cos(i * u) * np.cos(j * v) / (i + j) for i, j in orders], axis=1)


def split_likelihoods(solution):
    """Log likelihood of the residuals for every part of the excess that may be smooth, by the dense covariance."""
    marker = solution.pairs()[1]
    excess, basis = solution.state.numbers[0, EXCESS], cosines(solution)
    noise = 0.5 * np.trace(twins.square(solution.state.spread[0, marker]), axis1=1, axis2=2) - excess
    found = []
    for part in worth.PARTS:
        cov = np.diag(noise + (1 - part) * excess) + part * excess * basis @ basis.T
        found.append(sum(multivariate_normal.logpdf(r, cov=cov) for r in solution.state.residual[0, marker].T))
    return np.array(found)


@pytest.mark.parametrize("of", [settling.of_wrong_lens, settling.of_rough_table, settling.of_both])
def test_smooth_misfit_is_that_of_the_dense_covariance(of):
    solution = settling.with_all_labels(of(34))
    likelihood = split_likelihoods(solution)
    assert solution.readings[0, worth.SYSTEMATIC] == pytest.approx(likelihood.max() - likelihood[0], rel=1e-6, abs=1e-6)
    at, basis, part = worth.smooth_part(solution.views.sights, solution.state, 0)
    np.testing.assert_array_equal(at, solution.pairs()[1])
    np.testing.assert_allclose(basis @ basis.T, cosines(solution) @ cosines(solution).T, atol=1e-12)
    assert part == worth.PARTS[likelihood.argmax()]


def test_a_wrong_lens_is_smooth_and_a_rough_table_is_not():
    lens = [
        settling.with_all_labels(settling.of_wrong_lens(seed)).readings[0, worth.SYSTEMATIC] for seed in range(40, 48)
    ]
    rough = [
        settling.with_all_labels(settling.of_rough_table(seed)).readings[0, worth.SYSTEMATIC] for seed in range(40, 48)
    ]
    assert min(lens) > 5
    assert np.mean(rough) < 1.5


def test_without_excess_or_with_few_pairs_nothing_is_smooth():
    _, solution = settling.solution_of(31)
    for change in ("excess", "pairs"):
        state = copied(solution.views, solution.state)
        state.numbers[0, EXCESS] = 0.0 if change == "excess" else 1.0
        if change == "pairs":
            state.match[0, np.flatnonzero(state.match[0] >= 0)[worth.FEWEST - 1 :]] = -1
        at, _, part = worth.smooth_part(solution.views.sights, state, 0)
        assert len(at) == part == 0
        np.testing.assert_array_equal(
            smooth_cov_kernel(solution.views.sights, state, solution.unit_cov), solution.unit_cov
        )


@pytest.mark.parametrize(("of", "smooth_part"), [(settling.of_wrong_lens, 1.0), (settling.of_both, 0.5)])
def test_covariance_with_smooth_misfit_is_the_sandwich_of_dense_matrices(of, smooth_part):
    solution = settling.with_all_labels(of(35))
    marker, size = solution.pairs()[1], len(solution.state.factor)
    part = worth.smooth_part(solution.views.sights, solution.state, 0)[2]
    assert part == smooth_part
    excess, basis = part * solution.state.numbers[0, EXCESS], cosines(solution)
    by = twins.by_unknowns(solution.views, solution.state)[0, marker]
    weight = np.linalg.inv(twins.square(solution.state.spread[0, marker]))
    pull = np.einsum("kia,kij->kja", by, weight)  # of the residuals on J'Wr
    smooth = np.einsum("kja,kb->jba", pull, basis).reshape(-1, size)  # of unit waves in x and y
    middle = excess * (smooth.T @ smooth - np.einsum("kja,kjb->ab", pull, pull))
    cov = solution.unit_cov
    expected = cov + cov @ middle @ cov
    sigma = np.sqrt(np.diag(expected))
    assert (sigma > np.sqrt(np.diag(cov))).all()  # nothing is cut here
    got = smooth_cov_kernel(solution.views.sights, solution.state, cov)
    np.testing.assert_allclose(got / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), atol=1e-5)


def test_covariance_with_smooth_misfit_holds_the_truth():
    """Lenses that are off by k1 of both signs: the whitened errors are far too large without it, and not with it."""
    plain, wide = [], []
    for seed in range(60, 84):
        scene = settling.of_wrong_lens(seed, k1=0.03 if seed % 2 else -0.03)
        solution = settling.with_all_labels(scene)
        true = solution.views.layout.frame.unit(scene.cam_from_model)
        turn = scenes.Pose(true[0] @ solution.state.rotation.T, np.zeros(3)).log()[:3]
        error = np.append(turn, true[1] - solution.state.translation)
        state = copied(solution.views, solution.state)
        state.numbers[0, EXCESS] = solution.state.numbers[0, MISFIT]
        assert fit_kernel(solution.views.sights, state)
        best = Solution(solution.views, state)
        for cov, into in ((best.unit_cov, plain), (smooth_cov_kernel(best.views.sights, state, best.unit_cov), wide)):
            into.append(error[:2] ** 2 / np.diag(cov)[:2])
    assert np.sqrt(np.mean(wide)) < 0.6 * np.sqrt(np.mean(plain))
    assert np.sqrt(np.mean(wide)) < 2.0
