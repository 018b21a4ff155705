"""AIAA 2005-5007 section III.C: what it says of matching by RANSAC, and where its rule misleads."""

import numpy as np
import pytest
import registration_scenes as scenes

from windmark.geometry import Pose
from windmark.registration import register
from windmark.registration.search.layout import Layout, interior_angles
from windmark.registration.search.links import marker_triplets
from windmark.registration.search.plane import Plane
from windmark.registration.search.search import Search
from windmark.registration.task import Task


def task_of(scene):
    return Task(scene.markers, scene.camera, scene.detections.xy, scene.detections.cov, 6.0)


def test_interior_angles_are_within_90_plus_minus_80_degrees():
    """'the interior angles of the triangles [...] must be in a range of 90 +- 80 degrees'"""
    scene = scenes.scene(3)
    triplets = marker_triplets(Layout(scene.markers).model, 23)
    angles = np.degrees(interior_angles(scene.markers.xyz[triplets]))
    assert angles.min() >= 10
    assert angles.max() <= 170
    assert len(triplets) < 24 * 23 * 22 / 6  # some were rejected


@pytest.mark.slow
def test_ninety_per_cent_seen_means_73_per_cent_of_triplets_are_right():
    """'if 90% of the true markers are viewed, the probability to make a right choice [...] is 0.9^3 = 0.73'"""
    share = []
    for seed in range(200):
        scene = scenes.scene(seed, hidden=0.1)
        seen = np.isin(np.arange(24), scene.label)
        triplets = marker_triplets(Layout(scene.markers).model, 4)
        share.append(seen[triplets].all(axis=1).mean() / seen.mean() ** 3)
    assert np.mean(share) == pytest.approx(1.0, abs=0.05)


def test_fast_when_all_markers_are_visible_longer_when_not():
    """'The algorithm is very fast when all the real markers are visible [...] It may take some time when [...] not'"""

    def links(hidden):
        counts = []
        for seed in range(12):
            scene = scenes.scene(seed, "B", hidden=hidden)
            search = Search(Plane(task_of(scene)), 60.0, method="ransac")
            for tried in search.batches():
                if search.best is not None and search.best.score > 60:
                    counts.append(tried)
                    break
        assert len(counts) == 12
        return np.mean(counts)

    assert links(0.0) < 0.5 * links(0.6)


def test_links_tried_stay_far_below_all_links():
    """A blind search would link every three markers to every three spots."""
    scene = scenes.scene(4, "B", hidden=0.25, false=0.5)
    result = register(scene.detections, scene.markers, scene.camera)
    m = len(scene.detections)
    assert result
    assert result.n_hypotheses < 1e-3 * m * (m - 1) * (m - 2) * 60 * 59 * 58 / 6


def test_severe_motion_needs_no_start():
    """'handle even severe motion because it uses the pose solution which takes into account the 3D feature'"""
    rng = np.random.default_rng(8)
    markers = scenes.wing_and_body(rng)
    labels = []
    for tilt, roll, distance in ((0, 0, 8.0), (60, 90, 8.0), (45, 180, 20.0), (75, 270, 6.0)):
        camera = scenes.Camera((1280, 1000), 2400.0)
        eye = np.array([np.sin(np.radians(tilt)), 0.0, np.cos(np.radians(tilt))]) * distance + [0.4, 0, 0]
        up = [np.cos(np.radians(roll)), np.sin(np.radians(roll)), 0.01]
        scene = scenes.image_of(rng, markers, camera, Pose.look_at(eye, [0.4, 0, 0], up), noise_px=0.2)
        result = register(scene.detections, markers, camera)
        assert result, result.reason
        assert scenes.pose_error_px(result.cam_from_model, scene) < 1.5
        labels.append(set(result.matching.marker.tolist()))
    assert len(set.intersection(*labels)) >= 15


def test_non_matched_markers_are_accepted():
    """'one or more non-matched real marker can be accepted'"""
    scene = scenes.scene(9, "A", hidden=0.5)
    result = register(scene.detections, scene.markers, scene.camera)
    assert result
    assert len(result.matching) == len(scene.detections) < result.n_expected


def test_prior_rejects_by_angle_and_scale():
    """'PoVs too far from the current one are rejected [...] based on scaling change and on angle change'"""
    scene = scenes.scene(10, "A", hidden=0.25)
    pose = scene.cam_from_model
    near = register(scene.detections, scene.markers, scene.camera, prior=pose)
    assert near
    for prior in (Pose.from_rotvec([0, 0.8, 0], [0, 0, 0]) @ pose, Pose(pose.rotation, 2 * pose.translation)):
        assert not register(scene.detections, scene.markers, scene.camera, prior=prior, max_hypotheses=60_000)


@pytest.mark.slow
def test_all_matched_is_not_the_exact_solution():
    """'If all the real markers are matched, the exact solution is found' does not hold on regular rows.

    On exactly regular rows with hidden markers and false spots, other labellings match as many of the markers
    they expect in view; by evidence none of them is accepted.
    """
    misleading = 0
    for seed in range(30):
        scene = scenes.scene(seed, "A0", hidden=0.5, false=0.5)
        search = Search(Plane(task_of(scene)), 0.0, method="ransac", seed=seed)
        for _ in search.batches():
            best = search.best
            # The paper's rule with half of the markers hidden: as many matched as can be.
            if best is not None and best.count >= (scene.label >= 0).sum() - 2:
                misleading += scenes.pose_error_px(best.cam_from_model, scene) > 10
                break
        result = register(scene.detections, scene.markers, scene.camera, seed=seed)
        if result:
            assert scenes.pose_error_px(result.cam_from_model, scene) < 3
    assert misleading >= 1
