"""Markers whose blurred rims overlap: fitted together they are as good as their bound, and say how good that is."""

import numpy as np
import pytest

from windmark.detection.template._kernels.touching import take_away
from windmark.detection.template.disc_model import patch_model
from windmark.detection.template.refine import refine_template
from windmark.detection.template.result import TOUCHING
from windmark.synth import disc_image

TILE, LEVEL, DEPTH, RADIUS = 45, 200.0, 140.0, 3.5


def pairs(seed, gap, count=30, noise=5.0):
    """`count` pairs of discs with `gap` px between the rims, then as many single discs; (3 count, 2) centres."""
    rng = np.random.default_rng(seed)
    image, xy = np.empty((6 * TILE, count // 3 * TILE)), np.empty((3 * count, 2))
    for k in range(2 * count):
        corner = TILE * np.array([k % (count // 3), k // (count // 3)])
        turn = rng.uniform(0, np.pi)
        away = (RADIUS + 0.5 * gap) * np.array([np.cos(turn), np.sin(turn)])
        middle = corner + TILE // 2 + rng.uniform(-0.5, 0.5, 2)
        centres = [middle - away, middle + away] if k < count else [middle]
        tile = np.ones((TILE, TILE))
        for c in centres:
            one = disc_image(
                (TILE, TILE), c - corner, RADIUS * np.ones(2), 0.0, level=1.0, depth=DEPTH / LEVEL, blur_px=0.7,
                subpixels=7,
            )  # fmt: skip
            tile = tile + one - 1.0  # paint does not lie on paint: blurred, the two take away a sum
        image[corner[1] : corner[1] + TILE, corner[0] : corner[0] + TILE] = LEVEL * tile
        xy[slice(2 * k, 2 * k + 2) if k < count else slice(count + k, count + k + 1)] = centres
    return image + rng.normal(0, noise, image.shape), xy


@pytest.mark.parametrize("gap", [0.5, 1.0])
def test_a_neighbour_costs_little_and_moves_nothing(gap):
    """Where its pixels are left out instead, pairs are 1.3 to 2.2 times as far off."""
    of_pairs, single, z = [], [], []
    for seed in (3, 4, 5):
        image, xy = pairs(seed, gap)
        fits = refine_template(image, xy + np.random.default_rng([seed, 1]).normal(0, 0.1, xy.shape), 3.4)
        good = fits.converged & (fits.flags & ~TOUCHING == 0)
        assert good.mean() > 0.9
        error = fits.xy - xy
        of_pairs += error[:60][good[:60]].ravel().tolist()
        single += error[60:][good[60:]].ravel().tolist()
        z += (error / np.sqrt(fits.cov[:, [0, 1], [0, 1]]))[:60][good[:60]].ravel().tolist()
        assert (fits.flags[:60] & TOUCHING > 0).all()
    assert np.std(of_pairs) < 1.25 * np.std(single)
    assert 0.5 < np.std(z) < 1.15


def test_what_a_disc_takes_away_is_its_model_without_the_light():
    params = np.array([1.3, -0.7, 3.0, 0.4, 2.6, 0.8, 90.0, 180.0, 0.01, -0.02])
    x = np.arange(23) - 11
    flat = params.copy()
    flat[6] = 0.0
    expected = patch_model(x, x, params)[0] - patch_model(x, x, flat)[0]
    patch = np.zeros((1, 23, 23))
    take_away(patch, np.ones_like(patch), np.zeros(1, dtype=np.int64), params[None], 1.0)
    np.testing.assert_allclose(-patch[0], expected, atol=0.03)
