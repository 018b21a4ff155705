from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from windmark.errors import UsageError
from windmark.synth import disc_image, marker_sheet


def brute(shape, xy, axes, angle, n, *, level=200.0, depth=150.0, slope=(0, 0), blur=0.0):
    """The same image by n x n counted sub-pixels, the blur as a filter on the sub-pixels."""
    height, width = shape
    x = (np.arange(width * n) + 0.5) / n - 0.5 - xy[0]
    y = ((np.arange(height * n) + 0.5) / n - 0.5 - xy[1])[:, None]
    p = (np.cos(angle) * x + np.sin(angle) * y) / axes[0]
    q = (np.cos(angle) * y - np.sin(angle) * x) / axes[1]
    light = level * (1 + slope[0] * x + slope[1] * y)
    fine = light * (1 - depth / level * (p * p + q * q <= 1))
    if blur:
        fine = light + gaussian_filter(fine - light, blur * n, mode="constant", truncate=5)
    return fine.reshape(height, n, width, n).mean(axis=(1, 3))


CASES = [
    ((12.0, 11.0), (3.0, 3.0), 0.0), ((11.62, 12.31), (4.3, 2.2), 0.9), ((12.5, 11.5), (2.1, 1.3), 2.8),
]  # fmt: skip


@pytest.mark.parametrize(("xy", "axes", "angle"), CASES)
@pytest.mark.parametrize("blur", [0.0, 0.7])
def test_exact_mode_is_the_limit_of_many_subpixels(xy, axes, angle, blur):
    got = disc_image((24, 25), xy, axes, angle, slope=(0.02, -0.01), blur_px=blur)
    expected = brute((24, 25), xy, axes, angle, 61, slope=(0.02, -0.01), blur=blur)
    assert np.abs(got - expected).max() < 150 * (4e-3 if blur == 0 else 8e-4)


@pytest.mark.parametrize(("xy", "axes", "angle"), CASES)
def test_counting_mode_counts(xy, axes, angle):
    got = disc_image((24, 25), xy, axes, angle, counting=True)
    np.testing.assert_allclose(got, brute((24, 25), xy, axes, angle, 11), atol=1e-9)
    share = (200 - got) / 150 * 121
    np.testing.assert_allclose(share, np.rint(share), atol=1e-9)


def test_blurred_centroid_and_area():
    """With blur the pixels sample the light well: centroid and area to 1e-4 (any place, size and shape)."""
    rng = np.random.default_rng(0)
    y, x = np.indices((30, 30))
    for _ in range(40):
        xy, r, tilt = 14.5 + rng.uniform(-0.5, 0.5, 2), rng.uniform(2, 5), rng.uniform(0, 1.1)
        axes = (r, r * np.cos(tilt))
        dark = 200 - disc_image((30, 30), xy, axes, rng.uniform(0, np.pi), blur_px=0.7)
        assert dark.sum() / 150 == pytest.approx(np.pi * axes[0] * axes[1], rel=1e-4)
        assert (dark * x).sum() / dark.sum() == pytest.approx(xy[0], abs=1e-4)
        assert (dark * y).sum() / dark.sum() == pytest.approx(xy[1], abs=1e-4)


def test_bright_markers_and_partial_images():
    bright = disc_image((20, 20), (9.5, 9.5), 3.0, depth=-50)
    assert bright.max() == pytest.approx(250)
    cut = disc_image((20, 20), (-0.5, 9.5), 3.0)
    whole = disc_image((20, 40), (19.5, 9.5), 3.0)
    np.testing.assert_allclose(cut, whole[:, 20:], atol=1e-9)


def test_sheet_truth_and_seed():
    image, truth = marker_sheet(np.random.default_rng(4), radius_px=3.4, grid=(5, 3), noise=0.03, counting=False)
    again, _ = marker_sheet(np.random.default_rng(4), radius_px=3.4, grid=(5, 3), noise=0.03, counting=False)
    assert image.tobytes() == again.tobytes()
    assert len(truth) == 15
    pitch = image.shape[0] // 3
    assert image.shape == (3 * pitch, 5 * pitch)
    clean, _ = marker_sheet(np.random.default_rng(4), radius_px=3.4, grid=(5, 3), counting=False)
    assert (image - clean).std() == pytest.approx(4.5, rel=0.05)
    assert truth.noise == pytest.approx(4.5)
    y, x = np.indices(clean.shape)
    for k in range(15):
        window = (np.abs(x - truth.xy[k, 0]) < pitch / 2) & (np.abs(y - truth.xy[k, 1]) < pitch / 2)
        dark = (200 - clean) * window
        assert dark.sum() / 150 == pytest.approx(np.pi * truth.axes_px[k].prod(), rel=0.02)
        assert (dark * x).sum() / dark.sum() == pytest.approx(truth.xy[k, 0], abs=0.03)
        xx = (dark * (x - truth.xy[k, 0]) ** 2).sum()
        xy = (dark * (x - truth.xy[k, 0]) * (y - truth.xy[k, 1])).sum()
        yy = (dark * (y - truth.xy[k, 1]) ** 2).sum()
        if truth.tilt_deg[k] > 25:
            seen = 0.5 * np.arctan2(2 * xy, xx - yy)
            assert abs(np.sin(seen - truth.angle[k])) < 0.06
    np.testing.assert_allclose(truth.axes_px[:, 1], 3.4 * np.cos(np.radians(truth.tilt_deg)))


def test_bad_input():
    with pytest.raises(ValueError, match="axes_px"):
        disc_image((9, 9), (4, 4), 0.0)
    with pytest.raises(ValueError, match="max_tilt_deg"):
        marker_sheet(np.random.default_rng(0), max_tilt_deg=90)


@pytest.mark.parametrize("wish", [{"blur_passes": 10**20}, {"grid": (10**10, 10**10)}, {"radius_px": 1e9}])
def test_a_sheet_that_no_memory_holds_is_refused_before_it_is_made(wish):
    with pytest.raises(UsageError, match=r"are a picture of over 2e\+08 pixels; expected less"):
        marker_sheet(np.random.default_rng(0), **wish)
