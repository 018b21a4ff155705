"""How well a lens is known though its coefficients stand for one another: against images moved by draws of them."""

from dataclasses import replace

import numpy as np
import pytest

from windmark.calibration.lens_known import RADIAL, radial_spread
from windmark.geometry import Camera
from windmark.geometry.camera import PARAMETERS

LENS = Camera((800, 600), 700.0, 1.0, 380.0, 310.0, k1=-0.1, k2=0.05, k4=0.2, k5=0.02, lens="rational")


def test_the_spread_is_the_largest_over_the_image_of_small_draws():
    rng = np.random.default_rng(2)
    index = [PARAMETERS.index(p) for p in RADIAL]
    root = 1e-4 * rng.normal(size=(6, 6))
    cov = np.zeros((14, 14))
    cov[np.ix_(index, index)] = root @ root.T
    cov[0, 0] = 100.0  # the focal length is another matter
    far = np.array([799.0, 0.0]) - [380.0, 310.0]
    rays = LENS.directions(np.array([380.0, 310.0]) + np.linspace(0, 1, 40)[1:, None] * far)
    draws = rng.normal(size=(2000, 6)) @ root.T
    moved = []
    for step in draws[:400]:
        camera = replace(LENS, **{p: getattr(LENS, p) + d for p, d in zip(RADIAL, step, strict=True)})
        moved.append(np.linalg.norm(camera.project(rays)[0] - LENS.project(rays)[0], axis=1))
    share = np.sqrt((np.array(moved) ** 2).mean(axis=0)) / np.linalg.norm(
        LENS.project(rays)[0] - [380.0, 310.0], axis=1
    )
    assert radial_spread(LENS, cov) == pytest.approx(share.max(), rel=0.12)  # 400 draws: 3.5 % (one sigma)


def test_what_moves_no_image_is_no_spread():
    """A change of numerator and denominator alike, of a lens that has none: the images stay where they are."""
    plain = Camera((800, 600), 700.0, lens="rational")
    along = np.zeros(14)
    along[[PARAMETERS.index("k1"), PARAMETERS.index("k4")]] = 1.0
    assert radial_spread(plain, np.outer(along, along)) == pytest.approx(0.0, abs=1e-9)
    alone = np.zeros((14, 14))
    alone[4, 4] = 0.01**2
    corner = ((399.5**2 + 299.5**2) / 700.0**2) * 0.01
    assert radial_spread(plain, alone) == pytest.approx(corner, rel=1e-3)
