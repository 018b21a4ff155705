"""Rational and fisheye lenses: one to one within their range, derivatives, and the kernels' copy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from windmark.geometry import PARAMETERS, Camera, _kernels
from windmark.geometry.camera import LENS_PARAMETERS
from windmark.geometry.lens import range2
from windmark.geometry.rays import pixel_rays

LAWS = settings(max_examples=40, deadline=None)


@st.composite
def fisheyes(draw, tilt=0.1):
    width, height = draw(st.integers(100, 4000)), draw(st.integers(100, 4000))

    def number(size):
        return draw(st.one_of(st.floats(-size, size), st.just(0.0)))

    return Camera(
        (width, height), draw(st.floats(0.15, 2.0)) * width, draw(st.floats(0.9, 1.1)), (0.5 + number(0.1)) * width,
        (0.5 + number(0.1)) * height, k1=number(0.2), k2=number(0.05), k3=number(0.01), tilt_x=number(tilt),
        tilt_y=number(tilt), k4=number(2e-3), lens="fisheye",
    )  # fmt: skip


@st.composite
def rationals(draw):
    width, height = draw(st.integers(100, 4000)), draw(st.integers(100, 4000))

    def number(size):
        return draw(st.one_of(st.floats(-size, size), st.just(0.0)))

    return Camera(
        (width, height), draw(st.floats(0.3, 2.0)) * width, k1=number(1.0), k2=number(0.3), p1=number(1e-3),
        p2=number(1e-3), k3=number(0.02), k4=number(1.0), k5=number(0.3), k6=number(0.02), lens="rational",
    )  # fmt: skip


def directions(seed, count, most):
    rng = np.random.default_rng(seed)
    theta, phi = most * np.sqrt(rng.uniform(size=count)), rng.uniform(0, 2 * np.pi, count)
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=1)


@LAWS
@given(fisheyes(tilt=0.0), st.integers(0, 10**6), st.floats(1e-6, 1e6))
def test_every_direction_a_fisheye_sees_comes_back_in_front_and_behind(camera, seed, depth):
    most = float(np.sqrt(range2(camera._lens())))
    unit = directions(seed, 60, 0.98 * most)
    xy, valid = camera.project(depth * unit)
    assert valid.all()
    np.testing.assert_allclose(camera.directions(xy), unit, atol=1e-6)
    front = unit[:, 2] > 1e-3
    rays = camera.unproject(xy)
    np.testing.assert_allclose(rays[front], unit[front] / unit[front, 2:], rtol=1e-5, atol=1e-6)
    assert np.isnan(rays[unit[:, 2] < -1e-6]).all()


@LAWS
@given(fisheyes(), st.integers(0, 10**6))
def test_beyond_its_fold_a_fisheye_sees_nothing(camera, seed):
    most = float(np.sqrt(range2(camera._lens())))
    assume(most < 3.0)
    rim = directions(seed, 40, 1.0)
    rim /= np.linalg.norm(rim[:, :2], axis=1, keepdims=True)
    beyond = np.column_stack([np.sin(most + 0.01) * rim[:, :2], np.full(40, np.cos(most + 0.01))])
    xy, valid = camera.project(beyond)
    assert not valid.any()
    assert np.isnan(xy).all()


@LAWS
@given(rationals(), st.integers(0, 10**6))
def test_every_pixel_with_a_ray_of_a_rational_lens_is_hit_by_it(camera, seed):
    w, h = camera.size_px
    xy = np.random.default_rng(seed).uniform([-0.5, -0.5], [w - 0.5, h - 0.5], (60, 2))
    rays = camera.unproject(xy)
    seen = np.isfinite(rays).all(axis=1)
    back, valid, slope, _ = camera.project_jacobian(rays[seen])
    assert valid.sum() >= 0.95 * seen.sum()
    # Close to a pole the image runs away with the ray's last digit.
    steep = np.abs(slope[valid]).max(axis=(1, 2)) * np.linalg.norm(rays[seen][valid], axis=1)
    assert (np.abs(back[valid] - xy[seen][valid]).max(axis=1) < 1e-7 + 1e-14 * steep).all()


@LAWS
@given(st.one_of(fisheyes(), rationals()), st.integers(0, 10**6))
def test_derivatives_are_those_of_differences(camera, seed):
    xyz = directions(seed, 30, 1.2 if camera.lens == "fisheye" else 0.7) * 3.0
    xy, valid, by_point, by_parameter = camera.project_jacobian(xyz)
    again, same, only_point = camera.point_jacobian(xyz)
    np.testing.assert_array_equal(valid, same)
    np.testing.assert_allclose(again[valid], xy[valid], rtol=1e-12)
    np.testing.assert_allclose(only_point[valid], by_point[valid], rtol=1e-9, atol=1e-6)
    h = 1e-6
    for axis, step in enumerate(h * np.eye(3)):
        a, b = camera.project(xyz + step), camera.project(xyz - step)
        good = valid & a[1] & b[1]
        difference = (a[0] - b[0])[good] / (2 * h)
        scale = 1e-6 * (camera.focal_px + np.abs(by_point[good]).max(axis=(1, 2), initial=0.0)[:, None])
        assert (np.abs(difference - by_point[good][:, :, axis]) < 50 * scale).all()
    values = camera.parameters()
    for name in LENS_PARAMETERS[camera.lens]:
        k, step = PARAMETERS.index(name), np.zeros(len(PARAMETERS))
        step[k] = 1e-6 * max(1.0, abs(values[k]))
        a, b = (camera.with_parameters(values + s * step).project(xyz) for s in (1, -1))
        good = valid & a[1] & b[1]
        difference = (a[0] - b[0])[good] / (2 * step[k])
        scale = 1e-5 * (1 + np.abs(by_parameter[good][:, :, k]).max(initial=0.0) + camera.focal_px * 1e-3)
        assert (np.abs(difference - by_parameter[good][:, :, k]) < scale).all(), name


@LAWS
@given(st.one_of(fisheyes(), rationals()), st.integers(0, 10**6))
def test_the_kernels_copy_is_the_same_lens(camera, seed):
    xyz = np.random.default_rng(seed).normal(size=(40, 3))
    xy, valid, by_point, _ = camera.project_jacobian(xyz)
    packed = camera.packed()
    for n in range(len(xyz)):
        got = _kernels.project_with_slopes(packed, *xyz[n])
        assert got[2] == valid[n]
        if valid[n]:
            size = max(np.abs(by_point[n]).max(), camera.focal_px)
            np.testing.assert_allclose(got[:2], xy[n], atol=1e-8 * max(1.0, np.abs(xy[n]).max()))
            np.testing.assert_allclose([got[3:6], got[6:9]], by_point[n], atol=1e-8 * size)


@pytest.mark.parametrize(
    "camera",
    [
        Camera((160, 120), 50.0, k1=-0.02, k2=3e-3, tilt_x=0.02, lens="fisheye"),
        Camera((160, 120), 70.0, k1=0.4, k2=0.05, p1=1e-5, k4=0.75, k5=0.2, k6=0.01, lens="rational"),
    ],
    ids=["fisheye", "rational"],
)
def test_rays_of_all_pixels_are_those_of_unproject(camera):
    rays = pixel_rays(camera, 0, 120)
    one_by_one = camera.unproject(np.stack(np.meshgrid(np.arange(160.0), np.arange(120.0)), axis=-1))[..., :2]
    np.testing.assert_array_equal(np.isnan(rays), np.isnan(one_by_one))
    size = 1 + np.nan_to_num(one_by_one) ** 2
    assert np.nanmax(np.abs(rays - one_by_one) / size) < 1e-11


def test_what_a_lens_lacks_is_refused():
    with pytest.raises(ValueError, match=r"a brown lens has no k4; expected 0, got 0\.1"):
        Camera((10, 10), 5.0, k4=0.1)
    with pytest.raises(ValueError, match="a fisheye lens has no p1"):
        Camera((10, 10), 5.0, p1=0.1, lens="fisheye")
    with pytest.raises(ValueError, match="lens must be one of brown, rational, fisheye, got 'mei'"):
        Camera((10, 10), 5.0, lens="mei")
