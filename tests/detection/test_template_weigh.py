"""Centres weighed by the frame's noise: what they gain, how far they are to be trusted, when there are no weights."""

from dataclasses import replace

import numpy as np
import pytest

from windmark.detection.template.noise import PARTS, FrameNoise
from windmark.detection.template.noise_learnt import _expected_of_photons
from windmark.detection.template.refine import refine_template
from windmark.synth import disc_image

TILE, LEVEL, DEPTH = 31, 200.0, 140.0


def sheet(seed, radius=3.5, count=100):
    """Noise-free tilted discs on even paint, and their centres."""
    rng = np.random.default_rng(seed)
    image, xy = np.empty((10 * TILE, count // 10 * TILE)), np.empty((count, 2))
    for k in range(count):
        corner = TILE * np.array([k % (count // 10), k // (count // 10)])
        xy[k] = corner + TILE // 2 + rng.uniform(-0.5, 0.5, 2)
        axes = radius * np.array([1.0, rng.uniform(0.6, 1.0)])
        image[corner[1] : corner[1] + TILE, corner[0] : corner[0] + TILE] = disc_image(
            (TILE, TILE), xy[k] - corner, axes, rng.uniform(0, np.pi), level=LEVEL, depth=DEPTH, blur_px=0.7,
            subpixels=7,
        )  # fmt: skip
    return image, xy


def grain(shape, length, rng):
    """Noise of variance 1 with the correlation exp(-d^2 / (4 length^2))."""
    v, u = np.fft.fftfreq(shape[0])[:, None], np.fft.fftfreq(shape[1])[None]
    filtered = np.fft.ifft2(np.fft.fft2(rng.normal(size=shape)) * np.exp(-2 * np.pi**2 * length**2 * (u**2 + v**2)))
    return filtered.real / filtered.real.std()


def both(image, xy, seed):
    """Fits with the frame's weights and, with all else the same, by least squares."""
    start = xy + np.random.default_rng([seed, 1]).normal(0, 0.1, xy.shape)
    with_weights = refine_template(image, start, 3.4)
    frame = with_weights.frame
    known = {"blur_px": (frame.blur_px, frame.blur_spread_px), "noise": replace(frame.noise, weights=None)}
    return with_weights, refine_template(image, start, 3.4, **known)


def rms_and_z(fits, xy):
    clean = fits.flags == 0
    assert clean.mean() > 0.9
    error = (fits.xy - xy)[clean]
    z = error / np.sqrt(fits.cov[clean][:, [0, 1], [0, 1]])
    return np.sqrt(np.mean(error**2)), np.sqrt(np.mean(z**2))


@pytest.mark.parametrize(("length", "gain"), [(1.2, 0.8), (2.0, 0.65)])
def test_texture_that_repeats_itself_counts_once(length, gain):
    weighed, plain = [], []
    for seed in (61, 62, 63):
        rng = np.random.default_rng([seed, 2])
        image, xy = sheet(seed)
        image = image * (1 + 0.03 * grain(image.shape, length, rng)) + rng.normal(0, 2.0, image.shape)
        a, b = both(image, xy, seed)
        assert a.frame.noise.weights is not None
        weighed.append(rms_and_z(a, xy))
        plain.append(rms_and_z(b, xy))
    (rms, z), (plain_rms, _) = np.mean(weighed, axis=0), np.mean(plain, axis=0)
    assert rms < gain * plain_rms
    assert 0.85 < z < 1.15


def test_photons_make_the_light_noisier_than_the_dark():
    weighed, plain = [], []
    for seed in (71, 72, 73, 74):
        rng = np.random.default_rng([seed, 2])
        image, xy = sheet(seed)
        a, b = both(rng.poisson(image * 3.0) / 3.0, xy, seed)
        assert a.frame.noise.weights is not None
        weighed.append(rms_and_z(a, xy))
        plain.append(rms_and_z(b, xy))
    (rms, z), (plain_rms, plain_z) = np.mean(weighed, axis=0), np.mean(plain, axis=0)
    assert rms < 0.985 * plain_rms
    assert 0.88 < z < 1.12
    assert 0.85 < plain_z < 1.12


def test_white_noise_is_not_weighed():
    for seed in range(81, 86):
        image, xy = sheet(seed)
        noisy = image + np.random.default_rng([seed, 2]).normal(0, 5.0, image.shape)
        fits = refine_template(noisy, xy, 3.4)
        assert fits.frame.noise.weights is None
        assert fits.frame.noise.is_white


@pytest.mark.parametrize("fault", ["glint", "compressed"])
def test_what_only_discs_show_is_no_noise_to_weigh_by(fault):
    """A glint on every disc is the model's error; a file's noise that is only where the picture changes is neither."""
    import cv2

    for seed in (91, 92):
        rng = np.random.default_rng([seed, 2])
        image, xy = sheet(seed)
        y, x = np.mgrid[: len(image), : image.shape[1]]
        if fault == "glint":
            for cx, cy in xy:
                image += 25.0 * np.exp(-0.5 * ((x - cx - 1) ** 2 + (y - cy + 1) ** 2))
        image = np.clip(image + rng.normal(0, 2.0, image.shape), 0, 255).astype(np.uint8)
        if fault == "compressed":
            image = cv2.imdecode(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 50])[1], cv2.IMREAD_GRAYSCALE)
        assert refine_template(image, xy, 3.4).frame.noise.weights is None


def test_pixels_have_the_variance_that_is_given():
    model = np.zeros((9, 9))
    model[2:7, 1:8] = np.linspace(50.0, 200.0, 35).reshape(5, 7)
    strengths = np.zeros(2 * PARTS)
    strengths[[0, PARTS]] = 0.25, 0.75
    by_level = replace(FrameNoise.white(1.0), weights=strengths).pixels(model, 4.0)
    assert by_level.shape == (35,)
    assert by_level.mean() == pytest.approx(4.0)
    assert (np.diff(by_level) > 0).all()
    photons = replace(FrameNoise.white(1.0), weights=0.4 * np.eye(2 * PARTS)[0], photons=0.6).pixels(model, 4.0)
    light = 0.4 + 0.6 * model[model > 0] / 200.0
    np.testing.assert_allclose(photons, 4.0 * light / light.mean())
    strengths[PARTS + 5] = 1.0
    cov = replace(FrameNoise.white(1.0), weights=strengths).pixels(model, 4.0)
    assert np.trace(cov) == pytest.approx(35 * 4.0)
    assert (np.linalg.eigvalsh(cov) > 0).all()
    bright, gap2 = model[model > 0] / 200.0, (np.argwhere(model > 0)[3] - np.argwhere(model > 0)[17]) ** 2
    like = bright[3] * bright[17] * np.exp(-gap2.sum() / (4 * 1.2**2))
    own = 0.25 + 1.75 * bright[3] ** 2
    assert cov[3, 17] / cov[3, 3] == pytest.approx(like / own)


def test_what_photons_leave_in_residuals_is_that_of_dense_matrices():
    rng = np.random.default_rng(5)
    bright, used = rng.uniform(0.3, 1.0, (7, 7)), rng.random((7, 7)) > 0.1
    jacobian, weights = rng.normal(size=(4, 7, 7)) * used, [used.astype(float), bright * used]
    rows = jacobian.reshape(4, -1)
    left = np.eye(49) - rows.T @ np.linalg.solve(rows @ rows.T, rows)
    noise = np.diag((bright * used).ravel())
    dense = [np.trace(left @ np.diag(np.square(w).ravel()) @ left @ noise) for w in weights]
    np.testing.assert_allclose(_expected_of_photons(weights, bright * used, jacobian), dense)
