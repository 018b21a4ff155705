from __future__ import annotations

import numpy as np
import pytest

from windmark.geometry.lens import Lens, distort, distort_jacobian, max_radius2
from windmark.geometry.lens_inverse import undistort

LENSES = {
    "none": (0.0, 0.0, 0.0, 0.0, 0.0),
    "barrel": (-0.3, 0.12, 1e-3, -2e-3, -0.02),
    "plain barrel": (-0.2, 0.0, 0.0, 0.0, 0.0),
    "pincushion": (0.2, 0.05, -1e-3, 5e-4, 0.01),
    "moustache": (-0.15, 0.3, 0.0, 0.0, -0.1),
}


@pytest.fixture(params=LENSES.values(), ids=LENSES.keys())
def lens(request):
    return Lens(*request.param)


def grid(radius, n=41):
    x = np.linspace(-radius, radius, n)
    return np.stack(np.meshgrid(x, x), -1).reshape(-1, 2)


@pytest.mark.parametrize(
    ("k", "radius2"),
    [
        ((0, 0, 0), np.inf),
        ((-1 / 3, 0, 0), 1.0),
        ((0.3, 0, 0), np.inf),
        ((0, -1 / 5, 0), 1.0),
        ((0, 0, -1 / 7), 1.0),
        ((-0.3, 0.2, 0), np.inf),  # slope 1 - 0.9 s + s^2 has no real root
        ((0.1, -0.2, 0.0), (0.3 + np.sqrt(0.09 + 4)) / 2),
        ((1e-320, 0, 0), np.inf),
        ((0, 0, 1e-320), np.inf),
        ((-1e-12, 0, 0), 1 / 3e-12),
    ],
)
def test_the_radius_at_which_the_lens_folds(k, radius2):
    assert max_radius2(*k) == pytest.approx(radius2, rel=1e-12)


def test_the_smallest_of_several_folds_counts():
    # slope 1 + 3 k1 s + 5 k2 s^2 + 7 k3 s^3 = (1 - s)(1 - s / 2)(1 - s / 3)
    k1, k2, k3 = -(1 + 1 / 2 + 1 / 3) / 3, (1 / 2 + 1 / 3 + 1 / 6) / 5, -(1 / 6) / 7
    assert max_radius2(k1, k2, k3) == pytest.approx(1.0, rel=1e-9)


def test_undistort_undoes_distort_wherever_it_is_one_to_one(lens):
    p = grid(min(1.5, 0.999 * np.sqrt(max_radius2(lens.k1, lens.k2, lens.k3) / 2)))
    q, valid = distort(p, lens)
    assert valid.mean() > 0.9
    back = undistort(q[valid], lens)
    reached, _ = distort(back, lens)
    np.testing.assert_allclose(reached, q[valid], atol=1e-13)
    slope = np.linalg.svd(distort_jacobian(p[valid], lens), compute_uv=False)[:, -1]
    np.testing.assert_array_less(np.abs(back - p[valid]).max(axis=1), 1e-14 + 4e-15 / slope)


def test_close_to_the_fold_the_inverse_still_holds():
    lens = Lens(k1=-0.2)
    fold = np.sqrt(max_radius2(-0.2, 0.0, 0.0))
    for below in (1e-2, 1e-4, 1e-6, 1e-8):
        p = np.array([[0.6, 0.8]]) * fold * (1 - below)
        q, valid = distort(p, lens)
        assert valid.all()
        # at a fold the inverse has a square-root: rounding eps becomes sqrt(eps)
        np.testing.assert_allclose(undistort(q, lens), p, atol=1e-15 / below + 1e-15)


def test_beyond_the_fold_both_directions_say_so():
    lens = Lens(k1=-0.2)
    fold = np.sqrt(max_radius2(-0.2, 0.0, 0.0))
    p = np.array([[0.999 * fold, 0], [1.001 * fold, 0], [3 * fold, 0]])
    assert distort(p, lens)[1].tolist() == [True, False, False]
    top = fold * (1 - 0.2 * fold**2)
    q = np.array([[0.0, 0.999 * top], [0.0, 1.001 * top], [0.0, 5 * top]])
    with np.errstate(divide="ignore", invalid="ignore"):  # as `Camera` calls it
        plain, with_decentring = undistort(q, lens), undistort(q, Lens(k1=-0.2, p1=1e-5, p2=1e-5))
    assert np.isfinite(plain).all(axis=1).tolist() == [True, False, False]
    assert np.isfinite(with_decentring).all(axis=1).tolist() == [True, False, False]


def test_jacobian_against_differences(lens):
    p = grid(0.7, 9)
    h = 1e-5
    columns = [(distort(p + d, lens)[0] - distort(p - d, lens)[0]) / (2 * h) for d in h * np.eye(2)]
    np.testing.assert_allclose(distort_jacobian(p, lens), np.stack(columns, -1), atol=1e-9)


def test_nan_stays_nan_and_empty_stays_empty(lens):
    q = np.array([[np.nan, 0.1], [0.1, 0.2]])
    back = undistort(q, lens)
    assert np.isnan(back[0]).any()
    assert np.isfinite(back[1]).all()
    assert undistort(np.zeros((0, 2)), lens).shape == (0, 2)


@pytest.mark.parametrize("lens", [Lens(k3=0.125), Lens(k1=5.0, k3=3.0), Lens(k2=1e3)])
def test_points_far_outside_a_steep_lens_are_inverted_too(lens):
    p = np.array([[0.0, 0.0], [1e-3, 0], [0.3, 0.4], [-3, 4], [50, 80], [-1e4, 1e3]])
    q, valid = distort(p, lens)
    assert valid.all()
    np.testing.assert_allclose(undistort(q, lens), p, rtol=1e-13)
