"""The image of a disc beside the closed form of the conic and a dense polygon."""

from dataclasses import replace

import numpy as np
import pytest

from windmark.geometry import Camera, Pose, imaged_ellipse
from windmark.geometry.discs import _derivative


@pytest.fixture
def lens():
    return Camera((1280, 800), 1400.0, k1=-0.12, k2=0.05, p1=4e-4, p2=-3e-4)


def conic_ellipse(camera, center, normal, radius):
    """Centre and half axes of the conic H^-T diag(1, 1, -1) H^-1, H the homography from the unit disc to the image."""
    a = np.cross(normal, [0.3, 0.5, 0.8])
    a /= np.linalg.norm(a)
    h = camera.matrix @ np.column_stack([radius * a, radius * np.cross(normal, a), center])
    inverse = np.linalg.inv(h)
    c = inverse.T @ np.diag([1.0, 1.0, -1.0]) @ inverse
    xy = -np.linalg.solve(c[:2, :2], c[:2, 2])
    level = -(c[2, 2] + c[:2, 2] @ xy)
    return xy, np.sqrt(level / np.linalg.eigvalsh(c[:2, :2]))


def test_pinhole_image_is_the_conic():
    """Up to discs of a fifth of their distance: a hundred random ones."""
    rng = np.random.default_rng(4)
    camera = Camera((1280, 800), 1100.0, aspect=1.01, cx=610.0, cy=420.0)
    center = np.column_stack([rng.uniform(-3, 3, (100, 2)), rng.uniform(9, 12, 100)])
    normal = rng.normal(size=(100, 3)) - [0, 0, 1.5]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    facing = -(normal * center).sum(axis=1) / np.linalg.norm(center, axis=1) > 0.15
    radius = rng.uniform(0.01, 2.0, 100)
    seen = imaged_ellipse(camera, center[facing], 3.0 * normal[facing], radius[facing])
    for k, j in enumerate(np.flatnonzero(facing)):
        xy, axes = conic_ellipse(camera, center[j], normal[j], radius[j])
        np.testing.assert_allclose(seen.xy[k], xy, atol=1e-7)
        np.testing.assert_allclose(seen.axes_px[k], axes, rtol=1e-8)
        np.testing.assert_allclose(seen.center_xy[k], camera.project(center[j])[0])


def test_detector_finds_the_ellipse_and_not_the_disc():
    """The number a detector is blamed for: 0.08 px at r = 16, f = 1500, 45 degrees."""
    camera, s = Camera((400, 400), 1500.0), np.sqrt(0.5)
    seen = imaged_ellipse(camera, [[0.0, 0.0, 100.0]], [[s, 0.0, -s]], 16 / 15)
    assert seen.eccentricity_px[0, 0] == pytest.approx(-(16**2) / (2 * 1500), rel=5e-3)


def test_wrong_shapes_and_discs_without_an_image():
    camera = Camera((100, 100), 100.0)
    with pytest.raises(ValueError, match="normal_cam"):
        imaged_ellipse(camera, [[0, 0, 1.0]], [0, 0, 1.0], 1.0)
    with pytest.raises(ValueError, match="radius"):
        imaged_ellipse(camera, [[0, 0, 1.0]], [[0, 0, 1.0]], [1.0, 2.0])
    nowhere = imaged_ellipse(camera, [[0, 0, -5.0], [0, 0, 5.0]], [[0, 0, -1.0], [np.nan] * 3], 1.0)
    assert np.isnan(nowhere.xy).all()
    assert np.isfinite(nowhere.center_xy[1]).all()
    assert len(imaged_ellipse(camera, np.empty((0, 3)), np.empty((0, 3)), 1.0)) == 0


