"""The rivals of a tracked labelling against a slow, readable twin that looks at all of them."""

import numpy as np
import pytest
import registration_scenes as scenes
import track_scenes as sequences

from windmark.geometry import Pose
from windmark.registration import prepare
from windmark.registration._kernels.rival import thinnest
from windmark.registration.search.plane import Plane
from windmark.registration.settle._kernels.state import blank_kernel
from windmark.registration.settle.settling import settle
from windmark.registration.settle.views import Views
from windmark.registration.task import Task
from windmark.registration.track._kernels import rivals, spots
from windmark.registration.track.prepared import Prepared


def pose_cov(state):
    lower = np.tril(state.factor)
    return np.linalg.inv(lower @ lower.T)


def against(state, predicted):
    """Nats by which the motion speaks against a solution."""
    r0, t0, cov = predicted
    away = np.concatenate([Pose(state.rotation @ r0.T, np.zeros(3)).rotvec, state.translation - t0])
    return min(rivals.JUMP, 0.5 * away @ np.linalg.solve(cov + pose_cov(state), away))


def starts(prepared, best):
    """Pose and labels of every rival before it is refined, and whether it is another labelling."""
    r0, t0 = best.rotation, best.translation
    for onto, turn, shift in zip(*prepared.layout.symmetries, strict=True):
        match = np.full((1, len(onto)), -1, np.int32)
        match[0, onto[onto >= 0]] = best.match[0, onto >= 0]
        r = r0 @ turn.T
        yield r, t0 - r @ shift, match, True
    xyz = prepared.layout.model.xyz[best.match[0] >= 0]
    centre = xyz.mean(axis=0)
    normal = np.linalg.eigh((xyz - centre).T @ (xyz - centre))[1][:, 0]
    sight = t0 + r0 @ centre
    across = sight / np.linalg.norm(sight)
    r = (np.eye(3) - 2 * np.outer(across, across)) @ r0 @ (np.eye(3) - 2 * np.outer(normal, normal))
    yield r, sight - r @ centre, best.match, False


def slow_lead(prepared, best, predicted):
    """Lead over the best of all rivals, none left out, and the labels of that one."""
    lead, labels = np.inf, None
    for r, t, match, other_labels in starts(prepared, best.state):
        if not other_labels and np.linalg.norm(Pose(r @ best.state.rotation.T, np.zeros(3)).rotvec) > 5 * np.sqrt(
            np.trace(predicted[2][:3, :3])
        ):
            continue
        trial = settle(best.views, r, t, match)
        if trial is None:
            continue
        turned = np.linalg.norm(Pose(trial.state.rotation @ best.state.rotation.T, np.zeros(3)).rotvec)
        close = turned < 3 * np.sqrt(np.trace(pose_cov(best.state)[:3, :3]))
        if best.shared(trial) > rivals.SAME if other_labels else close:
            continue
        its = best.lead_over(trial) - best.freedom + trial.freedom
        its += against(trial.state, predicted) - against(best.state, predicted)
        if its < lead:
            lead, labels = its, trial.state.match.copy()
    return lead, labels


@pytest.mark.slow
@pytest.mark.parametrize("margin", [10.0, 40.0])
@pytest.mark.parametrize("sigma", [0.002, 0.02, 0.1])
@pytest.mark.parametrize(("kind", "hidden"), [("A", 0.5), ("A0", 0.3), ("B", 0.4), ("G", 0.2)])
def test_the_lead_is_that_over_all_rivals(kind, hidden, sigma, margin):
    """Whatever the prediction leaves open; rivals beyond the margin need not be looked at."""
    rng = np.random.default_rng([31, ord(kind[0]), len(kind)])
    near = 0
    for _ in range(4):
        markers = sequences.markers_of(rng, kind)
        camera, pose = scenes.random_view(rng, markers)
        scene = scenes.image_of(rng, markers, camera, pose, hidden=hidden, false=1.0, noise_px=0.2)
        prepared = Prepared.of(markers, camera, prepare(markers))
        model, found = prepared.layout.model, scene.detections
        sights = spots.sights_of(
            model.xyz, model.normal, model.near, prepared.sigma, prepared.packed, prepared.loose, prepared.size,
            found.xy, found.cov, found.radius_px, 0.0, 0.0, 0.0,
        )  # fmt: skip
        task = Task(markers, camera, found.xy, found.cov, sights.tolerance[0], radius_px=found.radius_px)
        r, t = prepared.layout.frame.unit(pose)
        match = np.full((1, len(markers)), -1, np.int32)
        match[0, scene.label[scene.label >= 0]] = np.flatnonzero(scene.label >= 0)
        best = settle(Views.of([Plane(task, prepared.layout)]), r, t, match)
        if best is None:
            continue
        predicted = (r, np.ascontiguousarray(t), np.diag([sigma**2] * 3 + [(sigma * t[2]) ** 2] * 3))
        rival = blank_kernel(sights)
        lead = rivals.rival_kernel(sights, prepared.layout.symmetries, predicted, best.state, margin, rival)
        expected, labels = slow_lead(prepared, best, predicted)
        assert min(lead, margin) == pytest.approx(min(expected, margin), abs=1e-6)
        if expected < margin:
            near += 1
            np.testing.assert_array_equal(rival.match, labels)
    assert near > 0 or kind != "G" or margin < 40


def test_thinnest_direction_is_the_eigenvector():
    rng = np.random.default_rng(32)
    for sizes in ([1.0, 2.0, 3.0], [0.0, 1.0, 1.0], [0.0, 0.5, 1.0], [1e-3, 1.0, 100.0]):
        q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        got = thinnest(np.ascontiguousarray(q @ np.diag(sizes) @ q.T))
        assert abs(got @ q[:, 0]) == pytest.approx(1.0, abs=1e-9)
    np.testing.assert_allclose(np.linalg.norm(thinnest(2 * np.eye(3))), 1.0)
