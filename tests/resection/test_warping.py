"""A picture recomputed through a map: as if every pixel's place had been computed by itself."""

import numpy as np
import pytest

from windmark.resection import interpolate_image, warp_image, warping


def picture(seed=0, shape=(90, 140)):
    y, x = np.mgrid[: shape[0], : shape[1]]
    grain = np.random.default_rng(seed).normal(0, 3, shape)
    return (100 + 20 * np.sin(x / 5) * np.cos(y / 7) + grain).astype(np.float32)


def pixels(width, height):
    return np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(float)


def bent(xy):
    x, y = xy.T
    return np.stack([x + 3.3 + 2 * np.sin(y / 40), 0.98 * y + 1.7 + 1e-4 * x**2], axis=1)


def direct(image, place, size):
    at = pixels(*size)
    return interpolate_image(image, place(at.reshape(-1, 2)).reshape(at.shape))


@pytest.mark.parametrize("size", [(140, 90), (33, 65), (1, 1), (200, 7)])
def test_warp_is_the_interpolation_at_every_pixels_place(size):
    image = picture()
    got, want = warp_image(image, bent, size), direct(image, bent, size)
    assert got.shape == (size[1], size[0])
    assert got.dtype == np.float32
    assert np.array_equal(np.isnan(got), np.isnan(want))
    assert np.nanmax(np.abs(got - want), initial=0) < 0.02  # the steepest slope is some 20 levels/px


def test_nothing_moved_gives_the_picture_itself():
    image = picture()
    image[20, 30] = np.nan
    got = warp_image(image, lambda xy: xy.copy(), (140, 90))
    assert np.array_equal(got, image, equal_nan=True)


def test_nan_pixels_and_the_border_are_as_in_interpolate_image():
    image = picture(1)
    image[40:42, 50:53] = np.nan
    shifted = lambda xy: xy + np.array([0.4, -0.3])  # noqa: E731
    got, want = warp_image(image, shifted, (140, 90)), direct(image, shifted, (140, 90))
    assert np.array_equal(np.isnan(got), np.isnan(want))
    assert np.nanmax(np.abs(got - want)) < 1e-4


def test_a_place_that_is_nan_shows_nothing():
    def half(xy):
        return np.where(xy[:, :1] > 70, np.nan, xy)

    got = warp_image(picture(), half, (140, 90))
    assert np.isfinite(got[:, :32]).all()
    assert np.isnan(got[:, 71:]).all()


def test_colours_are_recomputed_alike():
    image = np.stack([picture(k) for k in range(3)], axis=-1)
    got = warp_image(image, bent, (140, 90))
    assert got.shape == (90, 140, 3)
    assert np.array_equal(got[..., 1], warp_image(image[..., 1], bent, (140, 90)), equal_nan=True)


def test_places_between_the_nodes_are_as_exact_as_asked_for():
    """On a ramp the value is the place: 1 level per px."""
    ramp = np.tile(np.arange(300, dtype=np.float32), (200, 1))
    got = warp_image(ramp, bent, (250, 180))
    at = pixels(250, 180)
    want = bent(at.reshape(-1, 2))[:, 0].reshape(180, 250)
    inside = np.isfinite(got) & (want > 1) & (want < 298)
    assert np.abs(got - want)[inside].max() < 1e-3


def test_wrong_usage_is_said():
    with pytest.raises(ValueError, match="size_px must be positive"):
        warp_image(picture(), bent, (0, 5))
    with pytest.raises(ValueError, match="image must be"):
        warp_image(np.zeros(5), bent, (5, 5))


def test_weights_between_nodes_are_exact_for_parabolas():
    """Nodes at -1, 0, 1, 2 of four weights; Catmull and Rom's are exact up to the second power."""
    f = np.linspace(0, 1, 11)
    w = np.stack(warping._weights(f), axis=1)
    for power in range(3):
        np.testing.assert_allclose(w @ np.array([-1.0, 0, 1, 2]) ** power, f**power, atol=1e-12)
    x, y = np.meshgrid(np.arange(-8.0, 40, 8), np.arange(-8.0, 40, 8))
    nodes = np.stack([x * y + x**2, y**2 - 3 * x], axis=-1)
    xy = np.random.default_rng(1).uniform(0, 23, (40, 2))
    a, b = xy.T
    np.testing.assert_allclose(
        warping._between(nodes, 8, xy), np.stack([a * b + a**2, b**2 - 3 * a], axis=1), atol=1e-9
    )