def test_ellipse_is_the_outline_s(lens):
    """Moments against a polygon of 20,000 outline points, shoelace formulas; tilted discs, distorted corners."""
    center = np.array([[0.0, 0, 50], [4, 3, 50], [-5, 3.5, 55]])
    normal = np.array([[0, 0, -1.0], [0.5, 0.2, -0.8], [-0.3, 0.6, -0.5]])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    radius = np.array([0.2, 0.3, 0.25])
    seen = imaged_ellipse(lens, center, normal, radius)
    xy, axes, angle = seen.xy, seen.axes_px, seen.angle
    theta = np.linspace(0, 2 * np.pi, 20_001)
    for k in range(3):
        a = np.cross(normal[k], [0.1, 0.9, 0.3])
        a /= np.linalg.norm(a)
        b = np.cross(normal[k], a)
        p, _ = lens.project(center[k] + radius[k] * (np.cos(theta)[:, None] * a + np.sin(theta)[:, None] * b))
        x, y = p.T
        cross = x[:-1] * y[1:] - x[1:] * y[:-1]
        area = cross.sum() / 2
        cx = ((x[:-1] + x[1:]) * cross).sum() / (6 * area)
        cy = ((y[:-1] + y[1:]) * cross).sum() / (6 * area)
        np.testing.assert_allclose(xy[k], [cx, cy], atol=1e-6)
        assert np.pi * axes[k].prod() == pytest.approx(abs(area), rel=1e-5)
        along = (x - cx) * np.cos(angle[k]) + (y - cy) * np.sin(angle[k])
        assert along.max() == pytest.approx(axes[k, 0], rel=2e-3)


def test_facing_disc_has_no_eccentricity():
    camera = Camera((100, 100), 500.0)
    seen = imaged_ellipse(camera, [[1.0, 2, 100]], [[0, 0, -1.0]], 2.0)
    np.testing.assert_allclose(seen.eccentricity_px, 0.0, atol=1e-10)
    np.testing.assert_allclose(seen.axes_px[0], 10.0, rtol=1e-7)


@pytest.mark.parametrize("tilt_deg", [20, 45, 60])
def test_centre_of_the_ellipse_is_not_the_disc_s_centre(tilt_deg):
    """They differ by r^2 sin(2 tilt) / (2 f), on the side that is nearer to the camera (docs/conventions.md)."""
    camera = Camera((2000, 2000), 1500.0)
    a = np.radians(tilt_deg)
    center, normal = np.array([[0, 0, 300.0]]), np.array([[np.sin(a), 0, -np.cos(a)]])
    seen = imaged_ellipse(camera, center, normal, 1.0)
    axes = seen.axes_px
    r = 1500 / 300
    assert axes[0, 0] == pytest.approx(r, rel=1e-4)
    assert axes[0, 1] == pytest.approx(r * np.cos(a), rel=1e-3)
    shift = seen.eccentricity_px[0]
    assert np.linalg.norm(shift) == pytest.approx(r**2 * np.sin(2 * a) / (2 * 1500), rel=2e-3)
    near_end = np.array([-np.cos(a), 0, -np.sin(a)])  # the direction in the disc's plane that comes nearer
    assert normal[0] @ near_end == pytest.approx(0)
    assert shift[0] * near_end[0] > 0


def slow_ellipse(camera, center, normal, radius, count=64):
    """The readable twin: moments of the projected outline, its derivative by the Fourier transform."""
    theta = 2 * np.pi * np.arange(count) / count
    n = normal / np.linalg.norm(normal)
    a = np.cross(n, [0.2, -0.4, 0.9])
    a /= np.linalg.norm(a)
    ring = center + radius * (np.cos(theta)[:, None] * a + np.sin(theta)[:, None] * np.cross(n, a))
    outline, _ = camera.project(ring)
    origin = outline.mean(axis=0)
    x, y = (outline - origin).T
    frequency = np.fft.fftfreq(count, 1 / count)
    dx, dy = (np.fft.ifft(1j * frequency * np.fft.fft(v)).real * 2 * np.pi / count for v in (x, y))
    area = 0.5 * (x * dy - y * dx).sum()
    first = np.array([(x * x * dy).sum(), -(y * y * dx).sum()]) / (2 * area)
    second = np.array([[(x**3 * dy).sum() / 3, 0.0], [0.0, -(y**3 * dx).sum() / 3]])
    second[0, 1] = second[1, 0] = 0.25 * (x * x * y * dy - x * y * y * dx).sum()
    return origin + first, second / area - np.outer(first, first)


