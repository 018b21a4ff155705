"""Properties of the virtual wind tunnel that hold for any scene."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from windmark.geometry import Camera, Pose
from windmark.scene import MarkerSet
from windmark.synth import Paint, World, assemble, degrade, disc_image, marker_truth, render
from windmark.synth.patch import Patch, rectangle

QUICK = settings(max_examples=12, deadline=None)
small = st.floats(-1, 1)
LENS = Camera((90, 70), 420.0, 1.001, 46.2, 33.1, k1=-0.1, k2=0.03, p1=3e-4, p2=-2e-4)


def hill(s, t):
    x, y = 60 * (s - 0.5), 50 * (t - 0.5)
    return np.stack([x, y, 6 * np.cos(x / 15) * np.cos(y / 20)], axis=-1)


@pytest.fixture(scope="module")
def world():
    patch = Patch("hill", "wing", hill, 25, 25)
    floor = rectangle("floor", "wall", (-300, -300, -40), (600, 0, 0), (0, 600, 0), 5, 5)
    xyz, normal = patch.place([0.3, 0.6, 0.7, 0.25], [0.4, 0.3, 0.75, 0.8])
    markers = MarkerSet.make(list("abcd"), xyz, radius=2.0, normal=normal, volume="wing")
    paint = Paint.random(np.random.default_rng(0), {"wall": 0.4}, [(50, 80, 300, 9e4)], wavelength=(30, 60), grain=0.0)
    return World(assemble([patch, floor]), markers, paint)


def look(a, b, roll=0.0):
    up = [np.sin(roll), np.cos(roll), 0]
    return Pose.look_at([60 * a, 60 * b, 250], [2 * b, 3 * a, 0], up)


@QUICK
@given(a=small, b=small, dx=st.integers(-7, 7), dy=st.integers(-5, 5))
def test_principal_point_shifts_the_picture(world, a, b, dx, dy):
    """Moving the principal point by whole pixels moves the image and the truth by as many, distortion included."""
    first = render(world, LENS, look(a, b))
    second = render(world, replace(LENS, cx=LENS.cx + dx, cy=LENS.cy + dy), look(a, b))
    rows, columns = slice(8, 60), slice(10, 80)
    shifted = second.image[8 + dy : 60 + dy, 10 + dx : 80 + dx]
    np.testing.assert_allclose(shifted, first.image[rows, columns], atol=2e-3)
    assert np.abs(shifted - first.image[rows, columns]).mean() < 1e-6
    np.testing.assert_allclose(second.markers.xy, first.markers.xy + np.array([dx, dy]), atol=1e-9)
    np.testing.assert_allclose(second.markers.ellipse_xy, first.markers.ellipse_xy + np.array([dx, dy]), atol=1e-9)


@QUICK
@given(rotation=st.tuples(small, small, small), shift=st.tuples(small, small, small))
def test_only_relative_motion_matters(world, rotation, shift):
    """World, lamps and camera moved together: the same image."""
    move = Pose.from_rotvec(np.array(rotation), 100 * np.array(shift))
    lamps = np.column_stack([move.apply(world.paint.lamps[:, :3]), world.paint.lamps[:, 3]])
    moved = replace(world, paint=replace(world.paint, lamps=lamps)).moved(move, ["wing", "wall"])
    first, second = render(world, LENS, look(0.3, -0.2)), render(moved, LENS, look(0.3, -0.2) @ move.inverse())
    assert np.abs(first.image - second.image).mean() < 1e-5
    np.testing.assert_allclose(second.markers.xy, first.markers.xy, atol=1e-7)
    np.testing.assert_array_equal(second.markers.visible, first.markers.visible)


@QUICK
@given(factor=st.floats(0.1, 5), contrast=st.floats(0.05, 1))
def test_light_is_linear_and_discs_take_their_share(world, factor, contrast):
    paint = replace(world.paint, lamps=world.paint.lamps * [1, 1, 1, factor])
    full = render(replace(world, marker_contrast=0.0), LENS, look(0.1, 0.4))
    dim = render(replace(world, marker_contrast=contrast), LENS, look(0.1, 0.4))
    bright = render(replace(world, paint=paint, marker_contrast=contrast), LENS, look(0.1, 0.4))
    np.testing.assert_allclose(bright.image, factor * dim.image, rtol=1e-9, atol=1e-12)
    loss = 1 - dim.image / full.image
    assert loss.min() > -5e-3  # a finer sampled pixel may differ from its centre's light
    assert loss.max() == pytest.approx(contrast, rel=1e-9)


@QUICK
@given(a=small, b=small, roll=st.floats(-3, 3))
def test_truth_is_where_the_darkness_is(world, a, b, roll):
    """Each visible disc's loss of light has the truth's centroid; none of it is elsewhere."""
    pose = look(a, b, roll)
    plain = replace(world, paint=Paint())
    r = render(plain, LENS, pose)
    loss = (1 - r.image) / world.marker_contrast
    y, x = np.indices(loss.shape)
    for k in np.flatnonzero(r.markers.visible):
        cx, cy = r.markers.ellipse_xy[k]
        if not (10 < cx < 80 and 10 < cy < 60):
            continue
        w = loss * (np.hypot(x - cx, y - cy) < 1.5 * r.markers.axes_px[k, 0] + 2)
        assert w.sum() == pytest.approx(np.pi * r.markers.axes_px[k].prod(), rel=5e-3)
        np.testing.assert_allclose([(w * x).sum() / w.sum(), (w * y).sum() / w.sum()], [cx, cy], atol=0.02)


@QUICK
@given(a=small, b=small, roll=st.floats(-3, 3))
def test_a_mesh_can_only_hide(world, a, b, roll):
    free = marker_truth(world.markers, LENS, look(a, b, roll))
    held = marker_truth(world.markers, LENS, look(a, b, roll), world.mesh)
    assert (held.fraction <= free.fraction).all()
    np.testing.assert_array_equal(held.xy, free.xy)


@QUICK
@given(x=st.floats(9, 15), y=st.floats(8, 13), r=st.floats(1, 5), squeeze=st.floats(0.3, 1), angle=st.floats(0, 3.1))
def test_disc_image_symmetries(x, y, r, squeeze, angle):
    """Mirrored picture, mirrored ellipse; shifted by a pixel, shifted; a flat picture loses exactly the area."""
    axes = (r, r * squeeze)
    one = disc_image((24, 26), (x, y), axes, angle, blur_px=0.5)
    np.testing.assert_allclose(disc_image((24, 26), (25 - x, y), axes, -angle, blur_px=0.5)[:, ::-1], one, atol=0.05)
    np.testing.assert_allclose(
        disc_image((24, 26), (x + 1, y), axes, angle, blur_px=0.5)[:, 1:], one[:, :-1], atol=1e-6
    )
    assert (200 - one).sum() / 150 == pytest.approx(np.pi * r * r * squeeze, rel=2e-3)


@QUICK
@given(seed=st.integers(0, 2**32), sigma=st.floats(0.1, 3), passes=st.integers(0, 4))
def test_blurs_keep_light_and_order(seed, sigma, passes):
    image = np.random.default_rng(seed).uniform(0, 1, (30, 37))
    for out in (degrade.gaussian_blur(image, sigma), degrade.average_blur(image, passes)):
        assert out.mean() == pytest.approx(image.mean(), rel=1e-12)
        assert image.min() - 1e-12 <= out.min()
        assert out.max() <= image.max() + 1e-12
