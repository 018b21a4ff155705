"""Windows cut by the kernel against the same in whole arrays."""

import numpy as np
import pytest

from windmark.detection.template.fit import cut_patches, windows
from windmark.detection.template.request import Neighbours, Request, Scene

HALF = 8


def request_at(xy, radius=3.0, blur=0.7):
    count = len(xy)
    full = np.full(count, blur)
    return Request(
        np.array(xy), np.full(count, radius), full, full, None, np.full(count, np.inf), np.full((count, 10), np.nan)
    )


def slow_cut(scene, pixel):
    """Patches, weights, what is known, what is saturated: all (K, S, S)."""
    height, width = scene.image.shape
    lattice = np.arange(-HALF, HALF + 1)
    x, y = pixel[:, 0, None] + lattice, pixel[:, 1, None] + lattice
    known = ((y >= 0) & (y < height))[:, :, None] & ((x >= 0) & (x < width))[:, None, :]
    at = np.clip(y, 0, height - 1)[:, :, None], np.clip(x, 0, width - 1)[:, None, :]
    patches = scene.image[at].astype(float)
    saturated = known & (patches >= scene.saturation)
    most = saturated.sum((1, 2)) > 0.5 * known.sum((1, 2))
    use = known & ~(saturated & ~most[:, None, None]) & np.isfinite(patches)
    if scene.usable is not None:
        use &= scene.usable[at]
    return np.where(use, scene.sign * patches, 0.0), use.astype(float), known, saturated


def slow_windows(scene, request, others):
    """Patches, weights, shares (K,) of the disc that is used and of the window that is saturated."""
    pixel = np.rint(request.xy).astype(int)
    patches, weights, known, saturated = slow_cut(scene, pixel)
    y, x = np.mgrid[-HALF : HALF + 1, -HALF : HALF + 1]

    def distance(k, xy):
        return np.hypot(x - (xy - pixel[k])[0], y - (xy - pixel[k])[1])

    usable, spoilt = np.empty(len(pixel)), np.empty(len(pixel))
    for k, xy in enumerate(request.xy):
        own = distance(k, xy)
        window = own <= request.reach()[k]
        weights[k] *= window
        disc = (own <= request.radius[k] + request.blur[k]) & known[k] & ~saturated[k]
        usable[k] = (disc & (weights[k] > 0)).sum() / max(disc.sum(), 1)
        spoilt[k] = (saturated[k] & window).sum() / max((known[k] & window).sum(), 1)
        for n in others.index[k][others.index[k] >= 0]:
            rim = distance(k, others.xy[n]) - others.radius[n]
            weights[k][(rim < others.margin[n]) & (rim < own - request.radius[k])] = 0.0
    return patches, weights, usable, spoilt


PLACES = [(20.3, 18.8), (28.1, 21.4), (1.2, 30.0), (55.7, 57.9), (-5.0, 20.0), (40.5, 10.5), (12.0, 47.3)]


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("kind", [np.uint8, np.float32, ">u2", np.float16])
def test_windows_are_those_of_whole_arrays(kind, sign):
    rng = np.random.default_rng(4)
    image = rng.integers(0, 250, (60, 64)).astype(kind)
    image[40:55, 5:20] = 255  # mostly saturated
    image[15:20, 22:26] = 255
    if np.dtype(kind).kind == "f":
        image[8:11, 38:41] = [np.nan, np.inf, -np.inf]
    usable = rng.random(image.shape) > 0.05
    request = request_at(PLACES)
    others = Neighbours.find(request)
    assert others.touching().sum() == 4
    for scene in (Scene(image, None, sign, 255.0, True), Scene(image[:, ::2], usable[:, ::2], sign, np.inf, True)):
        patches, weights, share, spoilt = slow_windows(scene, request, others)
        done, start, got, mine = windows(scene, request, others, HALF)
        np.testing.assert_array_equal(got, patches)
        np.testing.assert_array_equal(mine, weights)
        np.testing.assert_allclose(done.usable, share, rtol=1e-15)
        np.testing.assert_allclose(done.saturated, spoilt, rtol=1e-15)
        np.testing.assert_array_equal(start, request.xy - np.rint(request.xy))
        for a, b in zip(cut_patches(scene, done.pixel, HALF), slow_cut(scene, done.pixel), strict=False):
            np.testing.assert_array_equal(a, b)