def test_the_kernel_is_its_twin(lens):
    rng = np.random.default_rng(9)
    tilted = replace(lens, tilt_x=0.05, tilt_y=-0.08, k3=0.01)
    center = np.column_stack([rng.uniform(-3, 3, (40, 2)), rng.uniform(9, 12, 40)])
    normal, radius = rng.normal(size=(40, 3)) - [0, 0, 2.0], rng.uniform(0.01, 1.0, 40)
    for camera in (lens, tilted):
        seen = imaged_ellipse(camera, center, normal, radius)
        for k in range(40):
            xy, moments = slow_ellipse(camera, center[k], normal[k], radius[k])
            np.testing.assert_allclose(seen.xy[k], xy, atol=1e-6)
            half = np.array([np.cos(seen.angle[k]), np.sin(seen.angle[k])])
            turn = np.array([[half[0], -half[1]], [half[1], half[0]]])
            got = turn @ np.diag(seen.axes_px[k] ** 2 / 4) @ turn.T
            np.testing.assert_allclose(got, moments, atol=1e-6 * seen.axes_px[k, 0] ** 2)


def test_what_has_no_image_or_no_normal_is_not_a_number(lens):
    center = np.array([[0.0, 0, 5], [0, 0, -5], [0, 0, 5], [0, 0, 5]])
    normal = np.array([[0.0, 0, -1], [0, 0, -1], [np.nan, 0, 1], [0, 0, 0]])
    seen = imaged_ellipse(lens, center, normal, np.array([0.1, 0.1, 0.1, 0.1]))
    assert np.isfinite(seen.xy).all(axis=1).tolist() == [True, False, False, False]
    assert np.isfinite(seen.center_xy).all(axis=1).tolist() == [True, False, True, True]


@pytest.mark.parametrize("tilt_deg", [20, 50, 70])
@pytest.mark.parametrize("shape", [(1, 1), (1, 0), (0.3, -0.6)], ids=["sphere", "cylinder", "saddle"])
def test_a_disc_on_a_curved_surface_is_centred_where_its_outline_is(tilt_deg, shape):
    """A tenth as large as the surface's radius: 0.1 to 0.3 px beside where a flat one would be, against a dense outline
    on the surface itself (a sphere and a cylinder are no quadrics).
    """
    camera, large, radius = Camera((1000, 1000), 2000.0), 50.0, 5.0
    tilt, around = np.radians(tilt_deg), np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    pose = Pose.look_at(2000 * np.array([np.sin(tilt) * 0.8, np.sin(tilt) * 0.6, np.cos(tilt)]), np.zeros(3), [0, 1, 0])
    u, v = radius * np.cos(around), radius * np.sin(around)
    low = (shape[0] * u**2 + shape[1] * v**2) / (2 * large)
    if min(shape) >= 0:
        low = large - np.sqrt(large**2 - 2 * large * low)
    x, y = camera.project(pose.apply(np.column_stack([u, v, -low])))[0].T
    x0, y0 = x.mean(), y.mean()
    cross = (x - x0) * (np.roll(y, -1) - y0) - (np.roll(x, -1) - x0) * (y - y0)
    middle = [((w - w0 + np.roll(w, -1) - w0) * cross).sum() / 3 / cross.sum() + w0 for w, w0 in ((x, x0), (y, y0))]
    here, up = pose.apply(np.zeros((1, 3))), pose.rotate([[0.0, 0, 1]])
    form = pose.rotate_form(np.diag([*shape, 0])[None] / large)
    bent = imaged_ellipse(camera, here, 2 * up, radius, form)
    flat = imaged_ellipse(camera, here, up, radius)
    np.testing.assert_allclose(bent.xy[0], middle, atol=1e-3)
    assert np.linalg.norm(flat.xy[0] - middle) > 0.015


def test_curvature_has_one_form_a_disc():
    with pytest.raises(ValueError, match=r"curvature_cam must be \(1, 3, 3\)"):
        imaged_ellipse(Camera((100, 100), 100.0), [[0, 0, 5.0]], [[0, 0, -1.0]], 0.1, np.zeros((3, 3)))


@pytest.mark.parametrize("count", [8, 16, 32])
def test_the_derivative_of_waves_round_the_outline_is_exact(count):
    angle = 2 * np.pi * np.arange(count) / count
    for k in range(count // 2):
        for wave, slope in ((np.cos(k * angle), -k * np.sin(k * angle)), (np.sin(k * angle), k * np.cos(k * angle))):
            np.testing.assert_allclose(_derivative(count) @ wave, slope * 2 * np.pi / count, atol=1e-12)
