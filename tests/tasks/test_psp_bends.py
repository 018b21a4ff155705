"""Bends of a ratio within coarse cells: what both pictures show alike stays out, a bend of its own is taken off."""

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.resection import footprint_values, footprints, map_pixels, see_nodes
from windmark.scene import Mesh, structured_triangles
from windmark.tasks.psp.bends import bend_of_ratio, joined_cells, mean_cells

CAMERA = Camera((240, 180), 300.0)
VIEW = Pose.look_at(np.array([0.0, 0.0, 90.0]), np.zeros(3), [0.0, 1.0, 0.0])
SIGMA = 0.003


def plate(n=15, size=50.0):
    x, y = np.meshgrid(np.linspace(-size / 2, size / 2, n), np.linspace(-size / 2, size / 2, n))
    return Mesh.make(np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()]), structured_triangles(n, n), "wing")


@pytest.fixture(scope="module")
def seen():
    mesh = plate()
    view = see_nodes(mesh, CAMERA, VIEW)
    return mesh, view, footprints(map_pixels(mesh, CAMERA, VIEW), view)


def ratio(seen, bend, seed=3):
    """Ratio without correction, what is taken off, its variance, and the truth; light has grain in both pictures."""
    mesh, view, cells = seen
    x, y = np.mgrid[:180, :240][::-1].astype(float)
    grain = 1 + 0.03 * np.cos(x / 3.0) * np.cos(y / 3.5)
    true = lambda u, v: 1.2 + bend * (u - 119.5) ** 2 + 0.001 * v  # noqa: E731
    rng = np.random.default_rng(seed)

    def planes(light):
        noisy = light * (1 + SIGMA * rng.standard_normal(light.shape))
        return footprint_values(noisy, (SIGMA * light) ** 2, cells, mesh.triangles, view.xy, straight=True)

    off, on = planes(1000 * grain), planes(1000 * grain / true(x, y))
    cells_off, cells_on = (mean_cells([of.planes], view.xy, 1.0) for of in (off, on))
    value = off.value / on.value
    taken, added = bend_of_ratio(value, cells_off, cells_on, mesh.triangles)
    inner = (np.abs(mesh.vertices[:, :2]) < 22).all(axis=1)
    return value, taken, added, true(*view.xy.T), inner


def test_light_that_both_pictures_show_bent_alike_is_left_alone(seen):
    """Beyond sqrt(2 ln n) sigmas is one node in four such draws."""
    draws = [ratio(seen, 0.0, seed) for seed in range(4)]
    assert sum((taken != 0).sum() for _, taken, *_ in draws) <= 4
    for value, taken, added, true, inner in draws:
        assert ((added > 0) == (taken != 0)).all()
        assert np.std((value / true)[inner]) < 1.2 * SIGMA * np.sqrt(2 / seen[2].count[inner].mean())


def test_a_bend_of_the_ratio_itself_is_taken_off_and_makes_it_less_sure(seen):
    value, taken, added, true, inner = ratio(seen, 2e-4)
    assert (taken != 0)[inner].mean() > 0.8
    left = np.abs(value - taken - true)[inner]
    assert np.median(left) < 0.35 * np.median(np.abs(value - true)[inner])
    assert (added[inner & (taken != 0)] > taken[inner & (taken != 0)] ** 2).all()


def test_cells_of_two_references_are_those_of_their_mean(seen):
    mesh, view, cells = seen
    light = np.full((180, 240), 500.0)
    one = mean_cells([footprint_values(light, light, cells, mesh.triangles, view.xy, straight=True).planes], view.xy, 1)
    share = np.zeros((2, len(view)))
    share[:, 1:] = 0.5
    both = joined_cells([one, one], share)
    assert np.isnan(both.noise[0])
    assert np.isnan(both.unit[0]).all()
    np.testing.assert_allclose(both.noise[1:], 0.5 * one.noise[1:])
    np.testing.assert_allclose(both.moments[1:], one.moments[1:])
