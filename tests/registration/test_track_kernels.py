"""The kernels of tracking against slow, readable twins."""

from dataclasses import replace

import numpy as np
import pytest
import registration_scenes as scenes

from windmark.geometry import Camera, Pose
from windmark.registration import prepare
from windmark.registration.register import default_tolerance
from windmark.registration.search.plane import Plane, to_plane
from windmark.registration.task import Task
from windmark.registration.track._kernels import gates, motion, spots
from windmark.registration.track.prepared import Prepared


@pytest.fixture(scope="module")
def view():
    scene = scenes.scene(21, "B", hidden=0.2, false=0.5)
    prepared = Prepared.of(scene.markers, scene.camera, prepare(scene.markers))
    plane = spots.to_plane_kernel(prepared.packed, prepared.size, scene.detections.xy, scene.detections.cov)
    made, columns, tolerance = spots.spots_of(
        prepared.packed, prepared.size, *plane, scene.detections.radius_px, 0.0, 0.0
    )
    return scene, prepared, made, columns, tolerance


def in_the_plane(camera, xy, cov):
    """(M, 3) xx, xy, yy of covariances of image points, brought to the search plane by difference quotients."""
    columns = [(to_plane(camera, xy + h) - to_plane(camera, xy - h)) / 1e-2 for h in 5e-3 * np.eye(2)]
    turn = np.stack(columns, axis=-1)
    return (turn @ cov @ turn.transpose(0, 2, 1)).reshape(-1, 4)[:, [0, 1, 3]]


@pytest.mark.parametrize("lens", [{}, {"k1": -0.2, "k2": 0.05, "p1": 1e-3, "tilt_x": 0.02, "aspect": 1.02}])
def test_plane_points_are_those_of_the_camera(lens):
    camera = Camera((1280, 1000), 1100.0, **lens)
    rng = np.random.default_rng(1)
    xy, root = rng.uniform(0, 1, (50, 2)) * camera.size_px, rng.normal(0, 0.2, (50, 2, 2))
    cov = root @ root.transpose(0, 2, 1)
    got, spread = spots.to_plane_kernel(camera.packed(), np.array(camera.size_px, dtype=float), xy, cov)
    np.testing.assert_allclose(got, to_plane(camera, xy), atol=1e-6)
    np.testing.assert_allclose(spread, in_the_plane(camera, xy, cov), rtol=2e-5, atol=1e-7)


def test_points_in_order_and_columns_that_miss_none():
    rng = np.random.default_rng(4)
    for x in (rng.uniform(-900, 900, 80), rng.integers(0, 9, 30).astype(float), np.array([5.0, 1.0, 1.0]), np.zeros(4)):
        p = np.stack([x, rng.normal(size=len(x))], axis=1)
        order, sorted_x, sorted_y, columns = spots._in_order(p)
        np.testing.assert_array_equal(order, np.argsort(x, kind="stable"))
        np.testing.assert_array_equal(np.stack([sorted_x, sorted_y], axis=1), p[order])
        for asked in [*rng.uniform(-1000, 1000, 50), *x, -np.inf, np.inf]:
            place, exact = spots.place_of(columns, asked), np.searchsorted(sorted_x, asked)
            assert place <= exact
            assert place == exact or asked - sorted_x[place] <= 1.01 * np.ptp(x) / (2 * len(x))


def test_spots_are_those_of_the_search_plane(view):
    scene, _, made, _, tolerance = view
    plane = Plane(Task(scene.markers, scene.camera, scene.detections.xy, scene.detections.cov, tolerance))
    picture = plane.picture(len(scene.detections))
    np.testing.assert_allclose(made.density, picture.density, rtol=1e-9)
    np.testing.assert_allclose(
        made.cov, in_the_plane(scene.camera, scene.detections.xy, scene.detections.cov), rtol=1e-6
    )
    np.testing.assert_array_equal(made.x, np.sort(picture.p[:, 0]))


def test_prediction_is_that_of_the_matrices():
    rng = np.random.default_rng(2)
    root = rng.normal(0, 0.01, (12, 12))
    pose = Pose.from_rotvec([0.3, -0.2, 0.9], [0.1, 0.2, 8.0])
    before = motion.Estimate(pose.rotation, pose.translation, rng.normal(0, 0.01, 6), root @ root.T)
    change, f, q = np.array([0.004, 0.002]), np.eye(12), np.zeros((12, 12))
    f[:6, 6:] = np.eye(6)
    got = motion.predict_kernel(before, change, 3.0)
    # Three single frames, one after the other.
    cov = before.cov
    step = np.repeat([change[0] ** 2, change[1] ** 2 * float(got.translation @ got.translation)], 3)
    q[:6, :6] = q[:6, 6:] = q[6:, :6] = q[6:, 6:] = np.diag(step)
    for _ in range(3):
        cov = f @ cov @ f.T + q
    np.testing.assert_allclose(got.cov, cov, rtol=1e-9, atol=1e-15)
    turned = Pose.from_rotvec(3 * before.velocity[:3], np.zeros(3)).rotation @ pose.rotation
    np.testing.assert_allclose(got.rotation, turned, atol=1e-12)
    np.testing.assert_allclose(got.translation, pose.translation + 3 * before.velocity[3:])


