"""Rays of whole pictures are those of the camera, and are found once; directions in planes; figures in words."""

from dataclasses import replace

import numpy as np
import pytest

from windmark.geometry import Camera, rays
from windmark.geometry.camera import _lens_figures
from windmark.geometry.described import numbers
from windmark.geometry.discs import tangent


@pytest.mark.parametrize("rows", [(0, 40), (17, 9)])
def test_rays_of_rows_are_those_of_their_pixels(any_camera, rows):
    camera = replace(any_camera, size_px=(60, 40), focal_px=any_camera.focal_px / 20, cx=28.0, cy=22.0)
    first, count = rows
    pixel = np.stack(np.meshgrid(np.arange(60), first + np.arange(count)), axis=-1).astype(float)
    expected = camera.unproject(pixel)[..., :2]
    got = rays.pixel_rays(camera, first, count)
    np.testing.assert_array_equal(np.isnan(got), np.isnan(expected))
    np.testing.assert_allclose(got, expected, rtol=1e-8, atol=1e-10)


def test_rays_are_kept_as_far_as_there_is_room(monkeypatch):
    asked = []
    monkeypatch.setattr(rays, "_KEPT", rays._Kept())
    find = rays.pixel_rays
    monkeypatch.setattr(rays, "pixel_rays", lambda camera, *of: asked.append(of) or find(camera, *of))
    camera = Camera((20, 10), 30.0)
    one = find(camera, 0, 10).nbytes
    monkeypatch.setattr(rays, "KEPT_BYTES", 2 * one)
    for first in (0, 0):
        rays.kept_rays(camera, first, 10)
    rays.kept_rays(replace(camera, focal_px=31.0), 0, 10)
    rays.kept_rays(camera, 0, 10)  # asked for last: the other one makes room for the next
    assert len(asked) == 2
    rays.kept_rays(replace(camera, focal_px=32.0), 0, 10)
    rays.kept_rays(camera, 0, 10)
    assert len(asked) == 3
    rays.kept_rays(replace(camera, focal_px=31.0), 0, 10)
    assert len(asked) == 4
    monkeypatch.setattr(rays, "KEPT_BYTES", one - 1)
    for _ in range(2):
        assert len(rays.kept_rays(replace(camera, focal_px=33.0), 0, 10)) == 10
    assert len(asked) == 6


def test_tangents_lie_in_the_plane_along_x_or_where_that_is_steep_along_y():
    rng = np.random.default_rng(1)
    normal = rng.normal(size=(200, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    along = tangent(normal)
    np.testing.assert_allclose(np.linalg.norm(along, axis=1), 1.0)
    np.testing.assert_allclose((along * normal).sum(axis=1), 0.0, atol=1e-12)
    steep = np.abs(normal[:, 0]) >= 0.9
    assert steep.any()
    assert (along[~steep, 0] > 0).all()
    assert (along[steep, 1] > 0).all()
    np.testing.assert_allclose(np.cross(along, normal)[~steep, 0], 0.0, atol=1e-12)
    np.testing.assert_allclose(np.cross(along, normal)[steep, 1], 0.0, atol=1e-12)


def test_figures_in_words():
    assert numbers([1.0, -0.0, 1e-13, 123456.7]) == "(1, 0, 0, 1.2346e+05)"
    assert numbers(2.5) == "(2.5)"
    assert numbers([]) == "()"
    assert numbers([1e-5, 1e-16]) == "(1e-05, 1e-16)"
    assert _lens_figures(Camera((10, 10), 5.0)) == "none"
    assert _lens_figures(Camera((10, 10), 5.0, lens="fisheye")) == "fisheye"
    assert _lens_figures(Camera((10, 10), 5.0, k1=-0.12345, tilt_x=0.1)) == "brown k1 -0.1235 tilt_x 0.1"
