"""One colour of a mosaic: only the pixels that were measured count, whichever way the picture came."""

from functools import cache

import numpy as np
import pytest

import windmark as wm
from windmark import io
from windmark.detection.measured import Lattice, lattice_of
from windmark.detection.template.refine import make_scene, refine_template

CHANNELS = ("red", "green", "blue")


@cache
def board(radius, seed, blur=0.8, across=7):
    """Discs seen at an angle, (H, W), and their centres (N, 2)."""
    rng = np.random.default_rng(seed)
    pitch = int(5 * radius) + 10
    image, xy = np.zeros((across * pitch, across * pitch)), []
    for j in range(across):
        for i in range(across):
            at = pitch / 2 + rng.uniform(-1, 1, 2)
            image[j * pitch : (j + 1) * pitch, i * pitch : (i + 1) * pitch] = wm.synth.disc_image(
                (pitch, pitch), at, [radius, 0.8 * radius], rng.uniform(0, 3), blur_px=blur, level=150, depth=110,
                subpixels=7,
            )  # fmt: skip
            xy.append(at + np.array([i, j]) * pitch)
    return image, np.array(xy)


def sensed(image, seed, noise=1.5):
    """What an RGGB sensor makes of it."""
    mosaic = image.copy()
    mosaic[::2, ::2] *= 0.9
    mosaic[1::2, 1::2] *= 0.7
    mosaic += np.random.default_rng(seed).normal(0, noise, mosaic.shape)
    return np.clip(np.rint(mosaic), 0, 255).astype(np.uint8)


def spread(xy, cov, truth):
    """Root mean square of errors in units of their sigmas, per coordinate."""
    assert len(xy) == len(truth)
    off = xy - truth[((xy[:, None] - truth) ** 2).sum(-1).argmin(1)]
    return np.sqrt(np.mean(np.einsum("ki,kij,kj->k", off, np.linalg.inv(cov), off)) / 2)


def assert_honest(radius, channel, trials):
    seen = []
    for seed in range(trials):
        image, truth = board(radius, seed)
        grey = io.from_mosaic(sensed(image, 50 + seed), "RGGB", channel=channel)
        found = wm.detect(grey, radius_px=radius)
        assert (found.flags & 4 == 0).mean() > 0.8  # what was not measured is no dirt
        seen.append(spread(found.xy, found.cov, truth))
    assert np.sqrt(np.mean(np.square(seen))) == pytest.approx(1.0, abs=3.0 / np.sqrt(4 * len(truth) * trials))


@pytest.mark.parametrize("channel", ["red", "green"])
def test_means_of_neighbours_have_less_noise_than_what_was_measured(channel):
    """Of white noise on the mosaic, in the colour that is interpolated: its share of the pixels and their variance."""
    noise = np.random.default_rng(4).normal(0, 100, (400, 600)) + 2000
    grey = io.from_mosaic(np.clip(np.rint(noise), 0, 65535).astype(np.uint16), "RGGB", channel=channel)
    lattice = lattice_of(grey)
    measured = lattice.pixels()
    assert measured.mean() == lattice.share
    assert grey.var() / grey[measured].var() == pytest.approx(lattice.scatter, rel=0.03)


@pytest.mark.parametrize("channel", ["red", "green"])
def test_sigmas_of_one_channel(channel):
    """98 discs: chance lets the ratio go off by 0.05 (1 sigma)."""
    assert_honest(5.0, channel, 2)


@pytest.mark.parametrize("channel", CHANNELS)
@pytest.mark.parametrize("radius", [3.0, 5.0, 8.0])
def test_sigmas_of_every_channel(radius, channel):
    """294 discs each."""
    assert_honest(radius, channel, 6)


def test_predicted_markers_and_bowls_too():
    """The bowl's own lattice error leaves its sigmas roughly right, not half of what they should be."""
    image, truth = board(4.0, 3)
    red = io.from_mosaic(sensed(image, 4), "RGGB", channel="red")
    guided = wm.detect_at(red, truth + 0.3, radius_px=4.0, fit_shape=True)
    assert guided.found.all()
    assert 0.8 < spread(guided.xy, guided.cov, truth) < 1.2
    bowls = wm.detect(red, radius_px=4.0, refine="bowl")
    assert 0.6 < spread(bowls.xy, bowls.cov, truth) < 1.4


def test_interpolated_pixels_change_nothing():
    """Fits of the channel are those of a picture whose other pixels are spoilt and masked out."""
    image, truth = board(5.0, 1, across=4)
    red = io.from_mosaic(sensed(image, 2), "RGGB", channel="red")
    own = Lattice(red.shape, 0, 0, False).pixels()
    spoilt = np.where(own, red, red + np.random.default_rng(1).normal(0, 5, red.shape)).astype(np.float32)
    assert lattice_of(spoilt) is None
    masked = refine_template(spoilt, truth, 5.0, mask=own, blur_px=0.8, robust=False)
    fits = refine_template(red, truth, 5.0, blur_px=0.8, robust=False)
    np.testing.assert_allclose(fits.xy, masked.xy, atol=5e-3)  # 0.1 of their sigmas: by what the start of a shape is
    assert (masked.flags & 4).all()
    assert not (fits.flags & 4).any()


@pytest.mark.parametrize("shape", [(40, 60), (41, 61), (9, 8)])
@pytest.mark.parametrize("pattern", io.MOSAICS)
def test_a_lattice_is_known_by_its_levels(shape, pattern):
    values = np.random.default_rng(5).integers(0, 4096, shape).astype(np.uint16)
    for channel in CHANNELS:
        lattice = lattice_of(io.from_mosaic(values, pattern, channel=channel))
        here = np.array([letter == channel[0].upper() for letter in pattern]).reshape(2, 2)
        tiled = np.tile(here, (shape[0] // 2 + 1, shape[1] // 2 + 1))[: shape[0], : shape[1]]
        np.testing.assert_array_equal(lattice.pixels(), tiled)
        assert lattice.share == here.mean()
    assert lattice_of(io.from_mosaic(values, pattern)) is None


def test_a_lattice_survives_what_is_done_to_pictures():
    """Cropped, scaled, with dead pixels: each is still known by its levels."""
    values = np.random.default_rng(6).integers(0, 255, (60, 60)).astype(np.uint8)
    red = io.from_mosaic(values, "RGGB", channel="red")
    assert lattice_of(red[3:, 2:]).row == 1
    assert lattice_of(red * np.float32(0.37) + np.float32(11.0)) is not None
    red[20, 20] = np.nan
    assert lattice_of(red) is not None


def test_other_pictures_have_none():
    """Whole numbers, noise, even surfaces, blurred and drawn pictures: every pixel counts."""
    rng = np.random.default_rng(7)
    noise = rng.normal(100, 5, (50, 60))
    y, x = np.mgrid[:50, :60]
    drawn = wm.synth.disc_image((50, 60), [25.0, 20.0], [6.0, 5.0])
    smooth = sum(np.roll(noise, (a, b), (0, 1)) for a in (-1, 0, 1) for b in (-1, 0, 1)) / 9
    for image in (noise, noise.astype(np.float32), np.zeros((50, 60)), 2.0 * x + y, drawn, smooth,
                  np.full((50, 60), np.nan), np.zeros((3, 3)), np.rint(noise).astype(np.uint8)):  # fmt: skip
        assert lattice_of(image) is None
        assert make_scene(image, "dark", "multiplicative", None, None).lattice is None
