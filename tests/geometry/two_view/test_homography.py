"""The map between a plane and its picture."""

import numpy as np
import pytest

from windmark.geometry.two_view.homography import fit_homography, robust_homography, transfer

H = np.array([[300.0, -40.0, 800.0], [25.0, 280.0, 600.0], [0.08, -0.05, 1.0]])


def points(n, seed=0):
    return np.random.default_rng(seed).uniform(-3, 3, (n, 2))


@pytest.mark.parametrize("n", [4, 5, 50])
def test_exact(n):
    p = points(n)
    h = fit_homography(p, transfer(H, p))
    q = points(20, 1)
    assert np.allclose(transfer(h, q), transfer(H, q), atol=1e-6)
    assert h[2] @ [*p.mean(axis=0), 1.0] == pytest.approx(1.0)  # in front, and of one size whatever the units


def test_least_squares_in_the_picture():
    """No nearby homography has a smaller transfer error."""
    p, rng = points(30), np.random.default_rng(2)
    q = transfer(H, p) + rng.normal(0, 3.0, p.shape)
    h = fit_homography(p, q)
    best = ((transfer(h, p) - q) ** 2).sum()
    assert best < ((transfer(H, p) - q) ** 2).sum()
    for _ in range(30):
        near = h * (1 + 1e-5 * rng.normal(size=(3, 3)))
        assert ((transfer(near, p) - q) ** 2).sum() > best * (1 - 1e-9)


def test_points_on_a_line_have_none():
    line = np.outer(np.arange(8.0), [1.0, 2.0])
    assert fit_homography(line, transfer(H, line)) is None
    assert fit_homography(points(3), points(3)) is None
    assert fit_homography(np.zeros((6, 2)), points(6)) is None


def test_beyond_the_horizon_there_is_no_picture():
    assert np.isnan(transfer(H, np.array([[-20.0, 0.0]]))).all()


def test_two_fifths_wrong():
    p, rng = points(60), np.random.default_rng(3)
    q = transfer(H, p)
    wrong = rng.random(60) < 0.4
    q[wrong] += rng.normal(0, 200, (int(wrong.sum()), 2))
    h, near = robust_homography(p, q, 2.0, rng)
    assert near[~wrong].all()
    assert near[wrong].sum() <= 1
    assert np.allclose(transfer(h, p)[~wrong], q[~wrong], atol=2.0)
    assert robust_homography(p, rng.uniform(0, 1000, (60, 2)), 0.5, rng) is None


@pytest.mark.parametrize("right", [60, 30])
def test_quadruples_are_drawn_until_one_without_a_wrong_pair_is_as_good_as_certain(right):
    """The least n with (1 - part^4)^n < 1e-4; a single one where all pairs are right."""
    p, rng = points(60), np.random.default_rng(4)
    q = transfer(H, p)
    q[right:] += rng.uniform(100, 300, (60 - right, 2))
    drawn = []

    class Counted:
        def choice(self, *args, **options):
            drawn.append(rng.choice(*args, **options))
            return drawn[-1]

    assert robust_homography(p, q, 2.0, Counted())[1][:right].all()
    fails = 1 - (right / 60) ** 4
    assert fails ** len(drawn) <= 1e-4 < fails ** (len(drawn) - 1)
