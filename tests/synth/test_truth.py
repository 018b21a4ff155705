from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.scene import MarkerSet
from windmark.synth import marker_truth


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
