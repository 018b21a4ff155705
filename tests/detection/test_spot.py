"""SPOT's least squares at one place, against its readable twin."""

import numpy as np
import pytest

from windmark.detection._kernels.spot import merit_at, refine_bowl, settle
from windmark.detection.search import Bowl


def kernel_merit(image, x, y, r0, min_core=0.5):
    half = int(2 * r0 + 0.5) + 1
    w, e, inv = np.empty((2 * half + 1, 2 * half + 1)), np.empty((2 * half + 1, 2 * half + 1)), np.empty(6)
    return merit_at(image.astype(np.float32), x, y, r0, min_core, w, e, inv)


@pytest.mark.parametrize("r0", [1.5, 2.0, 3.3, 7.0])
def test_merit_is_the_twin_s(r0, fit_hole):
    rng = np.random.default_rng(3)
    image = rng.normal(0, 10, (60, 60)).astype(np.float32)
    image[20, 31] = np.nan
    for x, y in [(30.3, 22.7), (30.0, 30.0), (r0, 25.2), (58.6 - r0, 60.0 - r0), (44.49, 44.51)]:
        m, depth = kernel_merit(image, x, y, r0)
        want_m, want_depth = fit_hole(image.astype(float), x, y, r0)
        assert depth == pytest.approx(want_depth, rel=1e-6)
        assert m == (pytest.approx(want_m, rel=1e-6) if want_depth > 0 else np.inf)


def test_perfect_hole_on_a_slope_has_merit_0(soft):
    y, x = np.mgrid[:41, :41].astype(float)
    hole = -37.0 * soft(4.0, np.hypot(x - 20.3, y - 19.6)) + 3.0 * x - 2.0 * y + 5.0
    m, depth = kernel_merit(hole, 20.3, 19.6, 4.0)
    assert m < 1e-4
    assert depth == pytest.approx(37.0, rel=1e-5)


def test_merit_1_is_an_error_as_large_as_the_hole(soft):
    y, x = np.mgrid[:61, :61].astype(float)
    distance = np.hypot(x - 30, y - 30)
    t, weight = soft(8.0, distance), soft(16.0, distance)
    error = np.where((x + y) % 2, 1.0, -1.0)
    basis = np.stack([np.ones_like(x), x - 30, y - 30, t])[:, weight > 0]
    root = np.sqrt(weight[weight > 0])
    e = error[weight > 0] * root
    e = e - (basis * root).T @ np.linalg.lstsq((basis * root).T, e, rcond=None)[0]
    image = np.zeros_like(x)
    size = np.sqrt(np.sum(weight * t**2)) * 10.0 / np.linalg.norm(e)
    image[weight > 0] = size * e / root
    m, depth = kernel_merit(image - 10.0 * t, 30.0, 30.0, 8.0)
    assert depth == pytest.approx(10.0, rel=1e-5)
    assert m == pytest.approx(1.0, rel=1e-5)


def test_merit_is_a_correlation_in_disguise(soft):
    """m^2 = kappa (1 / rho^2 - 1) with kappa = |t'|^2 / |t|^2, 3/4 for discs: m = 0.7 is rho = 0.778."""
    rng = np.random.default_rng(1)
    y, x = np.mgrid[:121, :121].astype(float)
    distance = np.hypot(x - 60, y - 60)
    t, weight = soft(25.0, distance), soft(50.0, distance)
    image = -5.0 * t + rng.normal(0, 2.0, x.shape)
    use = weight > 0
    root = np.sqrt(weight[use])
    plane = np.column_stack([np.ones(use.sum()), x[use], y[use]]) * root[:, None]

    def free(v):
        v = v[use] * root
        return v - plane @ np.linalg.lstsq(plane, v, rcond=None)[0]

    a, b = free(image), free(t)
    rho2 = (a @ b) ** 2 / (a @ a) / (b @ b)
    kappa = (b @ b) / np.sum(weight * t**2)
    assert kappa == pytest.approx(0.75, abs=0.01)
    assert kernel_merit(image, 60.0, 60.0, 25.0)[0] ** 2 == pytest.approx(kappa * (1 / rho2 - 1), rel=1e-5)
    assert 1 / np.sqrt(1 + 0.7**2 / 0.75) == pytest.approx(0.778, abs=5e-4)


def test_hills_and_hidden_holes():
    y, x = np.mgrid[:31, :31].astype(float)
    hill = np.exp(-((x - 15) ** 2 + (y - 15) ** 2) / 8)
    assert kernel_merit(hill, 15.0, 15.0, 3.0)[0] == np.inf
    assert np.isnan(kernel_merit(-hill, -1.0, 15.0, 3.0, min_core=0.8)[0])
    assert np.isnan(kernel_merit(np.full((31, 31), np.nan), 15.0, 15.0, 3.0)[0])


def test_bowl_functionals_are_exact_on_quadratics():
    bowl = Bowl.of_radius(3.0)
    u, v = bowl.positions.T
    values = 2.0 + 0.3 * u - 0.7 * v + 0.5 * 1.1 * u * u - 0.4 * u * v + 0.5 * 2.2 * v * v
    np.testing.assert_allclose(bowl.functionals @ values, [0.3, -0.7, 1.1, -0.4, 2.2], atol=1e-12)
    assert np.hypot(u, v).max() == pytest.approx(0.6 * 3.0)


@pytest.mark.parametrize(("r0", "limit"), [(1.5, 0.035), (2.0, 0.03), (3.0, 0.02), (6.0, 0.01), (15.0, 0.005)])
def test_centre_without_noise(r0, limit, draw):
    """Worst of 30 sub-pixel positions, radii within 10 % of r0: what the lattice error 0.025 / r0 stands for."""
    rng = np.random.default_rng(2)
    bowl = Bowl.of_radius(r0)
    n = int(5 * r0) + 8
    worst = []
    for _ in range(30 if r0 < 10 else 6):
        x, y = n / 2 + rng.uniform(-0.5, 0.5, 2)
        image = draw((n, n), [(x, y, r0 * rng.uniform(0.9, 1.1))], blur=1).astype(np.float32) - 100
        start = np.array([[np.round(x) + (rng.integers(-1, 2) if r0 > 2 else 0), np.round(y)]], dtype=float)
        found = refine_bowl(image, start, r0, 1e9, 0.85, bowl.positions, bowl.functionals)[0]
        assert found[4] == 1
        worst.append(np.hypot(found[0] - x, found[1] - y))
    assert max(worst) < 2 * limit
    assert np.sqrt(np.mean(np.square(worst)) / 2) < limit


def test_a_valley_is_no_bowl():
    x = np.mgrid[:41, :41][1].astype(float)
    valley = -50 * np.exp(-((x - 20) ** 2) / 4)
    bowl, half = Bowl.of_radius(3.0), 7
    w, e, inv, q = np.empty((15, 15)), np.empty((15, 15)), np.empty(6), np.empty(5)
    assert half * 2 + 1 == len(w)
    args = (3.0, bowl.positions, bowl.functionals, w, e, inv, q)
    assert settle(valley.astype(np.float32), 20.0, 20.0, *args)[2] == -1
