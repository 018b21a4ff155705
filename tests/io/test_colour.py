"""Colour pictures and mosaics become grey levels without moving a marker."""

import numpy as np
import pytest

from windmark.detection.template.refine import refine_template
from windmark.io import MOSAICS, FileError, from_mosaic, read_grey, read_levels, to_grey, write_image
from windmark.io.colour import APART, made_of_saturated
from windmark.resection import noise_law

RNG = np.random.default_rng(3)


def mosaic_of(planes, pattern):
    """A sensor's picture of three planes (3, H, W)."""
    out = np.empty(planes.shape[1:])
    for k, letter in enumerate(pattern):
        j, i = divmod(k, 2)
        out[j::2, i::2] = planes["RGB".index(letter), j::2, i::2]
    return out


def slow_binomial(values):
    """The kernel pixel by pixel, mirrored at the border pixels."""
    wide, kernel = np.pad(values, 1, mode="reflect"), np.outer([1, 2, 1], [1, 2, 1]) / 16
    return np.array([[(wide[j : j + 3, i : i + 3] * kernel).sum() for i in range(values.shape[1])]
                     for j in range(values.shape[0])])  # fmt: skip


@pytest.mark.parametrize("pattern", MOSAICS)
@pytest.mark.parametrize("shape", [(8, 10), (7, 9), (2, 2)])
def test_the_mosaic_of_an_even_colour_vanishes(pattern, shape):
    planes = np.ones((3, *shape)) * np.array([80.0, 200.0, 30.0])[:, None, None]
    mosaic = mosaic_of(planes, pattern)
    np.testing.assert_allclose(from_mosaic(mosaic, pattern), 0.25 * 80 + 0.5 * 200 + 0.25 * 30)
    for channel, value in (("red", 80.0), ("green", 200.0), ("blue", 30.0)):
        np.testing.assert_allclose(from_mosaic(mosaic, pattern, channel=channel), value)


def test_kernel_beside_its_slow_twin():
    values = RNG.uniform(0, 4000, (9, 12))
    np.testing.assert_allclose(from_mosaic(values, "RGGB"), slow_binomial(values))
    red = np.zeros_like(values)
    red[1::2, 1::2] = 1
    expected = slow_binomial(values * red) / slow_binomial(red)
    np.testing.assert_allclose(from_mosaic(values, "BGGR", channel="red"), expected)
    assert from_mosaic(values.astype(np.uint16), "RGGB").dtype == np.float32


def test_the_pixels_of_one_channel_stay_as_they_are():
    """Green, too, of which the kernel sees five there; between them is the mean of four."""
    values = RNG.uniform(0, 4000, (9, 12))
    green = from_mosaic(values, "GRBG", channel="green")
    own = (np.add.outer(np.arange(9), np.arange(12)) % 2) == 0
    np.testing.assert_array_equal(green[own], values[own])
    np.testing.assert_allclose(green[3, 4], (values[2, 4] + values[4, 4] + values[3, 3] + values[3, 5]) / 4)


@pytest.mark.parametrize("contrast", [(0.6, 0.6, 0.6), (0.1, 0.6, 0.6), (0.7, 0.5, 0.1)])
def test_centres_stay_in_place(draw_discs, contrast):
    """Black, red and blue dots of radius 2 and 3 under coloured light: every centre within 0.02 px, no common shift."""
    for radius in (2.0, 3.0):
        grid = np.stack(np.meshgrid(np.arange(6), np.arange(6)), -1).reshape(-1, 2)
        xy = 20.0 + 30.0 * grid + RNG.uniform(-3, 3, grid.shape)
        planes = np.stack(
            [gain * draw_discs(xy, radius, c) for gain, c in zip((500, 1000, 700), contrast, strict=True)]
        )
        for channel in ("grey", "green"):
            grey = from_mosaic(mosaic_of(planes, "GRBG"), "GRBG", channel=channel)
            error = refine_template(grey, xy, radius).xy - xy
            assert np.abs(error).max() < 0.025
            assert np.sqrt(np.mean(error**2)) < 0.012
            assert np.abs(error.mean(axis=0)).max() < 0.004


