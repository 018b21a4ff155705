"""AIAA 2005-5007, section II.C: how the paper's virtual markers are made."""

from __future__ import annotations

import numpy as np
import pytest

from windmark.synth import degrade, marker_sheet


def test_144_randomised_markers():
    """'The marker parameters are randomized and 144 markers are calculated'; centres are not on pixels."""
    image, truth = marker_sheet(np.random.default_rng(0), radius_px=3.0)
    assert len(truth) == 144
    fraction = truth.xy - np.floor(truth.xy)
    counts, _ = np.histogram(fraction[:, 0], 4, (0, 1))
    assert counts.min() > 15  # anywhere in the pixel
    assert truth.tilt_deg.min() < 5
    assert truth.tilt_deg.max() > 55
    assert np.ptp(truth.angle) > 3
    assert image.max() == 200
    assert image.min() == 50


def test_values_count_121_subpixels():
    """'The value of the pixel is obtained by counting the number of sub-pixels inside the marker', 11 x 11 of them."""
    image, _ = marker_sheet(np.random.default_rng(1), radius_px=3.3, grid=(4, 4))
    count = (200 - image) / 150 * 121
    np.testing.assert_allclose(count, np.rint(count), atol=1e-9)
    assert len(np.unique(np.rint(count))) > 60


@pytest.mark.parametrize("radius", [2.5, 3.0, 3.2, 5.5])
def test_radius_need_not_be_an_integer(radius):
    """Counted area against pi r^2 cos(tilt), marker by marker."""
    image, truth = marker_sheet(np.random.default_rng(2), radius_px=radius, grid=(8, 8))
    pitch = image.shape[0] // 8
    area = (200 - image).reshape(8, pitch, 8, pitch).sum(axis=(1, 3)).ravel() / 150
    exact = np.pi * radius**2 * np.cos(np.radians(truth.tilt_deg))
    np.testing.assert_allclose(area, exact, rtol=0.02)
    assert np.mean(area / exact) == pytest.approx(1, abs=1e-3)


def test_viewing_angles_make_ellipses():
    image, truth = marker_sheet(np.random.default_rng(3), radius_px=5.0, grid=(6, 6))
    assert (truth.axes_px[:, 0] == 5).all()
    np.testing.assert_allclose(truth.axes_px[:, 1], 5 * np.cos(np.radians(truth.tilt_deg)))
    pitch = image.shape[0] // 6
    y, x = np.indices(image.shape)
    for k in range(36):
        w = (200 - image) * (np.maximum(np.abs(x - truth.xy[k, 0]), np.abs(y - truth.xy[k, 1])) < pitch / 2)
        dx, dy = x - truth.xy[k, 0], y - truth.xy[k, 1]
        m = np.array([[(w * dx * dx).sum(), (w * dx * dy).sum()], [(w * dx * dy).sum(), (w * dy * dy).sum()]]) / w.sum()
        # An ellipse's second moments are axis^2 / 4, and the pixel adds 1/12.
        np.testing.assert_allclose(2 * np.sqrt(np.linalg.eigvalsh(m)[::-1] - 1 / 12), truth.axes_px[k], rtol=0.02)


def test_blur_is_an_iterated_average_of_the_sharp_image():
    """'The blurring effect is obtained by making an iterative average on non-blurred images.'"""
    sharp, _ = marker_sheet(np.random.default_rng(4), grid=(3, 3), pitch_px=30)
    blurred, _ = marker_sheet(np.random.default_rng(4), grid=(3, 3), pitch_px=30, blur_passes=2)
    twice = degrade.average_blur(degrade.average_blur(sharp, 1), 1)
    np.testing.assert_allclose(blurred, twice, atol=1e-10)
    inner = sharp[1:-1, 1:-1]
    neighbours = sum(sharp[1 + j : 89 + j, 1 + i : 89 + i] for j in (-1, 0, 1) for i in (-1, 0, 1)) / 9
    np.testing.assert_allclose(degrade.average_blur(sharp, 1)[1:-1, 1:-1], neighbours, atol=1e-10)
    assert inner.shape == neighbours.shape


def test_noise_is_white_and_of_the_level_asked_for():
    clean, _ = marker_sheet(np.random.default_rng(5), grid=(6, 6))
    noisy, truth = marker_sheet(np.random.default_rng(5), grid=(6, 6), noise=0.03)
    d = noisy - clean
    assert d.std() == pytest.approx(0.03 * 150, rel=0.03)
    assert truth.noise == pytest.approx(4.5)
    assert abs(np.mean(d[:, 1:] * d[:, :-1])) < 0.03 * 4.5**2
