"""The pose of a model that may be bent: against dense matrices, and against the truth."""

import sys
from dataclasses import replace
from pathlib import Path

import bent_scenes
import numpy as np
import pytest
import registration_scenes as scenes
import settle_scenes as settling
import settle_twins as twins
from scipy.linalg import block_diag
from scipy.special import logsumexp

from windmark.registration import prepare, register
from windmark.registration.judge import root
from windmark.registration.judge.answer import answer
from windmark.registration.search import field
from windmark.registration.settle.settling import accepted, copied
from windmark.scene import Detections, MarkerSet

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import _attack_scenes as attacks


def unit(markers):
    from_centre = markers.xyz - markers.xyz.mean(axis=0)
    return from_centre / np.sqrt((from_centre**2).sum(axis=1).mean())


def whitened(scene, pose, cov):
    """Chi-square over six of a pose; 1 on average for a true covariance."""
    delta = (scene.cam_from_model @ pose.inverse()).log()
    return delta @ np.linalg.solve(cov[:6, :6], delta) / 6


# --- how a mode goes on ----------------------------------------------------------------------------


def test_a_mode_goes_on_from_a_marker_as_the_rigid_motion_nearest_to_its_slope():
    xyz = unit(scenes.wing_and_body(np.random.default_rng(3)))
    rigid = np.zeros(len(xyz), bool)
    near = xyz[40] + 1e-5 * np.concatenate([np.eye(3), -np.eye(3)])  # more places to see the modes at, by Nystroem
    made = field.field_of(xyz, rigid, 2.0)
    amplitude = made.amplitude(1.0)
    assert (amplitude == 1).all()
    seen = np.exp(-0.5 * ((near[:, None] - xyz) ** 2).sum(axis=2) / 4.0)
    own = np.exp(-0.5 * ((xyz[:, None] - xyz) ** 2).sum(axis=2) / 4.0)
    at = np.einsum("sn,knc->ksc", seen, np.linalg.lstsq(own, made.modes.transpose(1, 0, 2).reshape(len(xyz), -1),
                   rcond=1e-11)[0].reshape(len(xyz), -1, 3).transpose(1, 0, 2))  # fmt: skip
    slope = ((at[:, :3] - at[:, 3:]) / 2e-5).transpose(0, 2, 1)  # (K, of what, by what)
    for k in range(0, len(made.modes), 5):
        # The rigid motion about the marker that is nearest to the slope over the whole model.
        turns = np.stack([np.cross(axis, xyz).ravel() for axis in np.eye(3)], axis=1)
        turn = np.linalg.lstsq(turns, (xyz @ slope[k].T).ravel(), rcond=None)[0]
        np.testing.assert_allclose(made.motions[40, :3, k], turn, atol=1e-3)
        there = made.motions[40, 3:, k] + np.cross(made.motions[40, :3, k], xyz[40])
        np.testing.assert_allclose(there, made.modes[k, 40], atol=1e-9)


@pytest.mark.parametrize("reach", [field.REACH, field.FAR])
def test_modes_of_the_pose_hold_a_bow_that_begins_at_a_root(reach):
    """To 1 % of it: what they leave out is taken for a motion of the whole model."""
    for make in (scenes.wing, scenes.wing_and_body):
        xyz = unit(make(np.random.default_rng(5)))
        axes, extent = field.extents(xyz)
        bow = np.clip((xyz @ axes[0] + 0.5 * extent[0]) / extent[0] - 0.25, 0, None)[:, None] ** 2 * axes[2]
        made = field.field_of(xyz, np.zeros(len(xyz), bool), reach, field.FAINTEST).modes.reshape(-1, xyz.size).T
        rest = bow.ravel() - made @ np.linalg.lstsq(made, bow.ravel(), rcond=None)[0]
        assert np.abs(rest).max() < 0.01 * np.abs(bow).max()


# --- evidence and moments --------------------------------------------------------------------------


