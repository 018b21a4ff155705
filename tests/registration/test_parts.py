"""Triplets, the search plane and the pool, each by itself."""

from itertools import combinations

import numpy as np
import pytest
import registration_scenes as scenes

from windmark.geometry import Camera, Pose
from windmark.registration._kernels.hypothesis import Model
from windmark.registration._kernels.near import nearest
from windmark.registration.judge.words import beyond_prior
from windmark.registration.search import links, plane
from windmark.registration.search.layout import Frame, interior_angles, spread_corners, unit_model
from windmark.registration.search.pool import Candidate, Pool
from windmark.registration.task import Task, with_focal


def task_of(scene, **more):
    return Task(scene.markers, scene.camera, scene.detections.xy, scene.detections.cov, 6.0, **more)


def test_interior_angles_of_known_triangles():
    corners = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 0, 0]] * 3], float)
    angles = np.degrees(interior_angles(corners))
    np.testing.assert_allclose(angles[0], [90, 45, 45])
    np.testing.assert_allclose(np.sort(angles[1]), [0, 0, 180], atol=1e-6)
    np.testing.assert_allclose(angles[2], 0)


def test_marker_triplets_are_all_sound_ones_once():
    rng = np.random.default_rng(0)
    xyz = rng.normal(size=(9, 3)) * [1, 1, 0.05]
    model, _ = unit_model(xyz, np.full((9, 3), np.nan))
    chosen = links.marker_triplets(model, 8)
    got = {tuple(sorted(t)) for t in chosen.tolist()}
    assert len(got) == len(chosen)
    expected = set()
    for t in combinations(range(9), 3):
        angles = np.degrees(interior_angles(xyz[list(t)][None]))[0]
        if angles.min() >= 10:
            expected.add(t)
    assert got == expected
    assert len(expected) < 84  # the angle rule was at work
    every = links.marker_triplets(model, 8, every_corner=True)
    assert len(every) == 3 * len(chosen)


def test_too_few_markers_for_triplets():
    model = Model(np.zeros((2, 3)), np.zeros((2, 3)), np.array([[1], [0]], np.int32))
    assert len(links.marker_triplets(model, 4)) == 0


def test_turns_are_the_sign_of_the_area_in_the_image():
    rng = np.random.default_rng(2)
    markers = scenes.wing(rng)
    model, _ = unit_model(markers.xyz, markers.normal)
    chosen = links.marker_triplets(model, 8)
    turns = links.turns_of(model, chosen)
    for seed in range(5):
        camera, pose = scenes.random_view(np.random.default_rng(seed), markers)
        xy, _ = camera.project(pose.apply(markers.xyz))
        u, v = (xy[chosen[:, n]] - xy[chosen[:, 0]] for n in (1, 2))
        area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
        assert (area[turns != 0] * turns[turns != 0] > 0).all()
    back = Model(model.xyz, -model.normal, model.near)
    np.testing.assert_array_equal(links.turns_of(back, chosen), -turns)
    unknown = Model(model.xyz, np.zeros_like(model.normal), model.near)
    assert not links.turns_of(unknown, chosen).any()


def test_spread_corners_are_compact_and_spread():
    p = np.stack(np.meshgrid(np.arange(10.0) * 10, np.arange(8.0) * 10), axis=-1).reshape(-1, 2)
    corners = spread_corners(p, np.arange(80, dtype=np.int32), 5)
    assert corners.shape == (5, 3)
    heads = p[corners[:, 0]]
    assert min(np.linalg.norm(a - b) for a, b in combinations(heads, 2)) > 25
    assert max(np.ptp(p[c], axis=0).max() for c in corners) <= 20
    line = np.stack([np.arange(9.0), np.zeros(9)], axis=1)
    assert len(spread_corners(line, np.arange(9, dtype=np.int32), 5)) == 0


def test_frame_round_trips_poses():
    rng = np.random.default_rng(0)
    xyz = rng.normal(size=(7, 3)) * 30 + 100
    model, frame = unit_model(xyz, np.full((7, 3), np.nan))
    pose = Pose.from_rotvec([0.3, -0.2, 0.9], [10, 20, 300])
    rotation, translation = frame.unit(pose)
    np.testing.assert_allclose(frame.pose(rotation, translation).translation, pose.translation)
    np.testing.assert_allclose(frame.scale * (model.xyz @ rotation.T + translation), pose.apply(xyz))
    assert np.sqrt((model.xyz**2).sum(axis=1).mean()) == pytest.approx(1)


def test_with_focal_keeps_the_distortion_in_the_image():
    camera = Camera((1280, 800), 1000.0, k1=-0.2, k2=0.05, p1=1e-3, p2=-2e-3, k3=-0.01)
    other = with_focal(camera, 1500.0)
    ideal = np.random.default_rng(0).uniform(-0.5, 0.5, (20, 2)) * [1280, 800]
    for_both = [c.project(np.column_stack([ideal, np.full(20, c.focal_px)]))[0] for c in (camera, other)]
    np.testing.assert_allclose(*for_both, atol=1e-9)


