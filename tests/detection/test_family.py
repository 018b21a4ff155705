"""What is like the markers near a place: medians by weight, contrast beside them, sizes at one blur."""

from types import SimpleNamespace

import numpy as np
import pytest

from windmark.detection.family import GRAZING, TYPICAL, at_grazing_angle, beside, relative_contrast, size_at_blur


def field(count=40):
    rng = np.random.default_rng(5)
    xy = rng.uniform(0, 1000, (count, 2))
    value = 10 + xy[:, 0] / 100
    return xy, value, np.ones(count, bool), np.ones(count)


def test_beside_is_the_median_of_the_nearest_without_itself():
    xy, value, typical, weight = field()
    typical[::3] = False
    got = beside(xy, value, typical, weight)
    for k, place in enumerate(xy):
        others = np.array([i for i in np.argsort(np.hypot(*(xy - place).T)) if typical[i]][:10])
        others = others[others != k]
        assert got[k] == np.sort(value[others])[int(np.ceil(len(others) / 2)) - 1]
    few = np.arange(len(xy)) < TYPICAL
    assert np.isfinite(beside(xy, value, few, weight)).all()
    assert np.isnan(beside(xy, value, np.arange(len(xy)) < TYPICAL - 1, weight)).all()
    # Who weighs nothing has no say.
    mixed = value.copy()
    mixed[::2] = 1e6
    assert (beside(xy, mixed, np.ones(40, bool), np.where(np.arange(40) % 2, 1.0, 0.0)) < 1e5).all()


def test_contrast_is_beside_the_kinder_of_all_and_of_those_near():
    """On a picture that is darker on one side: near markers of half the contrast are no reason to be refused."""
    x = np.r_[np.linspace(0, 100, 30), np.linspace(900, 1000, 12)]
    xy, contrast = np.stack([x, 0 * x], axis=1), np.r_[np.full(30, 0.8), np.full(12, 0.4)]
    got = relative_contrast(xy, contrast, np.ones(42, bool), np.ones(42))
    np.testing.assert_allclose(got[:30], 1.0)
    np.testing.assert_allclose(got[30:], 1.0)
    bright = contrast.copy()
    bright[30:] = 1.6
    np.testing.assert_allclose(relative_contrast(xy, -bright, np.ones(42, bool), np.ones(42))[30:], 2.0)


def test_sizes_at_one_blur_keep_the_second_moment():
    """Blur adds its square to a fourth of the half axis' square."""
    fits = SimpleNamespace(axes_px=np.array([[3.0, 2.0], [3.0, 2.0], [1.0, 1.0]]), blur_px=np.array([0.8, 0.5, 0.1]))
    got = size_at_blur(fits, 0.8)
    np.testing.assert_allclose(got[0], 3.0)
    np.testing.assert_allclose(got[1] ** 2 / 4 + 0.8**2, 9 / 4 + 0.5**2)
    assert got[2] == 0.0


def grazing(change=None, **fields):
    """Twelve round markers and one more at their middle, of which something is different."""
    rng = np.random.default_rng(3)
    n = 13
    xy = np.r_[rng.uniform(0, 100, (12, 2)), [[50.0, 50.0]]]
    fits = SimpleNamespace(
        xy=xy, axes_px=np.tile([6.0, 6.0], (n, 1)), angle=np.zeros(n), blur_px=np.full(n, 0.7),
        radius_px=np.full(n, 6.0),
        cov=np.tile(1e-4 * np.eye(2), (n, 1, 1)), depth=np.full(n, 80.0), depth_sigma=np.full(n, 0.1),
        noise=np.ones(n), converged=np.ones(n, bool), frame=SimpleNamespace(blur_px=0.7),
    )  # fmt: skip
    contrast, typical, weight, least = np.full(n, 0.8), np.arange(n) < 12, np.full(n, 1e6), 1.0
    for name, value in fields.items():
        getattr(fits, name)[-1] = value
    contrast[-1] = 0.8 if change is None else change
    return at_grazing_angle(fits, contrast, typical, weight, np.ones(n), np.zeros((n, 2)), least)[-1]


@pytest.mark.parametrize(
    ("inside", "outside"),
    [
        ({"axes_px": [6.0, 6 * GRAZING * 1.02]}, {"axes_px": [6.0, 6 * GRAZING * 0.96]}),  # 72 degrees of tilt
        ({"axes_px": [6 * (1 + 0.08), 6.0]}, {"axes_px": [6 * (1 + 0.10), 6.0]}),  # three times 3 % longer
        ({"axes_px": [6 * (1 - 0.08), 5.0]}, {"axes_px": [6 * (1 - 0.10), 5.0]}),
        ({"change": 0.8 * 1.08}, {"change": 0.8 * 1.10}),
        ({"change": -0.8 * 0.92}, {"change": 0.8 * 0.90}),
        ({"noise": 1.05}, {"noise": 1.2}),
        ({"converged": True}, {"converged": False}),
        ({"cov": 0.1**2 * np.eye(2), "axes_px": [6.6, 6.0]}, {"cov": 0.01**2 * np.eye(2), "axes_px": [6.6, 6.0]}),
    ],
)
def test_a_tilted_member_of_the_family_is_as_long_and_as_dark(inside, outside):
    assert grazing(**inside)
    assert not grazing(**outside)
