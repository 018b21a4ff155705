"""The joint fit and labelling of several cameras against slow twins."""

import numpy as np
import pytest
import registration_scenes as scenes
from scipy.optimize import least_squares
from slow_twins import slow_label

from windmark.geometry import Pose
from windmark.registration._kernels import fit as fits
from windmark.registration.rig.joint import Cameras
from windmark.registration.search.layout import Layout
from windmark.registration.search.plane import Plane
from windmark.registration.task import Task


def cameras_of(rig):
    layout = Layout(rig.views[0].markers)
    tasks = [Task(v.markers, v.camera, v.detections.xy, v.detections.cov, 6.0) for v in rig.views]
    return Cameras([Plane(task, layout) for task in tasks], rig.cam_from_rig)


def settled(rig, cameras, keep=lambda c, m: True):
    """From the true pose, a little off, with the true labels of some markers."""
    match = np.full((len(rig.views), len(rig.views[0].markers)), -1, np.int32)
    for c, view in enumerate(rig.views):
        for spot, marker in enumerate(view.label):
            if marker >= 0 and keep(c, marker):
                match[c, marker] = spot
    pose = rig.rig_from_model @ Pose.from_rotvec([0.002, -0.001, 0.002], [0.001, 0.0, -0.001])
    return cameras.settle(*cameras.layout.frame.unit(pose), match)


@pytest.fixture(scope="module")
def rig():
    return scenes.rig_scene(41, "B", 3, hidden=0.3, false=1.0)


def test_fit_is_that_of_least_squares(rig):
    cameras = cameras_of(rig)
    joint = settled(rig, cameras)

    def whitened(delta):
        pose, rows = Pose.exp(delta) @ joint.rig_from_model, []
        for view, camera in zip(joint.views, rig.cam_from_rig, strict=True):
            task = cameras.planes[joint.views.index(view)].task
            seen, _ = task.camera.project((camera @ pose).apply(task.markers.xyz[view.marker]))
            spread = view.state.spread[view.marker][:, [0, 1, 1, 2]].reshape(-1, 2, 2)
            root = np.linalg.inv(np.linalg.cholesky(spread))
            rows.append(np.einsum("kij,kj->ki", root, seen - task.xy[view.detection]).ravel())
        return np.concatenate(rows)

    best = least_squares(whitened, np.zeros(6), method="lm", x_scale=np.sqrt(np.diag(joint.cov)))
    cov = np.linalg.inv(best.jac.T @ best.jac)
    sigma = np.sqrt(np.diag(cov))
    # The excess is of the round before.
    assert (np.abs(best.x) < 0.03 * sigma).all()
    np.testing.assert_allclose(joint.cov / np.outer(sigma, sigma), cov / np.outer(sigma, sigma), atol=0.03)


def test_every_camera_has_its_part_of_the_joint_uncertainty(rig):
    joint = settled(rig, cameras_of(rig))
    assert joint.state.taken.sum() == pytest.approx(6.0)
    assert (joint.state.taken > 0).all()
    for view, pose in zip(joint.views, rig.cam_from_rig, strict=True):
        # exp(delta) @ rig_from_model, seen by the camera, is exp(adjoint delta) @ cam_from_model.
        adjoint = np.zeros((6, 6))
        step = 1e-6
        for k in range(6):
            delta = step * np.eye(6)[k]
            adjoint[:, k] = (pose @ Pose.exp(delta) @ pose.inverse()).log() / step
        sigma = np.sqrt(np.diag(view.cov))
        moved = adjoint @ joint.cov @ adjoint.T
        np.testing.assert_allclose(view.cov / np.outer(sigma, sigma), moved / np.outer(sigma, sigma), atol=1e-4)


def test_settled_labels_are_those_of_the_slow_twin(rig):
    cameras = cameras_of(rig)
    joint = settled(rig, cameras)
    for plane, view, truth in zip(cameras.planes, joint.views, rig.views, strict=True):
        pairs = dict(zip(view.marker.tolist(), view.detection.tolist(), strict=True))
        assert pairs == slow_label(plane, view)
        assert (truth.label[view.detection] == view.marker).mean() > 0.9


def test_labels_of_one_camera_bring_those_of_the_others(rig):
    cameras = cameras_of(rig)
    joint = settled(rig, cameras, keep=lambda c, m: c == 1)
    np.testing.assert_array_equal(joint.state.match, settled(rig, cameras).state.match)
    assert sum(joint.scores) == pytest.approx(joint.evidence.score)


def test_three_pairs_are_lost(rig):
    first = rig.views[0].label[rig.views[0].label >= 0][:3].tolist()
    assert settled(rig, cameras_of(rig), keep=lambda c, m: c == 0 and m in first) is None


def test_accepted_excess_is_by_the_residuals_alone(rig):
    cameras = cameras_of(rig)
    joint = settled(rig, cameras)
    final = cameras.accepted(joint, cameras.rig)
    excess, before = final.state.numbers[:, fits.EXCESS], joint.state.numbers[:, fits.EXCESS]
    assert (excess <= before).all()
    assert (np.diag(final.cov) <= np.diag(joint.cov) * (1 + 1e-9)).all()
    np.testing.assert_array_equal(final.state.match, joint.state.match)
    assert final.evidence == joint.evidence
