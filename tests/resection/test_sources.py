"""What one picture says at points: shares of noise, gradients and variances of place, against what they are made of."""

from dataclasses import replace

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.resection import NoiseLaw, Picture, interpolate_image, see_nodes
from windmark.resection.sources import (
    EDGE_PX,
    LEAST_SHARE,
    Prepared,
    _gradient,
    _noise_share,
    _of_mixing,
    _of_place,
    _smooth,
    pixel_variance,
    prepare,
    take,
    value_variance,
)
from windmark.scene import Mesh

SIDE = 9
CAMERA = Camera((40, 30), 60.0)
ABOVE = Pose.look_at([1.0, -2.0, 9.0], [0.2, 0.1, 0.0], [0.1, 1.0, 0.0])
SHEET = Mesh.make([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]], [[0, 1, 2]])


def source(pixels, interpolation="cubic", noise=0.0, **picture):
    """A picture that is ready to be asked; where nobody needs a camera it has none of its own."""
    size = np.shape(pixels)[1::-1]
    camera = CAMERA if size == CAMERA.size_px else Camera(size, 50.0)
    given = Picture("p", pixels, camera, ABOVE, noise, **picture)
    law, inside = NoiseLaw(noise**2, 0.0, 0.0), np.full(np.shape(pixels), np.inf)
    return Prepared(given, np.asarray(pixels, dtype=np.float32), law, interpolation, inside)


def places(rng):
    """Anywhere, on pixels, and at the very border."""
    some = rng.uniform(0, SIDE - 1, (300, 2))
    whole = np.stack(np.meshgrid(np.arange(SIDE), np.arange(SIDE)), axis=-1).reshape(-1, 2).astype(float)
    edge = some[:60].copy()
    edge[:30, 0], edge[30:, 1] = 0.0, SIDE - 1.0
    return np.concatenate([some, whole, edge])


@pytest.mark.parametrize("interpolation", ["nearest", "linear", "cubic"])
@pytest.mark.parametrize("missing", [(), ((4, 4),), ((2, 6), (8, 0))])
def test_the_share_of_noise_is_the_sum_of_the_squared_weights(rng, interpolation, missing):
    """The weights themselves: a picture of one bright pixel for each of all pixels."""
    xy = places(rng)
    impulses = np.eye(SIDE * SIDE).reshape(SIDE, SIDE, -1)
    pixels = np.zeros((SIDE, SIDE))
    for row, column in missing:
        impulses[row, column] = np.nan
        pixels[row, column] = np.nan
    weights = interpolate_image(impulses, xy, interpolation=interpolation).astype(float)
    known = np.isfinite(weights).all(axis=1)
    assert known.sum() > 300
    share = _noise_share(source(pixels, interpolation), xy)
    np.testing.assert_allclose(share[known], (weights[known] ** 2).sum(axis=1), rtol=1e-5)


def test_gradients_of_a_slope_are_its_own_also_next_to_what_is_missing(rng):
    y, x = np.mgrid[:SIDE, :SIDE].astype(float)
    pixels = 3.0 * x - 5.0 * y
    pixels[4, 4] = np.nan
    xy = places(rng)
    here = np.isfinite(interpolate_image(pixels, xy, interpolation="linear"))
    gradient = _gradient(source(pixels), xy[here])
    np.testing.assert_allclose(gradient, np.tile([3.0, -5.0], (here.sum(), 1)), atol=1e-4)
    alone = np.full((SIDE, SIDE), np.nan)
    alone[3, 3] = 7.0
    np.testing.assert_array_equal(_gradient(source(alone), np.array([[3.0, 3.0]])), [[0.0, 0.0]])


def test_the_variance_of_one_pixel_is_that_of_the_nearest_one(rng):
    sigma = rng.uniform(1, 2, (30, 40))
    picture = Picture("p", np.ones((30, 40)), CAMERA, ABOVE, sigma)
    ready = prepare(picture, SHEET, "linear", "verb")
    xy = np.array([[0.0, 0.0], [39.4, 29.4], [-0.5, 12.2], [7.4, 3.6], [39.0, 0.0]])
    np.testing.assert_allclose(pixel_variance(ready, np.ones(5), xy), sigma[[0, 29, 12, 4, 0], [0, 39, 0, 7, 39]] ** 2)
    one = prepare(replace(picture, noise=3.0), SHEET, "linear", "verb")
    np.testing.assert_allclose(pixel_variance(one, np.ones(5), xy), 9.0)