def test_lead_sizes_end_with_all():
    assert plane.lead_sizes(10, 24) == [10]
    assert plane.lead_sizes(50, 24) == [50]
    assert plane.lead_sizes(700, 24) == [40, 80, 160, 320, 700]
    assert plane.lead_sizes(700, 480) == [700]


def test_density_is_local_and_never_below_average():
    rng = np.random.default_rng(0)
    cluster = rng.normal(500, 5, (20, 2))
    sparse = rng.uniform(0, 1000, (30, 2))
    distance = nearest(np.concatenate([cluster, sparse]), 16)[1]
    density = plane.density_of(distance, np.array([1000.0, 1000.0]))
    assert (density >= 50 / 1e6).all()
    assert np.median(density[:20]) > 50 * np.median(density[20:])


def test_pool_keeps_the_best_of_alike_and_all_distinct():
    pool = Pool(Frame(np.zeros(3), 1.0), 3, 4)

    def add(score, match, angle_deg=0.0):
        rotation = Pose.from_rotvec([0, 0, np.radians(angle_deg)], [0, 0, 0]).rotation
        pool.add(rotation, np.array([0.0, 0.0, 1.0]), 1000.0, float(score), np.array(match, np.int32))
        return [c.score for c in pool.top()]

    assert pool.top() == []
    assert add(10, [0, 1, 2, 3]) == [10]
    assert add(12, [0, 1, 2, -1], 1.0) == [12]  # alike and better: replaces
    first = pool.top()[0]
    assert first.count == 3
    assert add(11, [0, 1, 2, 3]) == [12]
    assert add(9, [0, 1, 2, 3], 40.0) == [12, 9]  # another pose of the same labels
    assert add(8, [1, 2, 3, 0]) == [12, 9, 8]  # a shifted labelling
    assert pool.top()[0] is first
    assert add(20, [3, 2, 1, 0]) == [20, 12, 9]
    assert add(5, [-1, 0, 3, 1]) == [20, 12, 9]


def test_prior_share_of_a_narrow_prior():
    scene = scenes.scene(1)
    assert task_of(scene).prior_share == 1
    with_prior = task_of(scene, prior=scene.cam_from_model, prior_max_angle_rad=np.radians(30), prior_max_scale=1.3)
    # Haar measure of rotations up to an angle, by Monte Carlo.
    q = np.random.default_rng(0).normal(size=(400_000, 4))
    share = np.mean(2 * np.arccos(np.abs(q[:, 0]) / np.linalg.norm(q, axis=1)) < np.radians(30))
    assert with_prior.prior_share == pytest.approx(share * np.log10(1.3), rel=0.05)
    anything = task_of(scene, prior=scene.cam_from_model, prior_max_angle_rad=np.pi, prior_max_scale=10.0)
    assert anything.prior_share == pytest.approx(1)


@pytest.mark.parametrize("count", [5, 40, 301])
def test_nearest_neighbours(count):
    rng = np.random.default_rng(count)
    points = rng.normal(size=(count, 3))
    points[3] = points[1]
    index, distance = nearest(points, 4)
    full = np.linalg.norm(points[:, None] - points[None], axis=2)
    np.fill_diagonal(full, np.inf)
    np.testing.assert_allclose(distance, np.sort(full, axis=1)[:, :4], atol=1e-12)
    np.testing.assert_allclose(full[np.arange(count)[:, None], index], distance, atol=1e-12)
    assert nearest(points[:1], 0)[0].shape == (1, 0)


def test_a_candidate_off_the_prior_is_described():
    scene = scenes.scene(5, "A")
    truth = scene.cam_from_model
    match = np.arange(24, dtype=np.int32)
    best = Candidate(truth, scene.camera.focal_px, 300.0, 24, match)
    center = scene.markers.xyz.mean(axis=0)
    farther = Pose(truth.rotation, 2.0 * truth.apply(center) - truth.rotation @ center)
    task = task_of(scene, prior=farther, prior_max_angle_rad=0.5, prior_max_scale=1.3)
    assert task.distance_ratio(truth, scene.camera.focal_px) == pytest.approx(0.5, rel=0.1)
    words = beyond_prior(task, best, 60.0)
    assert "off the prior: by 0 degrees (limit 29)" in words
    assert "times its distance (limit 1.3 times" in words
    assert beyond_prior(task, best, 400.0) == beyond_prior(task, None, 0.0) == ""
    assert beyond_prior(task_of(scene), best, 60.0) == ""
    assert beyond_prior(task_of(scene, prior=truth, prior_max_scale=1.3), best, 60.0) == ""
