from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.scene import MarkerSet
from windmark.synth import marker_truth
from windmark.synth.truth import disc_images


def test_truth_projects_the_markers(small_test):
    """The view's cam_from_model and the reference markers give the truth's xy: model markers in both frames."""
    for shot in small_test.shots:
        t = shot.perfect.markers
        xy, _ = small_test.cameras["cam1"].project(shot.view.cam_from_model.apply(small_test.markers.xyz))
        model = small_test.markers.role == "model"
        np.testing.assert_allclose(t.xy[model], xy[model], atol=1e-8)
        wall, _ = small_test.cameras["cam1"].project(shot.perfect.cam_from_tunnel.apply(small_test.markers.xyz))
        np.testing.assert_allclose(t.xy[~model], wall[~model], atol=1e-8)
        assert np.isfinite(t.xy).all()


def test_ellipse_is_the_outline_s(lens):
    """Moments against a polygon of 20,000 outline points, shoelace formulas; tilted discs, distorted corners."""
    center = np.array([[0.0, 0, 50], [4, 3, 50], [-5, 3.5, 55]])
    normal = np.array([[0, 0, -1.0], [0.5, 0.2, -0.8], [-0.3, 0.6, -0.5]])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    radius = np.array([0.2, 0.3, 0.25])
    xy, axes, angle = disc_images(lens, center, normal, radius)
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
    xy, axes, _ = disc_images(camera, np.array([[1.0, 2, 100]]), np.array([[0, 0, -1.0]]), np.array([2.0]))
    np.testing.assert_allclose(xy[0], camera.project([1.0, 2, 100])[0], atol=1e-10)
    np.testing.assert_allclose(axes[0], 10.0, rtol=1e-7)


@pytest.mark.parametrize("tilt_deg", [20, 45, 60])
def test_centre_of_the_ellipse_is_not_the_disc_s_centre(tilt_deg):
    """They differ by r^2 sin(2 tilt) / (2 f), on the side that is nearer to the camera (docs/conventions.md)."""
    camera = Camera((2000, 2000), 1500.0)
    a = np.radians(tilt_deg)
    center, normal = np.array([[0, 0, 300.0]]), np.array([[np.sin(a), 0, -np.cos(a)]])
    xy, axes, _ = disc_images(camera, center, normal, np.array([1.0]))
    r = 1500 / 300
    assert axes[0, 0] == pytest.approx(r, rel=1e-4)
    assert axes[0, 1] == pytest.approx(r * np.cos(a), rel=1e-3)
    shift = xy[0] - camera.project(center[0])[0]
    assert np.linalg.norm(shift) == pytest.approx(r**2 * np.sin(2 * a) / (2 * 1500), rel=2e-3)
    near_end = np.array([-np.cos(a), 0, -np.sin(a)])  # the direction in the disc's plane that comes nearer
    assert normal[0] @ near_end == pytest.approx(0)
    assert shift[0] * near_end[0] > 0


def test_flags_without_a_mesh():
    camera = Camera((100, 100), 100.0)
    markers = MarkerSet.make(
        ["in", "out", "back", "behind", "no-normal"],
        [[0, 0, 10], [20, 0, 10], [0, 0, 10], [0, 0, -10], [1, 1, 10]],
        radius=[0.5, 0.5, 0.5, 0.5, np.nan],
        normal=[[0, 0, -1], [0, 0, -1], [0, 0, 1], [0, 0, 1], [np.nan] * 3],
    )
    t = marker_truth(markers, camera, Pose.identity())
    assert t.visible.tolist() == [True, False, False, False, True]
    assert t.facing.tolist() == [True, True, False, False, True]
    assert t.in_image.tolist() == [True, False, True, False, True]
    assert np.isnan(t.xy[3]).all()
    assert t.tilt[0] == pytest.approx(0)
    np.testing.assert_array_equal(t.depth, [10, 10, 10, -10, 10])
    assert len(t) == 5


def test_disc_across_the_border_is_partly_seen():
    camera = Camera((100, 100), 100.0)
    markers = MarkerSet.make(["half"], [[-5.0, 0, 10]], radius=0.5, normal=[[0, 0, -1.0]])
    t = marker_truth(markers, camera, Pose.identity())
    assert t.xy[0, 0] == pytest.approx(-0.5)
    assert t.fraction[0] == pytest.approx(0.5, abs=0.02)
    assert not t.visible[0]


def test_truth_with_a_mesh_is_the_rendering_s(small_test):
    shot = small_test.shot("wind-on")
    p = shot.perfect
    again = marker_truth(shot.world.markers, p.camera, p.cam_from_tunnel, shot.world.mesh)
    np.testing.assert_array_equal(again.visible, p.markers.visible)
    np.testing.assert_array_equal(again.fraction, p.markers.fraction)
    free = marker_truth(replace(shot.world.markers), p.camera, p.cam_from_tunnel)
    assert free.visible.sum() > again.visible.sum()  # the wing hides wall markers
