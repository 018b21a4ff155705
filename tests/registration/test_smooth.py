"""Misfit that is smooth over the image is told from a random one."""

from itertools import product

import numpy as np
import pytest
import settle_scenes as settling
import settle_twins as twins
from scipy.stats import multivariate_normal

from windmark.registration.settle._kernels import worth
from windmark.registration.settle._kernels.state import EXCESS
from windmark.registration.settle.settling import copied
from windmark.registration.settle.solution import Solution


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
    for change in ("excess", "pairs"):
        solution = settling.with_all_labels(settling.of_wrong_lens(40))
        state = copied(solution.views, solution.state)
        if change == "excess":
            state.numbers[0, EXCESS] = 0.0
        else:
            state.match[0, np.flatnonzero(state.match[0] >= 0)[worth.FEWEST - 1 :]] = -1
        assert Solution(solution.views, state).readings[0, worth.SYSTEMATIC] == 0.0