@pytest.mark.parametrize(
    ("noise", "fine"),
    [(0.0, True), (-1.0, False), (np.ones((30, 40)), True), (np.ones((40, 30)), False), (np.ones(40), False),
     (np.zeros((30, 40)), True), (-np.eye(30, 40), False)],
)  # fmt: skip
def test_noise_is_one_sigma_or_one_for_each_pixel(noise, fine):
    picture = Picture("p", np.ones((30, 40)), CAMERA, ABOVE, noise)
    if fine:
        assert prepare(picture, SHEET, "linear", "verb")
        return
    with pytest.raises(ValueError, match=r"verb: noise must be a sigma >= 0, or one for each pixel"):
        prepare(picture, SHEET, "linear", "verb")


@pytest.mark.parametrize("shape", [(5, 5), (6,), (6, 7), (7, 6)])
def test_a_covariance_of_another_shape_is_no_poses(shape):
    picture = Picture("p", np.ones((30, 40)), CAMERA, ABOVE, 1.0, np.ones(shape))
    with pytest.raises(ValueError, match=r"verb: pose_cov must be \(6, 6\)"):
        prepare(picture, SHEET, "linear", "verb")


@pytest.mark.parametrize("focal", [False, True])
def test_the_pose_moves_values_by_the_gradient(rng, focal):
    """On a slope the value is linear in the place: its variance is that of small motions, done one by one."""
    y, x = np.mgrid[:30, :40].astype(float)
    size = 7 if focal else 6
    root = 1e-3 * rng.normal(size=(size, size))
    cov = root @ root.T
    ready = source(2.0 * x + 3.0 * y, pose_cov=cov)
    xyz = rng.uniform(-1, 1, (20, 3)) * [2.0, 1.5, 0.3]

    def value(delta):
        camera = replace(CAMERA, focal_px=CAMERA.focal_px + (delta[6] if focal else 0.0))
        return camera.project((Pose.exp(delta[:6]) @ ABOVE).apply(xyz))[0] @ [2.0, 3.0]

    step = 1e-5
    by = np.stack([(value(d) - value(-d)) / (2 * step) for d in step * np.eye(size)], axis=1)
    cam = ABOVE.apply(xyz)
    xy = CAMERA.project(cam)[0]
    jacobian = CAMERA.point_jacobian(cam)[2]
    expected = np.einsum("nj,jk,nk->n", by, cov, by)
    np.testing.assert_allclose(_of_place(ready, cam, jacobian, xy), expected, rtol=1e-3)
    # The nearest pixel's value is that of a place up to half a pixel off, evenly in x and in y.
    rounded = _of_place(replace(ready, interpolation="nearest"), cam, jacobian, xy)
    np.testing.assert_allclose(rounded - expected, (2.0**2 + 3.0**2) / 12, rtol=1e-2)
    exact = source(2.0 * x + 3.0 * y, "nearest")
    np.testing.assert_allclose(_of_place(exact, cam, jacobian, xy), (2.0**2 + 3.0**2) / 12, rtol=1e-3)
    still = source(2.0 * x + 3.0 * y)
    np.testing.assert_array_equal(_of_place(still, cam, jacobian, xy), np.zeros(20))


def test_places_of_points_that_are_not_known_are_in_their_values(rng):
    y, x = np.mgrid[:30, :40].astype(float)
    vertices = rng.uniform(-1, 1, (12, 3)) * [2.0, 1.5, 0.0]
    mesh = Mesh.make(vertices, np.arange(12).reshape(-1, 3))
    view = see_nodes(mesh, CAMERA, ABOVE)
    ready = source(2.0 * x + 3.0 * y, noise=0.5)
    root = rng.normal(size=(12, 3, 3)) * 0.01
    value = np.where(np.arange(12) == 3, np.nan, 1.0)
    plain = value_variance(ready, view, vertices, value)
    known = value_variance(ready, view, vertices, value, root @ root.transpose(0, 2, 1))

    def at(xyz):
        return CAMERA.project(ABOVE.apply(xyz))[0] @ [2.0, 3.0]

    by = np.stack([(at(vertices + d) - at(vertices - d)) / 2e-5 for d in 1e-5 * np.eye(3)], axis=1)
    expected = ((by[:, None] @ root)[:, 0] ** 2).sum(axis=1)
    good = np.isfinite(value)
    assert np.isnan(plain[3])
    np.testing.assert_allclose((known - plain)[good], expected[good], rtol=1e-3)
    np.testing.assert_allclose(plain[good], 0.25 * _noise_share(ready, view.xy[good]), rtol=1e-6)


