from __future__ import annotations

import numpy as np
import pytest

from windmark.geometry import PARAMETERS, Camera
from windmark.geometry.lens import max_radius2


def border_and_inside(camera, n=25):
    w, h = camera.size_px
    return np.stack(np.meshgrid(np.linspace(-0.5, w - 0.5, n), np.linspace(-0.5, h - 0.5, n)), -1).reshape(-1, 2)


def test_unproject_then_project_is_the_pixel(camera):
    xy = border_and_inside(camera)
    rays = camera.unproject(xy)
    seen = np.isfinite(rays).all(axis=1)
    assert seen.mean() > 0.9
    assert np.all(rays[seen, 2] == 1)
    for depth in (1e-3, 1.0, 1e6):
        back, valid = camera.project(depth * rays[seen])
        assert valid.all()
        np.testing.assert_allclose(back, xy[seen], atol=1e-8)


def test_project_then_unproject_is_the_ray(camera):
    limit = 0.98 * np.sqrt(min(max_radius2(camera.k1, camera.k2, camera.k3), 0.5))
    angle, radius = np.meshgrid(np.linspace(0, 6, 13), np.linspace(0, limit, 12))
    ideal = np.stack([radius * np.cos(angle), radius * np.sin(angle)], -1).reshape(-1, 2)
    xyz = 7.5 * np.column_stack([ideal, np.ones(len(ideal))])
    xy, valid = camera.project(xyz)
    assert valid.mean() > 0.95
    np.testing.assert_allclose(7.5 * camera.unproject(xy[valid]), xyz[valid], atol=1e-11)


def test_project_says_where_it_cannot(camera):
    behind = np.array([[0, 0, -1.0], [0.1, 0.2, 0.0], [0, 0, np.nan], [np.inf, 0, 1], [0, 0, 1]])
    xy, valid = camera.project(behind)
    assert valid.tolist() == [False, False, False, False, True]
    assert np.isnan(xy[:4]).all()
    np.testing.assert_allclose(xy[4], [camera.cx, camera.cy], atol=1e-12)


def test_nothing_is_folded_into_the_picture():
    camera = Camera((2000, 1500), 1000.0, k1=-0.3)  # folds at 46 degrees
    fold = np.sqrt(max_radius2(-0.3, 0, 0))
    x = fold * np.array([0.5, 0.999, 1.001, 1.5, 1.8, 5.0])
    xy, valid = camera.project(np.column_stack([x, 0 * x, np.ones(6)]))
    assert valid.tolist() == [True, True, False, False, False, False]
    assert np.isnan(xy[2:]).all()
    edge = 1000 * fold * (1 - 0.3 * fold**2)
    rays = camera.unproject(np.array([[camera.cx + edge - 0.01, camera.cy], [camera.cx + edge + 0.01, camera.cy]]))
    assert np.isfinite(rays).all(axis=1).tolist() == [True, False]


def test_points_beyond_the_horizon_of_a_tilted_sensor_are_not_valid():
    camera = Camera((640, 480), 500.0, tilt_x=0.6)
    horizon = 1 / np.tan(0.6)
    y = np.array([1.0, horizon - 1e-6, horizon + 1e-6, 2 * horizon])
    xyz = np.column_stack([0 * y, y, np.ones(4)])
    for valid in (camera.project(xyz)[1], camera.project_jacobian(xyz)[1]):
        assert valid.tolist() == [True, True, False, False]


def test_distortion_follows_the_written_formula():
    camera = Camera((100, 80), 50.0, 1.1, 40.0, 30.0, 0.1, -0.2, 0.01, -0.02, 0.3)
    x, y = 0.3, -0.4
    s = 0.25
    radial = 1 + 0.1 * s - 0.2 * s**2 + 0.3 * s**3
    xd = x * radial + 2 * 0.01 * x * y + -0.02 * (s + 2 * x * x)
    yd = y * radial + 0.01 * (s + 2 * y * y) + 2 * -0.02 * x * y
    xy, _ = camera.project([2 * x, 2 * y, 2.0])
    np.testing.assert_allclose(xy, [50 * xd + 40, 55 * yd + 30], atol=1e-12)


def test_defaults_are_the_middle_of_the_image():
    camera = Camera((641, 480), 500.0)
    assert (camera.cx, camera.cy) == (320.0, 239.5)
    assert camera.fov_deg == pytest.approx(2 * np.degrees(np.arctan(641 / 1000)))
    np.testing.assert_array_equal(camera.matrix, [[500, 0, 320], [0, 500, 239.5], [0, 0, 1]])


def test_in_image_includes_the_border():
    camera = Camera((10, 8), 5.0)
    xy = [[-0.5, -0.5], [9.5, 7.5], [9.51, 0], [0, -0.51], [np.nan, 0]]
    assert camera.in_image(xy).tolist() == [True, True, False, False, False]


def test_parameters_go_out_and_in(camera):
    values = camera.parameters()
    assert values.shape == (len(PARAMETERS),)
    assert camera.with_parameters(values) == camera
    assert camera.with_parameters(values[:11] + 1e-3).k3 == camera.k3 + 1e-3
    assert camera.packed()[:11].tolist() == values[:11].tolist()
    assert camera.with_parameters(values[:11]).shear == camera.shear
    assert camera.packed()[[12, 13, 14, 16]].tolist() == values[11:].tolist()
    with pytest.raises(ValueError):
        camera.with_parameters(values[:5])


def test_shapes_are_kept(camera):
    xyz = np.random.default_rng(0).uniform(-0.2, 0.2, (3, 4, 3)) + np.array([0, 0, 1])
    xy, valid = camera.project(xyz)
    assert xy.shape == (3, 4, 2)
    assert valid.shape == (3, 4)
    assert camera.unproject(xy).shape == (3, 4, 3)
    assert camera.project(np.zeros((0, 3)))[0].shape == (0, 2)
    single, ok = camera.project(xyz[1, 2])
    np.testing.assert_allclose(single, xy[1, 2], atol=1e-12)
    assert ok


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"size_px": (640,)}, "size_px"),
        ({"size_px": 640}, "size_px"),
        ({"size_px": (0, 480)}, "size_px"),
        ({"size_px": (640.5, 480)}, "size_px"),
        ({"focal_px": 0.0}, "focal_px"),
        ({"focal_px": -5.0}, "focal_px"),
        ({"focal_px": np.nan}, "focal_px"),
        ({"aspect": 0.0}, "aspect"),
        ({"aspect": np.inf}, "aspect"),
        ({"cx": np.inf}, "cx"),
        ({"k1": np.nan}, "k1"),
        ({"tilt_y": np.nan}, "tilt_y"),
        ({"cov": np.eye(3)}, "cov"),
    ],
)
def test_bad_parameters_are_named(arguments, word):
    with pytest.raises(ValueError, match=f"Camera: {word}|Camera:.*{word}"):
        Camera(**{"size_px": (640, 480), "focal_px": 500.0, **arguments})


def test_wrong_shapes_are_named(camera):
    with pytest.raises(ValueError, match=r"Camera\.project: .*\(4, 2\)"):
        camera.project(np.zeros((4, 2)))
    with pytest.raises(ValueError, match=r"Camera\.unproject: .*\(4, 3\)"):
        camera.unproject(np.zeros((4, 3)))
    with pytest.raises(ValueError, match=r"Camera\.project_jacobian: .*\(\)"):
        camera.project_jacobian(1.0)