@pytest.fixture
def draw_discs():
    """Discs of a contrast on light 1, from 7 x 7 sub-pixels, blurred by one 3 x 3 mean."""

    def draw(xy, radius, contrast, size=200, fine=7):
        sub = (np.arange(size * fine) + 0.5) / fine - 0.5
        image = np.ones((size, size))
        for x, y in xy:
            i, j = int(x) - 8, int(y) - 8
            u, v = sub[i * fine : (i + 18) * fine] - x, sub[j * fine : (j + 18) * fine] - y
            inside = np.hypot(u[None, :], v[:, None]) <= radius
            image[j : j + 18, i : i + 18] -= contrast * inside.reshape(18, fine, 18, fine).mean(axis=(1, 3))
        wide = np.pad(image, 1, mode="edge")
        return sum(wide[a : a + size, b : b + size] for a in range(3) for b in range(3)) / 9

    return draw


def test_one_channel_of_a_colour_picture(tmp_path):
    rgb = RNG.integers(0, 256, (6, 8, 3), dtype=np.uint8)
    np.testing.assert_array_equal(to_grey(rgb, channel="blue"), rgb[..., 2])
    write_image(tmp_path / "c.png", rgb)
    np.testing.assert_array_equal(read_grey(tmp_path / "c.png", channel="green"), rgb[..., 1])
    write_image(tmp_path / "m.tif", rgb[..., 0])
    mosaic = read_grey(tmp_path / "m.tif", bayer="GBRG", channel="red")
    np.testing.assert_array_equal(mosaic, from_mosaic(rgb[..., 0], "GBRG", channel="red"))


def test_colours_that_are_not_there(tmp_path):
    rgb = RNG.integers(0, 256, (6, 8, 3), dtype=np.uint8)
    write_image(tmp_path / "c.png", rgb)
    write_image(tmp_path / "g.png", rgb[..., 0])
    with pytest.raises(FileError, match="mosaic"):
        read_grey(tmp_path / "c.png", bayer="RGGB")
    with pytest.raises(FileError, match="without colours"):
        read_grey(tmp_path / "g.png", channel="red")
    for options in ({"channel": "cyan"}, {"bayer": "RGB"}):
        with pytest.raises(ValueError, match="must be one of"):
            read_grey(tmp_path / "g.png", **options)
    with pytest.raises(ValueError, match="no colours"):
        to_grey(rgb[..., 0], channel="red")
    with pytest.raises(ValueError, match="mosaic must be"):
        from_mosaic(rgb, "RGGB")


def test_pixels_made_of_one_saturated_colour_are_known(tmp_path):
    """Their grey is far below the highest level."""
    colours = RNG.integers(40, 200, (30, 40, 3)).astype(np.uint8)
    colours[4:9, 5:11, 0] = 255
    write_image(tmp_path / "a.png", colours)
    read = read_levels(tmp_path / "a.png")
    assert (read.grey.max() < 220, read.apart) == (True, 1)
    np.testing.assert_array_equal(read.mixed, colours[..., 0] == 255)
    assert read_levels(tmp_path / "a.png", channel="red").mixed is None  # its own levels say so
    assert made_of_saturated(colours[..., 1]) is None
    colours[4:9, 5:11, 0] = 254 - np.arange(6)
    assert made_of_saturated(colours) is None


@pytest.mark.parametrize("channel", ["grey", "green", "red"])
def test_pixels_made_of_saturated_ones_of_a_mosaic_are_known(channel):
    mosaic = RNG.integers(200, 900, (30, 40)).astype(np.uint16)
    mosaic[10, 14] = mosaic[21, 25] = 65535  # red, and blue
    whole = np.zeros(mosaic.shape, bool)
    for j, i in ((10, 14), (21, 25)) if channel == "grey" else ((10, 14),):
        whole[j - 1 : j + 2, i - 1 : i + 2] = True
    found = made_of_saturated(mosaic, channel, "RGGB")
    np.testing.assert_array_equal(np.zeros_like(whole) if found is None else found, whole & (channel != "green"))


def test_the_noise_of_a_mosaics_grey_is_that_of_pixels_which_share_none():
    mosaic = RNG.normal(1000.0, 30.0, (400, 400))
    for channel in ("grey", "green", "blue"):
        grey = from_mosaic(mosaic, "RGGB", channel=channel)
        law = noise_law(grey, apart=APART)
        # Of one colour some pixels are measured, and means over two or four of them less noisy.
        assert law.variance(1000.0) == pytest.approx(grey.var(), rel=0.05 if channel == "grey" else 0.35)
        assert 0.2 < law.alike <= 1.0
    assert noise_law(from_mosaic(mosaic, "RGGB"), apart=1).variance(1000.0) < 0.03 * from_mosaic(mosaic, "RGGB").var()
