"""Kernels that judge and report a settled solution, against dense linear algebra and the full camera."""

from dataclasses import replace

import numpy as np
import pytest
import registration_scenes as scenes
from test_settle import candidate_of, curved_scene, plane_of

from windmark.geometry.rotations import hat
from windmark.registration import criteria
from windmark.registration._kernels import fit as fits
from windmark.registration._kernels.fit import copy_of
from windmark.registration._kernels.quad import first_of_each_kernel
from windmark.registration._kernels.raster import project_kernel
from windmark.registration.criteria import focal_gain, other_focal_explains
from windmark.registration.evidence import Evidence
from windmark.registration.solution import settle, with_free_focal


def solution_of(seed, **more):
    scene = curved_scene(seed)
    plane = plane_of(scene, **more)
    return scene, plane, settle(plane, candidate_of(scene))


def seen(plane, solution, delta):
    """Where the matched markers are in the plane after a small change of [rotation, translation, log focal length]."""
    state = solution.state
    theta = float(np.linalg.norm(delta[:3]))
    k = hat(delta[:3] / max(theta, 1e-300))
    turn = np.eye(3) + np.sin(theta) * k + (1 - np.cos(theta)) * k @ k
    xyz = plane.model.xyz[solution.marker] @ (turn @ state.rotation).T + turn @ state.translation + delta[3:6]
    return state.numbers[fits.FOCAL] * np.exp(delta[6]) * xyz[:, :2] / xyz[:, 2:]


def test_gain_is_what_least_squares_with_one_more_unknown_gains():
    _, plane, solution = solution_of(7)
    step = 1e-6
    columns = [(seen(plane, solution, d) - seen(plane, solution, -d)).ravel() / (2 * step) for d in step * np.eye(7)]
    residual = (plane.spots.p[solution.detection] - seen(plane, solution, np.zeros(7))).ravel()
    blocks = solution.state.spread[solution.marker][:, [0, 1, 1, 2]].reshape(-1, 2, 2)
    white = np.zeros((2 * len(blocks), 2 * len(blocks)))
    for n, block in enumerate(blocks):
        white[2 * n : 2 * n + 2, 2 * n : 2 * n + 2] = np.linalg.inv(np.linalg.cholesky(block))
    a, b = white @ np.array(columns).T, white @ residual
    scale = np.linalg.norm(a, axis=0)
    cost = [0.5 * np.linalg.lstsq(a[:, :n] / scale[:n], b, rcond=None)[1][0] for n in (6, 7)]
    assert cost[0] - cost[1] > 0.01
    assert focal_gain(plane, solution) == pytest.approx(cost[0] - cost[1], rel=1e-3)


@pytest.mark.parametrize("more", [{}, {"focal_factors": (0.6, 1.0, 1.6)}])
def test_covariance_is_the_inverse_of_the_normal_equations_in_the_models_frame(more):
    _, plane, solution = solution_of(8, **more)
    size, scale = solution.size, plane.frame.scale
    assert size == (7 if more else 6)
    change = np.eye(size)
    change[3:6, :3] = scale * hat(solution.state.translation)
    change[3:6, 3:6] *= scale
    if more:
        change[6, 6] = solution.focal_px
    factor = np.tril(solution.state.factor[:size, :size])
    expected = change @ np.linalg.inv(factor @ factor.T) @ change.T
    sigma = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(solution.cov / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), atol=1e-6)


def test_projection_is_that_of_the_camera():
    scene, _, _ = solution_of(9)
    camera, pose = scene.camera, scene.cam_from_model
    xyz = np.concatenate([scene.markers.xyz, pose.inverse().apply([[0.0, 0.0, -1.0]])])
    expected, valid = camera.project(pose.apply(xyz))
    assert not valid[-1]
    got = project_kernel(camera.packed(), pose.rotation, pose.translation, xyz)
    np.testing.assert_allclose(got, expected, atol=1e-9)


def test_first_quads_of_anchors():
    quad = np.array([[3, 0, 1, 2], [1, 0, 2, 3], [3, 1, 2, 0], [0, 1, 2, 3], [1, 2, 3, 0]], np.int32)
    assert first_of_each_kernel(quad, 4, 9).tolist() == [0, 1, 3]
    assert first_of_each_kernel(quad, 4, 2).tolist() == [0, 1]
    assert first_of_each_kernel(quad[:0], 4, 2).tolist() == []


def test_a_wrong_pair_does_not_hide_a_wrong_focal_length(monkeypatch):
    """Half of the right pairs, as a deformation may have them, and a wrong one that holds the focal length."""
    scene = scenes.scene(1, "B", hidden=0.3, noise_px=0.2)
    right = settle(plane_of(scene), candidate_of(scene))
    wrong = replace(scene.camera, focal_px=0.8 * scene.camera.focal_px)
    plane = plane_of(replace(scene, camera=wrong))
    matched = np.flatnonzero(right.state.match >= 0)
    kept = np.random.default_rng([1, 4]).permutation(matched)[: len(matched) // 2]
    match = np.full(len(right.state.match), -1, np.int32)
    match[kept] = right.state.match[kept]
    spare = np.setdiff1d(right.state.match[matched], match[kept])
    off = np.hypot(*(plane.spots.p[spare] - plane.spots.p[match[kept[0]]]).T)

    def seen_with(match):
        state = copy_of(right.state)
        state.match[:] = match
        state.numbers[fits.FOCAL] = wrong.focal_px
        marker = np.flatnonzero(match >= 0)
        return replace(
            right, state=state, marker=marker, detection=match[marker].astype(np.int64), focal_px=wrong.focal_px,
            expected=len(matched) + 8, evidence=Evidence(120.0, -40.0),
        )  # fmt: skip

    assert other_focal_explains(plane, seen_with(match))
    match[kept[0]] = spare[off.argmin()]
    misled = seen_with(match)
    freed = with_free_focal(plane, misled)
    assert freed is None or freed.evidence.score < misled.evidence.score
    assert other_focal_explains(plane, misled)
    # Where nearly all markers are matched the residuals tell a wrong pair, and none is left out on trial.
    assert not other_focal_explains(plane, replace(misled, expected=misled.count))
    # Of thousands of pairs each left out once would take minutes, and one of them is nothing.
    monkeypatch.setattr(criteria, "MANY", misled.count - 1)
    assert not other_focal_explains(plane, misled)
