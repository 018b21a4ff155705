"""A picture at nodes by all pixels nearest to each: exact for planes, noise as stated and independent, bends undone."""

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.resection import footprint_values, footprints, map_pixels, see_nodes
from windmark.scene import Mesh, structured_triangles

CAMERA = Camera((240, 180), 300.0)
OBLIQUE = Pose.look_at(np.array([60.0, 20.0, 90.0]), np.zeros(3), [0.0, 1.0, 0.0])
"""The plate is seen at 35 degrees: its cells are no squares of pixels."""


def plate(n=11, size=50.0, bend=0.0):
    x, y = np.meshgrid(np.linspace(-size / 2, size / 2, n), np.linspace(-size / 2, size / 2, n))
    return Mesh.make(np.column_stack([x.ravel(), y.ravel(), bend * x.ravel() ** 2]), structured_triangles(n, n), "wing")


def places():
    """(2, H, W) x and y of the pixels."""
    return np.mgrid[:180, :240][::-1].astype(float)


@pytest.fixture(scope="module")
def seen():
    """The grid, its nodes in the picture, and their pixels."""
    mesh = plate()
    view = see_nodes(mesh, CAMERA, OBLIQUE)
    return mesh, view, footprints(map_pixels(mesh, CAMERA, OBLIQUE), view)


def fit(seen, image, variance=1.0):
    mesh, view, cells = seen
    return footprint_values(image, np.broadcast_to(variance, image.shape), cells, mesh.triangles, view.xy)


def test_every_pixel_of_the_surface_belongs_to_one_node(seen):
    mesh, _, cells = seen
    assert len(np.unique(cells.pixel)) == len(cells.pixel) == map_pixels(mesh, CAMERA, OBLIQUE).valid.sum()
    assert cells.count.sum() == len(cells.pixel)
    assert (np.linalg.norm(cells.offset, axis=1) < 16).all()  # a cell is about 13 x 16 pixels
    inner = (np.abs(mesh.vertices[:, :2]) < 22).all(axis=1)
    assert np.ptp(cells.count[inner]) < 0.9 * cells.count[inner].mean()


def test_a_plane_is_met_whichever_pixels_are_missing(seen):
    x, y = places()
    image = 300 + 2.0 * x - 0.7 * y
    rng = np.random.default_rng(1)
    image[rng.random(image.shape) < 0.4] = np.nan
    got = fit(seen, image, 4.0)
    view = seen[1]
    np.testing.assert_allclose(got.value, 300 + view.xy @ [2.0, -0.7], rtol=1e-10)
    np.testing.assert_allclose(got.slope, np.tile([2.0, -0.7], (len(view), 1)), rtol=1e-8)
    np.testing.assert_allclose(got.bent, 0, atol=1e-8)


def test_noise_is_as_stated_and_independent_from_node_to_node(seen):
    """Rays of 3 % shot noise on two levels of light; neighbours share no pixel."""
    x, _ = places()
    variance = np.where(x > 120, 9.0, 1.0)
    rng = np.random.default_rng(2)
    drawn = [fit(seen, 100 + np.sqrt(variance) * rng.standard_normal(x.shape), variance) for _ in range(200)]
    plane = np.array([d.value + d.bent for d in drawn])
    stated = drawn[0].variance
    ratio = plane.var(axis=0) / stated
    assert 0.92 < ratio.mean() < 1.02  # the stated one is 3 to 5 % too large (six seeds: 0.946 to 0.970 +- 0.008)
    assert ratio.min() > 0.55
    assert ratio.max() < 1.5
    z = (plane - 100) / np.sqrt(stated)
    neighbours = np.mean(z[:, :-1] * z[:, 1:])
    assert abs(neighbours) < 0.02
    # What the bend takes off for nothing costs a sixth of the variance, and is stated.
    value, variance = np.array([d.value for d in drawn]), np.array([d.variance for d in drawn])
    assert abs(np.mean((value - 100) ** 2 / variance) - 1) < 0.06
    assert np.mean(value.var(axis=0) / plane.var(axis=0)) < 1.2


@pytest.mark.parametrize("bend", [0.002, -0.004])
def test_a_hollow_is_as_deep_as_it_is(seen, bend):
    """The mean of a cell lies above its bottom: 0.2 to 0.5 grey levels here, with noise of 0.01."""
    x, y = places()
    image = 50 + bend * ((x - 120) ** 2 + 0.5 * (y - 90) ** 2)
    got = fit(seen, image + 0.01 * np.random.default_rng(3).standard_normal(image.shape), 1e-4)
    mesh, view, _ = seen
    inner = (np.abs(mesh.vertices[:, :2]) < 22).all(axis=1)
    true = 50 + bend * ((view.xy[:, 0] - 120) ** 2 + 0.5 * (view.xy[:, 1] - 90) ** 2)
    assert np.abs(got.bent[inner]).min() > 20 * 0.01 / np.sqrt(150)
    assert np.abs(got.value - true)[inner].max() < 0.12 * np.abs(got.bent[inner]).max()


def test_too_few_pixels_or_pixels_on_a_line_say_nothing(seen):
    mesh, view, _ = seen
    pixels = map_pixels(mesh, CAMERA, OBLIQUE)
    x, _ = places()
    node = int(np.argmin(np.linalg.norm(mesh.vertices, axis=1)))
    column = round(view.xy[node, 0])
    cells = footprints(pixels, view, np.abs(x - column) < 0.5)
    got = footprint_values(x, np.ones_like(x), cells, mesh.triangles, view.xy)
    assert cells.count[node] > 5
    assert np.isnan(got.value[node])
    assert np.isnan(got.value).all()
    nothing = footprints(pixels, view, np.zeros(x.shape, bool))
    empty = footprint_values(x, np.ones_like(x), nothing, mesh.triangles, view.xy)
    assert np.isnan(empty.value).all()
    assert not empty.bent.any()


def test_sizes_that_do_not_fit_are_refused(seen):
    with pytest.raises(ValueError, match=r"\(180, 240\)"):
        fit(seen, np.zeros((5, 5)))
    with pytest.raises(ValueError, match="121 nodes"):
        footprints(map_pixels(seen[0], CAMERA, OBLIQUE), see_nodes(plate(5), CAMERA, OBLIQUE))


def test_the_noise_of_nodes_is_that_of_pixels_in_their_unit(seen):
    """Values of another unit: every variance, that of a bend with it, has the unit's square."""
    x, y = places()
    image = 50 + 0.002 * (x - 120) ** 2 + 0.001 * (y - 90) ** 2
    one, other = fit(seen, image, 0.3), fit(seen, 5 * image, 25 * 0.3)
    np.testing.assert_allclose(other.value, 5 * one.value)
    np.testing.assert_allclose(other.bent, 5 * one.bent, atol=1e-9)
    np.testing.assert_allclose(other.variance, 25 * one.variance)