@pytest.mark.parametrize("bent", [False, True])
def test_evidence_and_moments_are_those_of_dense_matrices(bent, monkeypatch):
    """For one size and two noises: the likelihood with a flat prior of the pose, and the root's pose in the mean."""
    monkeypatch.setattr(root, "AMPLITUDES", np.array([0.01]))
    monkeypatch.setattr(root, "NOISES", np.array([[0.0], [1.0]]))
    scene, _ = bent_scenes.scene(7110, "B", bent_scenes.Bend(0.01))
    understated = 0.5 * float(np.sqrt(scene.detections.cov[0, 0, 0]))
    scene = replace(scene, detections=Detections.make(scene.detections.xy, sigma_px=understated))
    views = settling.views_of(scene)
    views = settling.bent_views(views) if bent else views
    best = settling.settled(views, scene)
    assert best.excess_px > 0
    made, size = views.layout.fields[1], views.layout.size
    found_shift, found_second = root._by_field(best, made).moments(np.array([1.0, 0.0, 0.0]))
    found_cov = found_second - np.outer(found_shift, found_shift)

    matched = np.flatnonzero(best.state.match[0] >= 0)
    flat = best.views.bent(made.modes)
    moved = replace(flat)
    moved.__dict__["sights"] = flat.sights._replace(xyz=flat.sights.xyz + best.displacement)
    state = copied(flat, best.state)
    state.bent[:] = 0.0
    by = twins.by_unknowns(moved, state)[0, matched]
    xyz = by[:, :, 6:].reshape(2 * len(matched), -1)
    pose = by[:, :, :6].reshape(-1, 6)
    # What the solution's deformation does is in the data again.
    with_it = best.views.bent(best.displacement[None])
    one = twins.by_unknowns(_moved(with_it, best), _bare(with_it, best))[0, matched][:, :, 6].ravel()
    seen = one - best.state.residual[0, matched].ravel()
    cov, prior = block_diag(*twins.square(best.state.spread[0, matched])), (0.01 * size * made.amplitude(0.1)) ** 2
    values, shifts, seconds = [], [], []
    by_root = np.concatenate([
        np.stack([best.state.rotation @ made.motions[m, :3] for m in matched]),
        np.stack([best.state.rotation @ made.motions[m, 3:] for m in matched]),
    ], axis=1)  # fmt: skip
    for noise in root._noises(best, best.state.match >= 0)[:, 0]:
        whole = noise * cov + (xyz * prior) @ xyz.T
        inverse = np.linalg.inv(whole)
        fit = pose.T @ inverse @ pose
        turn = np.linalg.solve(fit, pose.T @ inverse @ seen)
        square = (seen - pose @ turn) @ inverse @ (seen - pose @ turn)
        values.append(-0.5 * (square + np.linalg.slogdet(whole)[1] + np.linalg.slogdet(fit)[1]))
        both = np.concatenate([pose, xyz], axis=1)
        normal = both.T @ np.linalg.inv(noise * cov) @ both + np.diag(np.append(np.zeros(6), 1 / prior))
        joint = np.linalg.inv(normal)
        mean = joint @ both.T @ np.linalg.inv(noise * cov) @ seen
        each = np.concatenate([np.broadcast_to(np.eye(6), (len(matched), 6, 6)), by_root], axis=2)
        shifts.append(each @ mean)
        seconds.append((each @ joint @ each.transpose(0, 2, 1)).mean(axis=0) + shifts[-1].T @ shifts[-1] / len(matched))
    weight = np.exp(np.array(values) - logsumexp(values))
    shift = weight @ np.mean(shifts, axis=1)
    spread = np.einsum("n,nij->ij", weight, seconds) - np.outer(shift, shift)
    sigma = np.sqrt(np.diag(spread))
    np.testing.assert_allclose(found_shift / sigma, shift / sigma, atol=1e-3)
    np.testing.assert_allclose(found_cov / np.outer(sigma, sigma), spread / np.outer(sigma, sigma), atol=5e-3)


def _moved(views, best):
    views.__dict__["sights"] = views.sights._replace(xyz=views.sights.xyz + best.displacement)
    return views


def _bare(views, best):
    state = copied(views, best.state)
    state.bent[:] = 0.0
    return state


# --- what is reported ------------------------------------------------------------------------------


def test_a_bent_model_is_where_it_was_by_another_pose():
    scene, _ = bent_scenes.scene(7112, "B", bent_scenes.Bend(0.02))
    best = settling.settled(settling.bent_views(settling.views_of(scene)), scene)
    final, cov = answer(best)
    before = root.likeliest(accepted(best))
    assert final.rig_from_model.angle_to(before.rig_from_model) > 1e-4
    xyz, frame = scene.markers.xyz, before.views.layout.frame
    places = [s.rig_from_model.apply(xyz + frame.scale * s.displacement) for s in (before, final)]
    np.testing.assert_allclose(places[0], places[1], atol=1e-9)
    np.testing.assert_array_equal(before.state.residual, final.state.residual)
    assert len(cov) == len(final.state.factor)
    assert np.linalg.eigvalsh(cov[:6, :6]).min() > 0
    assert before.largest == pytest.approx(final.largest, rel=0.02)  # no rigid motion is a deformation


