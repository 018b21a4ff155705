"""Values of images: exact where they must be, NaN where nothing is known."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from windmark.geometry import Camera
from windmark.resection import INTERPOLATIONS, interpolate_image, node_values, sample, see_nodes

sys.path.insert(0, str(Path(__file__).parent))
from resection_shapes import box, looking_at, pixel_grid, plate

CAMERA = Camera((64, 48), 60.0, k1=-0.05)


def image_of(function, camera=CAMERA):
    xy = pixel_grid(camera)
    return function(xy[..., 0], xy[..., 1]).astype(np.float32)


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.int32, np.float32, np.float64, bool])
def test_pixel_centres_have_their_own_value(interpolation, dtype, rng):
    image = (rng.uniform(0, 250, (48, 64)) > 120 if dtype is bool else rng.uniform(0, 250, (48, 64))).astype(dtype)
    xy = pixel_grid(CAMERA) + rng.uniform(-5e-7, 5e-7, (48, 64, 2))
    got = interpolate_image(image, xy, interpolation=interpolation)
    assert got.dtype == np.float32
    np.testing.assert_array_equal(got, image.astype(np.float32))


def test_linear_is_exact_for_planes_and_cubic_for_parabolas(rng):
    xy = rng.uniform(2, 45, (500, 2))
    x, y = xy.T
    plane = image_of(lambda x, y: 3 + 2 * x - y + 0.5 * x * y)
    np.testing.assert_allclose(
        interpolate_image(plane, xy, interpolation="linear"), 3 + 2 * x - y + 0.5 * x * y, rtol=1e-6
    )
    bowl = image_of(lambda x, y: x * x - 0.5 * y * y + x * y)
    np.testing.assert_allclose(interpolate_image(bowl, xy), x * x - 0.5 * y * y + x * y, atol=2e-4)
    assert np.abs(interpolate_image(bowl, xy, interpolation="linear") - (x * x - 0.5 * y * y + x * y)).max() > 0.1


def test_border():
    image = image_of(lambda x, y: x + 10 * y)
    at = [
        [-0.5, 0],
        [0.25, 0.0],
        [63.5, 47.5],
        [63.0, 46.5],
        [-0.51, 0],
        [63.51, 3],
        [3, 47.6],
        [np.nan, 1],
        [np.inf, 1],
    ]
    want = [0, 0.25, 533, 528, np.nan, np.nan, np.nan, np.nan, np.nan]
    for interpolation in ("linear", "cubic"):
        np.testing.assert_allclose(interpolate_image(image, at, interpolation=interpolation), want, rtol=1e-6)
    np.testing.assert_array_equal(
        interpolate_image(image, [[0.4, 0.6], [-0.5, -0.5]], interpolation="nearest"), [10, 0]
    )


@pytest.mark.parametrize("size", [1, 2, 3])
def test_tiny_images(size):
    image = np.arange(size * size, dtype=np.float32).reshape(size, size)
    middle = (size - 1) / 2
    for interpolation in ("linear", "cubic"):
        got = interpolate_image(image, [[middle, middle]], interpolation=interpolation)
        np.testing.assert_allclose(got, image.mean())


def test_nan_pixels_spread_no_further_than_their_weight():
    image = image_of(lambda x, y: x * x + y * y)
    image[20, 30] = np.nan
    linear = interpolate_image(image, [[29.5, 20], [29.5, 19], [28.9, 20], [30, 19], [30, 20]], interpolation="linear")
    np.testing.assert_array_equal(np.isnan(linear), [True, False, False, False, True])
    cubic = interpolate_image(image, [[29.5, 20], [28.5, 20], [27.5, 20], [29, 20], [31, 21], [28.5, 21.5]])
    np.testing.assert_array_equal(np.isnan(cubic), [True, False, False, False, False, False])
    # One pixel away it is linear (the mean of 28 and 29 squared), two away cubic again.
    assert cubic[1] == pytest.approx((28**2 + 29**2) / 2 + 400)
    assert cubic[2] == pytest.approx(27.5**2 + 400)


def test_channels_are_apart(rng):
    image = rng.uniform(size=(48, 64, 3)).astype(np.float32)
    image[10:20, 10:20, 1] = np.nan
    xy = rng.uniform(5, 40, (7, 9, 2))
    got = interpolate_image(image, xy)
    assert got.shape == (7, 9, 3)
    for c in range(3):
        np.testing.assert_array_equal(got[..., c], interpolate_image(image[..., c], xy))


def test_values_on_nodes_and_points():
    mesh, pose = box(7), looking_at([3.0, 2.5, 2.0])
    image = image_of(lambda x, y: 100 + x + 2 * y)
    view = see_nodes(mesh, CAMERA, pose)
    got = node_values(image, view)
    np.testing.assert_array_equal(np.isfinite(got), view.visible)
    want = 100 + view.xy[:, 0] + 2 * view.xy[:, 1]
    np.testing.assert_allclose(got[view.visible], want[view.visible], rtol=1e-5)
    some = mesh.vertices[[0, 60, 100, 200]]
    np.testing.assert_allclose(
        sample(image, CAMERA, pose, some), 100 + (CAMERA.project(pose.apply(some))[0] @ [1, 2]), rtol=1e-5
    )
    hidden = sample(image, CAMERA, pose, mesh.vertices, mesh=mesh)
    assert np.isnan(hidden[mesh.vertices.max(axis=1) < 0.9]).all()
    np.testing.assert_array_equal(hidden[view.visible], got[view.visible])
    two = sample(np.stack([image, -image], axis=-1), CAMERA, pose, some, interpolation="linear")
    assert two.shape == (4, 2)
    np.testing.assert_array_equal(two[:, 0], -two[:, 1])


def test_wrong_arguments():
    image, pose, points = np.zeros((48, 64)), looking_at([3.0, 2.5, 2.0]), np.zeros((2, 3))
    view = see_nodes(plate(), CAMERA, pose)
    with pytest.raises(ValueError, match="64 x 48"):
        sample(image.T, CAMERA, pose, points)
    with pytest.raises(ValueError, match="64 x 48"):
        node_values(image[:-1], view)
    with pytest.raises(ValueError, match="nearest, linear, cubic"):
        sample(image, CAMERA, pose, points, interpolation="bicubic")
    with pytest.raises(ValueError, match="real numbers"):
        interpolate_image(image.astype(complex), [0, 0])
    with pytest.raises(ValueError, match="real numbers"):
        interpolate_image(image[0], [0, 0])
    with pytest.raises(ValueError, match="xy"):
        interpolate_image(image, [0, 0, 1])
    with pytest.raises(ValueError, match="xyz"):
        sample(image, CAMERA, pose, [0, 0, 1])