def test_next_to_an_outline_a_value_may_be_anywhere_within_the_mixed_pixels(rng):
    _, x = np.mgrid[:30, :40].astype(float)
    ready = replace(source(2.0 * x), inside_px=np.abs(x - 20.0))
    xy = np.array([[20.0, 8.0], [20 + 0.9 * EDGE_PX, 8.0], [20 + 1.1 * EDGE_PX, 8.0], [5.0, 9.0]])
    # Evenly within +- EDGE_PX: a third of its square.
    mixed = 2.0**2 * EDGE_PX**2 / 3
    np.testing.assert_allclose(_of_mixing(ready, xy), [mixed, mixed, 0.0, 0.0], rtol=1e-4)
    np.testing.assert_array_equal(_of_mixing(replace(ready, inside_px=np.full((30, 40), np.inf)), xy), np.zeros(4))


def test_a_cubic_surface_takes_one_pixel_farther_from_an_outline():
    """What it takes is its difference to a linear one; beyond, where it is curved all the same, there is no outline."""
    _, x = np.mgrid[:30, :40].astype(float)
    ready = replace(source(np.where(x >= 20, 100.0, 0.0)), inside_px=np.abs(x - 20.0))
    xy = np.array([[18.3, 8.0], [17.4, 8.0]])
    cubic = interpolate_image(ready.pixels, xy, interpolation="cubic")
    assert abs(cubic[0]) > 1.0
    np.testing.assert_allclose(_of_mixing(ready, xy), [cubic[0] ** 2, 0.0], rtol=1e-4)
    np.testing.assert_array_equal(_of_mixing(replace(ready, interpolation="linear"), xy), np.zeros(2))


def test_the_weight_is_the_number_of_pixels_on_a_patch_over_the_noise(rng):
    """Counted on a small square of the surface at each node, projected."""
    x, y = np.meshgrid(np.linspace(-1.5, 1.5, 5), np.linspace(-1, 1, 4))
    vertices = np.stack([x.ravel(), y.ravel(), 0.3 * x.ravel()], axis=1)
    mesh = Mesh.make(vertices, np.array([[0, 1, 6], [0, 6, 5]]))
    normal = np.tile(np.array([-0.3, 0, 1]) / np.hypot(0.3, 1), (20, 1))
    pixels = np.full((30, 40), 5.0)
    view = see_nodes(mesh, CAMERA, ABOVE)
    ready = source(pixels, noise=0.5)
    taken = take(ready, view, vertices, normal, max_obliquity_deg=90.0, taper_deg=1e-9, taper_px=1e-9)
    good = np.isfinite(taken.value)
    assert good.sum() >= 4
    u, v = np.array([1, 0, 0.3]) / np.hypot(0.3, 1), np.array([0.0, 1, 0])
    h = 1e-4

    def along(d):
        return (CAMERA.project(ABOVE.apply(vertices + h * d))[0] - CAMERA.project(ABOVE.apply(vertices - h * d))[0]) / (
            2 * h
        )

    area = np.abs(np.linalg.det(np.stack([along(u), along(v)], axis=1)))
    np.testing.assert_allclose(taken.weight[good], area[good] / 0.25, rtol=1e-5)
    np.testing.assert_array_equal(taken.taper[good], 1.0)
    assert (taken.weight[~good] == 0).all()
    perfect = take(source(pixels), view, vertices, normal, max_obliquity_deg=90.0, taper_deg=1e-9, taper_px=1e-9)
    np.testing.assert_allclose(perfect.weight[good], area[good], rtol=1e-5)
    # At the border of what may be seen a share is left: where nobody else sees the node its value stays.
    steep = take(ready, view, vertices, normal, max_obliquity_deg=0.0, taper_deg=5.0, taper_px=1e-9)
    np.testing.assert_allclose(steep.weight[good], LEAST_SHARE * area[good] / 0.25, rtol=1e-5)


def test_a_taper_is_smooth_and_symmetric():
    t = np.linspace(-1, 2, 301)
    s = _smooth(t)
    assert (s[t <= 0] == 0).all()
    assert (s[t >= 1] == 1).all()
    assert (np.diff(s) >= 0).all()
    np.testing.assert_allclose(s + _smooth(1 - t), 1.0)
    slope = np.diff(s) / np.diff(t)
    assert np.abs(np.diff(slope)).max() < 0.08  # no corner