def test_update_is_that_of_kalman():
    rng = np.random.default_rng(3)
    root, noise = rng.normal(0, 0.02, (12, 12)), rng.normal(0, 0.01, (6, 6))
    cov, measured, innovation = root @ root.T, noise @ noise.T, rng.normal(0, 0.01, 6)
    before = motion.Estimate(np.eye(3), np.array([0.0, 0.0, 5.0]), np.zeros(6), cov)
    got = motion.update_kernel(before, innovation, measured)
    h = np.eye(6, 12)
    gain = cov @ h.T @ np.linalg.inv(h @ cov @ h.T + measured)
    np.testing.assert_allclose(got.cov, cov - gain @ h @ cov, atol=1e-12)
    np.testing.assert_allclose(got.velocity, gain[6:] @ innovation, atol=1e-12)
    np.testing.assert_allclose(got.translation - before.translation, gain[3:6] @ innovation, atol=1e-12)
    distance2 = motion.distance2_of(innovation, cov, measured)
    assert distance2 == pytest.approx(innovation @ np.linalg.solve(cov[:6, :6] + measured, innovation))


@pytest.mark.parametrize("turn", [[0.0, 0.0, 0.0], [1e-9, 0.0, 0.0], [0.3, -1.2, 0.4], [3.1, 0.0, 0.1]])
def test_difference_leads_from_one_pose_to_the_other(turn):
    start, out = Pose.from_rotvec([0.5, 0.1, -0.7], [1.0, 2.0, 3.0]), np.empty(6)
    end = Pose.from_rotvec(turn, np.zeros(3)).rotation @ start.rotation
    motion.difference(end, start.translation + 0.5, start.rotation, start.translation, out)
    np.testing.assert_allclose(out, [*turn, 0.5, 0.5, 0.5], atol=1e-7)


def test_labels_in_gates_are_those_of_the_slow_twin(view):
    scene, prepared, made, columns, tolerance = view
    r, t = prepared.layout.frame.unit(scene.cam_from_model)
    cov = np.diag([1e-6] * 3 + [4e-5] * 3)
    sight = gates.sight_from(
        prepared.markers, prepared.layout.model.near, r, np.ascontiguousarray(t), scene.camera.focal_px, cov
    )
    match, floor2 = np.empty(len(scene.markers), np.int32), (0.25 * tolerance) ** 2
    count = gates.label_in_gates(sight, made, columns, floor2, match)
    pairs = []
    for m in np.flatnonzero(sight.seen):
        spread = sight.by_pose[m] @ cov @ sight.by_pose[m].T + floor2 * np.eye(2)
        for s in range(len(made.p)):
            offset = made.p[s] - sight.uv[m]
            total = spread + made.cov[s][[0, 1, 1, 2]].reshape(2, 2)
            d2 = offset @ np.linalg.solve(total, offset)
            near = np.linalg.norm(offset) < gates.SHARE * sight.spacing[m]
            if d2 < gates.GATE and near and abs(offset[0]) <= np.sqrt(gates.GATE * spread[0, 0]):
                pairs.append((d2, m, s))
    twin = np.full(len(match), -1)
    for _, m, s in sorted(pairs):
        if twin[m] < 0 and s not in twin:
            twin[m] = s
    np.testing.assert_array_equal(match, twin)
    assert count == (twin >= 0).sum() > 10


def test_a_supposed_pair_brings_back_a_common_shift(view):
    """A prediction that is off by more than the markers' spacing."""
    scene, prepared, made, columns, tolerance = view
    r, t = prepared.layout.frame.unit(scene.cam_from_model)
    focal, near = scene.camera.focal_px, prepared.layout.model.near
    true = gates.sight_from(prepared.markers, near, r, np.ascontiguousarray(t), focal, np.eye(6))
    shift = 40.0 * t[2] / focal
    r0, t0, cov = r.copy(), t + np.array([shift, -0.5 * shift, 0.0]), np.diag([1e-6] * 3 + [shift**2, shift**2, 1e-6])
    sight = gates.sight_from(prepared.markers, near, r0, t0, focal, cov)
    worth = gates.supposed(prepared.markers, sight, made, columns, focal, r0, t0, cov, (0.25 * tolerance) ** 2)
    found = gates.sight_from(prepared.markers, near, r0, t0, focal, cov)
    assert worth > 50
    assert np.abs(found.uv - true.uv).max() < 4


@pytest.mark.parametrize("share", [0.0, 0.01, 0.06])
def test_the_usual_tolerance_is_that_of_register(view, share):
    """Wider for a rough table, never so wide that neighbouring spots are one."""
    scene = view[0]
    sigma = np.full((len(scene.markers), 3), share * np.ptp(scene.markers.xyz))
    markers = replace(scene.markers, sigma=sigma)
    prepared = Prepared.of(markers, scene.camera, prepare(markers))
    plane = spots.to_plane_kernel(prepared.packed, prepared.size, scene.detections.xy, scene.detections.cov)
    radius = scene.detections.radius_px
    tolerance = spots.spots_of(prepared.packed, prepared.size, *plane, radius, 0.0, prepared.rough)[2]
    # The kernel takes distances in the search plane, where the lens has no distortion: so has this one.
    assert tolerance == pytest.approx(default_tolerance(scene.detections.xy, scene.camera, markers), rel=1e-9)
    assert (tolerance > view[4]) == (share > 0)
