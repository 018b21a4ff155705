"""Stripes in a picture: a spectrum of their own, and white noise along them."""

import numpy as np
import pytest

from windmark.detection.template.refine import refine_template
from windmark.detection.template.stripes import frequencies, no_stripes, of_stripes
from windmark.synth import disc_image

SIZE, NOISE = 37, 0.6  # px: no stripe has the same phase on all tiles


def sheet(seed, stripes=0.0, period=1.0, down=False, radius=4.0):
    """36 round discs on tiles in white noise, with stripes over all of the picture; and their places."""
    rng = np.random.default_rng(seed)
    image, xy = np.empty((6 * SIZE, 6 * SIZE)), np.empty((36, 2))
    for k in range(36):
        center, corner = SIZE // 2 + rng.uniform(-0.5, 0.5, 2), SIZE * np.array([k % 6, k // 6])
        xy[k] = corner + center
        image[corner[1] : corner[1] + SIZE, corner[0] : corner[0] + SIZE] = disc_image(
            (SIZE, SIZE), center, (radius, radius), 0.0, level=200.0, depth=150.0, blur_px=0.7, subpixels=7
        )
    wave = stripes * np.sin(2.0 * np.pi * np.arange(6 * SIZE) / period + seed)
    image += wave[:, None] if down else wave
    return image + rng.normal(0.0, NOISE, image.shape), xy


def fitted(seeds, **of):
    """Errors in sigmas (N, 2), along and across vertical stripes, sigmas, and the frames' noise."""
    z, sigmas, noises = [], [], []
    for seed in seeds:
        image, xy = sheet(seed, **of)
        fits = refine_template(image, xy + 0.1, np.full(len(xy), 1.05 * of.get("radius", 4.0)))
        assert fits.converged.all()
        sigma = np.sqrt(fits.cov[:, [0, 1], [0, 1]])
        z.append((fits.xy - xy) / sigma)
        sigmas.append(sigma)
        noises.append(fits.frame.noise)
    return np.concatenate(z), np.concatenate(sigmas), noises


@pytest.mark.parametrize("down", [False, True])
@pytest.mark.parametrize(("period", "least"), [(2.3, 0.7), (3.3, 0.8), (6.0, 0.8), (11.0, 0.8)])
def test_sigmas_hold_in_stripes(period, least, down):
    """72 errors know their scatter to 8 %. Taken for columns that know nothing of each other, z was up to 600."""
    z, sigma, noises = fitted((1, 2), stripes=3.0, period=period, down=down)
    assert np.abs(z).max() < 4.5
    across, along = (1, 0) if down else (0, 1)
    assert least < np.sqrt(np.mean(z[:, across] ** 2)) < 1.2
    assert 0.7 < np.sqrt(np.mean(z[:, along] ** 2)) < 1.2
    clean = fitted((1,))[1]
    assert (sigma[:, along] > 0.8 * np.median(clean)).all()  # of the noise that each pixel has for itself
    for noise in noises:
        strength = noise.stripes.sum(axis=1)
        assert strength[int(down)] > 0.7
        assert strength[1 - int(down)] == 0.0
        strongest = frequencies(noise.stripes.shape[1])[noise.stripes[int(down)].argmax()]
        assert strongest == pytest.approx(1.0 / period, abs=2.0 / 48.0)


@pytest.mark.parametrize(("stripes", "period"), [(15.0, 5.3), (30.0, 3.0)])
def test_strong_stripes_do_not_hide_the_noise_of_each_pixel(stripes, period):
    """Of 25 and 50 times the noise a fit leaves more along them than the noise: z was up to 74."""
    z, sigma, _ = fitted((1, 2), stripes=stripes, period=period)
    assert np.abs(z).max() < 4.0
    assert (sigma[:, 1] > 0.8 * np.median(fitted((1,))[1])).all()


@pytest.mark.slow
@pytest.mark.parametrize(("radius", "size", "least"), [(12.0, 81, 0.6), (20.0, 131, 0.25), (30.0, 201, 0.05)])
def test_large_discs_tell_more_frequencies_apart(monkeypatch, radius, size, least):
    """Where the lines do not fit the stripes, the noise of each pixel is not forgotten: it shows in differences."""
    monkeypatch.setitem(globals(), "SIZE", size)
    z, sigma, _ = fitted((1,), stripes=3.0, period=3.3, radius=radius)
    assert (np.sqrt(np.mean(z**2, axis=0)) < 1.3).all()
    assert (np.sqrt(np.mean(z**2, axis=0)) > least).all()
    assert (sigma > 0.0005).all()


def test_white_noise_and_columns_that_know_nothing_of_each_other_have_no_stripes():
    image, xy = sheet(4)
    columns = np.random.default_rng(9).normal(0.0, 2.0, (6, image.shape[1]))  # others for each row of tiles
    for picture in (image, image + np.repeat(columns, SIZE, axis=0)):
        fits = refine_template(picture, xy + 0.1, np.full(len(xy), 4.2))
        assert not fits.frame.noise.stripes.any()
        z = (fits.xy - xy) / np.sqrt(fits.cov[:, [0, 1], [0, 1]])
        assert 0.7 < np.sqrt(np.mean(z[:, 0] ** 2)) < 1.3
    assert fits.frame.noise.constant[1] > 0.5


def test_covariance_of_stripes_is_that_of_their_phases():
    """Against stripes that are drawn: the mean square of what one of unknown phase does to the centre."""
    influence = np.random.default_rng(1).normal(size=(2, 2, 9, 9))
    strengths, k = no_stripes(), 7
    strengths[1, k] = 2.0
    phase = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    wave = 2.0 * np.sin(2.0 * np.pi * frequencies(24)[k] * np.arange(9) + phase[:, None])[:, :, None]
    moved = np.einsum("biyx,pyx->bpi", influence, np.broadcast_to(wave, (12, 9, 9)))
    expected = np.einsum("bpi,bpj->bij", moved, moved) / 12
    np.testing.assert_allclose(of_stripes(influence, strengths), expected, rtol=1e-9)