@pytest.mark.parametrize("seed", [41000026, 62100039])
def test_the_likeliest_deformation_is_at_rest(seed):
    """One face of a swaying tower, far away: little tells pose from bending, and the first one found is degrees off."""
    trial = attacks.trial(f"bent/root 4%/{seed}")
    seen = scenes.Scene(trial.detections, trial.markers, trial.camera, trial.truth.poses[0], trial.truth.label)
    first = accepted(settling.settled(settling.bent_views(settling.views_of(seen)), seen))
    best = root.likeliest(first)
    assert first.rig_from_model.angle_to(best.rig_from_model) > np.radians(1.0)
    assert root.likeliest(best).rig_from_model.angle_to(best.rig_from_model) < np.radians(0.05)
    np.testing.assert_array_equal(best.state.match, first.state.match)
    result = register(trial.detections, trial.markers, trial.camera)
    assert whitened(seen, result.cam_from_model, result.cov) < 9


@pytest.mark.slow
def test_sigma_of_bent_models_covers():
    """Wings with a body that stands still; by the bent and by the rigid model. One in a thousand would be above 3.7."""
    found = []
    for seed in range(8211, 8231, 2):
        scene, _ = bent_scenes.scene(seed, "B", bent_scenes.Bend(0.02), hidden=0.25)
        for most in (0.05, 0.0):
            result = register(scene.detections, scene.markers, scene.camera, max_deformation=most)
            if result:
                found.append((most, whitened(scene, result.cam_from_model, result.cov)))
    for most in (0.05, 0.0):
        square = [value for m, value in found if m == most]
        assert len(square) >= 4
        assert np.mean(square) < 1.5
        assert max(square) < 6


def test_sigma_of_rigid_models_stays():
    """Errors of the spots, larger than they say by chance, are no bending."""
    plain, covered = [], []
    for seed in range(8300, 8330):
        scene = scenes.scene(seed, "A" if seed % 2 else "B", hidden=0.25, false=0.25)
        best = settling.settled(settling.views_of(scene), scene)
        final, cov = answer(best)
        plain.append(np.sqrt(np.diag(final.unit_cov)))
        covered.append(np.sqrt(np.diag(cov)))
    assert np.mean(np.array(covered) / plain) < 1.05


def test_evidence_of_other_pictures_makes_a_rigid_pose_less_sure():
    best = settling.settled(settling.views_of(scene := scenes.scene(8301, "B")), scene)
    alone, known = (np.trace(answer(best, bends=bends)[1]) for bends in (0.0, 30.0))
    assert known > 2 * alone


def test_walls_are_the_root():
    """The deformation of the rest says nothing of where walls are: their pose is that of a rigid model."""
    scene, xyz = bent_scenes.scene(7113, "B", bent_scenes.Bend(0.02))
    walls = np.where((xyz == scene.markers.xyz).all(axis=1), "wall", "model")
    markers = MarkerSet.make(scene.markers.name, scene.markers.xyz, normal=scene.markers.normal, role=walls)
    result = register(scene.detections, markers, scene.camera, layout=prepare(markers))
    assert result.deformation is not None
    free = register(scene.detections, scene.markers, scene.camera)
    assert whitened(scene, result.cam_from_model, result.cov) < 3
    assert np.trace(result.cov) < 0.2 * np.trace(free.cov)
    still = np.linalg.norm(result.deformation.displacement[walls == "wall"], axis=1)
    assert still.max() < 0.1 * np.linalg.norm(result.deformation.displacement, axis=1).max()


def test_walls_alone_with_residuals_beyond_their_sigmas_have_the_pose_of_a_rigid_model():
    """Nothing of them can bend; it ended in an error: a camera that moves is looked for by walls alone."""
    scene = scenes.scene(8301, "B")
    role = np.full(len(scene.markers), "wall")
    markers = MarkerSet.make(scene.markers.name, scene.markers.xyz, normal=scene.markers.normal, role=role)
    off = np.random.default_rng(1).normal(0, 0.4, scene.detections.xy.shape)
    spots = Detections.make(scene.detections.xy + off, sigma_px=0.1)
    walls = register(spots, markers, scene.camera)
    assert walls.excess_px > 0.2
    assert walls.deformation is None
    assert whitened(scene, walls.cam_from_model, walls.cov) < 4
