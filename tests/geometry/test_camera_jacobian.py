from __future__ import annotations

import numpy as np

from windmark.geometry import Camera
from windmark.geometry.camera import LENS_PARAMETERS, PARAMETERS


def points(seed=0, n=40):
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(-0.25, 0.25, (n, 2)), np.ones(n)]) * rng.uniform(0.5, 20, (n, 1))


def test_value_and_validity_are_those_of_project(any_camera):
    camera = any_camera
    xyz = np.concatenate([points(), [[0, 0, -1], [30, 0, 1], [0, 0, np.nan]]])
    xy, valid = camera.project(xyz)
    again, valid_again, d_xyz, d_par = camera.project_jacobian(xyz)
    np.testing.assert_array_equal(valid, valid_again)
    np.testing.assert_allclose(again, xy, atol=1e-10)
    assert np.isnan(d_xyz[~valid]).all()
    assert np.isnan(d_par[~valid]).all()
    assert np.isfinite(d_xyz[valid]).all()
    assert np.isfinite(d_par[valid]).all()


def test_the_short_way_is_the_same(any_camera):
    camera = any_camera
    xyz = np.concatenate([points(), [[0, 0, -1], [30, 0, 1], [0, 0, np.nan]]])
    xy, valid, d_xyz, _ = camera.project_jacobian(xyz)
    again, valid_again, d_again = camera.point_jacobian(xyz)
    np.testing.assert_array_equal(valid, valid_again)
    np.testing.assert_allclose(again, xy, rtol=1e-12)
    np.testing.assert_allclose(d_again, d_xyz, rtol=1e-9, atol=1e-9)
    for shape in ((3,), (0, 3), (2, 4, 3)):
        assert camera.point_jacobian(np.ones(shape))[2].shape == (*shape[:-1], 2, 3)


def test_by_the_point_against_differences(any_camera):
    camera = any_camera
    xyz = points()
    d_xyz = camera.project_jacobian(xyz)[2]
    for k in range(3):
        h = 1e-6 * xyz[:, 2]
        step = np.zeros_like(xyz)
        step[:, k] = h
        difference = (camera.project(xyz + step)[0] - camera.project(xyz - step)[0]) / (2 * h[:, None])
        scale = camera.focal_px / xyz[:, 2, None]
        np.testing.assert_allclose(d_xyz[..., k] / scale, difference / scale, atol=1e-7)


def test_by_every_parameter_against_differences(any_camera):
    camera = any_camera
    xyz = points(1)
    d_par = camera.project_jacobian(xyz)[3]
    values = camera.parameters()
    has = LENS_PARAMETERS[camera.lens]
    lacking = [k for k, name in enumerate(PARAMETERS) if name not in has]
    np.testing.assert_array_equal(d_par[..., [k for k in lacking if k >= 11]], 0.0)
    for k, name in enumerate(PARAMETERS):
        if name not in has:
            continue
        h = 1e-3 if name in ("focal_px", "cx", "cy") else 1e-6
        up, down = values.copy(), values.copy()
        up[k] += h
        down[k] -= h
        difference = (camera.with_parameters(up).project(xyz)[0] - camera.with_parameters(down).project(xyz)[0]) / (
            2 * h
        )
        np.testing.assert_allclose(d_par[..., k], difference, rtol=1e-6, atol=2e-6 * max(1.0, np.abs(difference).max()))


def test_tilts_have_derivatives_at_zero_tilt():
    camera = Camera((640, 480), 800.0)
    d_par = camera.project_jacobian([0.1, 0.2, 1.0])[3]
    assert np.abs(d_par[:, 9:]).max() > 1.0


def test_shapes_of_a_grid_and_of_nothing(any_camera):
    camera = any_camera
    xy, valid, d_xyz, d_par = camera.project_jacobian(points().reshape(5, 8, 3))
    assert (xy.shape, valid.shape, d_xyz.shape, d_par.shape) == ((5, 8, 2), (5, 8), (5, 8, 2, 3), (5, 8, 2, 15))
    assert camera.project_jacobian(np.zeros((0, 3)))[3].shape == (0, 2, 15)
