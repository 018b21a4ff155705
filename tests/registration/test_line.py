"""How far points are off a line, against the singular values."""

import numpy as np
import pytest

from windmark.registration.search.layout import Layout
from windmark.registration.task import off_line, on_line
from windmark.scene import MarkerSet


@pytest.mark.parametrize("axes", [2, 3])
@pytest.mark.parametrize("width", [1.0, 1e-3, 1e-7])
def test_distance_is_that_of_the_singular_values(axes, width):
    rng = np.random.default_rng(1)
    turn = np.linalg.qr(rng.normal(size=(axes, axes)))[0]
    points = rng.normal(size=(30, axes)) * ([100.0] + [width] * (axes - 1)) @ turn.T
    values = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    expected = np.sqrt((values[1:] ** 2).sum() / 30)
    assert off_line(points) == pytest.approx(expected, rel=1e-6, abs=1e-5)


def test_points_at_one_place_are_on_a_line():
    assert off_line(np.ones((5, 2))) == 0.0
    assert on_line(np.ones((5, 3)))


@pytest.mark.parametrize(("width", "expected"), [(1e-6, True), (0.1, False)])
def test_markers_on_a_line(width, expected):
    rng = np.random.default_rng(2)
    xyz = np.linspace(0, 10, 12)[:, None] * [1.0, 2.0, -1.0] + rng.normal(0, width, (12, 3))
    assert on_line(xyz) == expected
    assert Layout(MarkerSet.make([f"m{k}" for k in range(12)], xyz)).on_line == expected
