"""However an array lies in memory, and whether it may be written to: kernels are compiled for one kind only.

Numba takes views and read-only arrays for types of their own; each would cost a first use its seconds again.
"""

import numpy as np
import pytest

import windmark as wm
from windmark.geometry import Camera, p3p
from windmark.geometry._disc_kernels import image_discs
from windmark.geometry._p3p_kernels import p3p_batch_kernel
from windmark.geometry.discs import imaged_ellipse


def kinds(array):
    """The same values: as they are, as a view that skips every second one, column by column, and read-only."""
    yield array
    yield np.repeat(array, 2, axis=-1)[..., ::2]
    yield np.asfortranarray(array)
    locked = array.copy()
    locked.flags.writeable = False
    yield locked


def test_poses_from_three_points():
    rng = np.random.default_rng(1)
    xyz = rng.uniform(-1, 1, (5, 3, 3))
    cam = xyz + np.array([0.1, 0.2, 5.0])
    first = p3p(cam, xyz)
    for rays in kinds(cam):
        for points in kinds(xyz):
            again = p3p(rays, points)
            np.testing.assert_array_equal(again.count, first.count)
    assert p3p(np.broadcast_to(cam[0], (2, 3, 3)), xyz[0]).count.shape == (2,)
    assert p3p(cam[0], xyz[0]).count >= 1
    assert len(p3p_batch_kernel.overloads) == 1


def test_images_of_discs():
    camera = Camera((1600, 1200), 1000.0)
    centre = np.random.default_rng(2).uniform(-50, 50, (6, 3)) + np.array([0.0, 0.0, 800.0])
    normal = np.tile([0.0, 0.0, -1.0], (6, 1))
    first = imaged_ellipse(camera, centre, normal, 3.0)
    for at, to, radius in zip(kinds(centre), kinds(normal), kinds(np.full(6, 3.0)), strict=True):
        np.testing.assert_array_equal(imaged_ellipse(camera, at, to, radius).xy, first.xy)
    imaged_ellipse(camera, centre[:1], normal[:1], 3.0)
    assert len(image_discs.overloads) == 1


@pytest.mark.slow
@pytest.mark.parametrize("close", [False, True])
def test_fits_of_markers(close):
    """To the last bit: in which order a kernel adds up depends on how it was compiled."""
    from windmark.detection.template._kernels.cut import cut_windows
    from windmark.detection.template._kernels.fit import cut_and_fit
    from windmark.detection.template._kernels.touching import shared_blocks

    y, x = np.mgrid[:60, :90]
    xy = np.array([[20.3, 30.2], [30.0 if close else 55.0, 30.6], [75.0, 29.7]])
    image = 1000.0 - sum(600.0 * (np.hypot(x - a, y - b) < 3.5) for a, b in xy)
    image += np.random.default_rng(3).normal(0, 3, image.shape)
    mask = x > 3
    first = wm.detect_at(image, xy, radius_px=3.5, mask=mask)
    assert first.found.all(), first.answer
    for places, usable in zip(kinds(xy), kinds(mask), strict=True):
        again = wm.detect_at(image, places, radius_px=np.full((3, 2), 3.5)[:, 0], mask=usable)
        np.testing.assert_array_equal(again.xy, first.xy)
        np.testing.assert_array_equal(again.cov, first.cov)
    for kernel in (cut_windows, cut_and_fit, shared_blocks):
        assert len(kernel.overloads) <= 1, kernel
