from __future__ import annotations

import numpy as np
import pytest

from windmark.geometry import DegenerateGeometry, Pose, Similarity, align
from windmark.geometry.rotations import exp_so3


def cloud(n=20, seed=0):
    return np.random.default_rng(seed).normal(size=(n, 3)) * [3, 2, 1] + [10, -5, 2]


TRUE = Similarity(2.5, exp_so3([0.4, -1.2, 2.0]), np.array([100.0, -3.0, 7.0]))


def test_exact_points_give_the_exact_similarity():
    x = cloud()
    found = align(x, TRUE.apply(x))
    assert found.scale == pytest.approx(2.5, rel=1e-14)
    np.testing.assert_allclose(found.rotation, TRUE.rotation, atol=1e-14)
    np.testing.assert_allclose(found.translation, TRUE.translation, atol=1e-12)
    assert found.rms < 1e-13


def test_rigid_keeps_the_scale():
    x = cloud()
    pose = Pose.exp([0.1, 0.2, 3.0, 1, 2, 3])
    found = align(x, pose.apply(x), scale=False)
    assert found.scale == 1.0
    assert float(found.pose.angle_to(pose)) < 1e-13
    stretched = align(x, 1.1 * pose.apply(x), scale=False)
    assert stretched.scale == 1.0
    assert stretched.rms > 0.1


def test_a_plane_and_three_points_are_enough():
    for x in (cloud() * [1, 1, 0], cloud(3)):
        found = align(x, TRUE.apply(x))
        np.testing.assert_allclose(found.rotation, TRUE.rotation, atol=1e-13)
        assert np.linalg.det(found.rotation) == pytest.approx(1)


def test_it_is_the_least_squares_solution():
    rng = np.random.default_rng(1)
    x, w = cloud(), rng.uniform(0.1, 5, 20)
    y = TRUE.apply(x) + 0.5 * rng.normal(size=x.shape)
    best = align(x, y, weights=w)

    def cost(s):
        return np.sum(w * np.sum((s.apply(x) - y) ** 2, axis=1))

    assert best.rms == pytest.approx(np.sqrt(cost(best) / w.sum()), rel=1e-12)
    for delta in 1e-4 * np.vstack([np.eye(7), -np.eye(7)]):
        turned = exp_so3(delta[:3]) @ best.rotation
        other = Similarity(best.scale * np.exp(delta[6]), turned, best.translation + delta[3:6])
        assert cost(other) > cost(best)


def test_weights_and_missing_rows():
    x = cloud()
    y = TRUE.apply(x)
    y[3] += 50
    x[5] = np.nan
    y[6] = np.nan
    weights = np.where(np.arange(20) == 3, 0.0, 1.0)
    assert align(x, y, weights=weights).rms < 1e-12
    assert align(x, y).rms > 1


def test_a_mirror_image_is_not_matched_by_a_reflection():
    x = cloud()
    found = align(x, x * [1, 1, -1])
    assert np.linalg.det(found.rotation) == pytest.approx(1)
    assert found.rms > 0.5


def test_inverse_and_composition():
    x = cloud()
    noisy = TRUE.apply(x) + 0.01 * np.random.default_rng(2).normal(size=x.shape)
    found = align(x, noisy)
    np.testing.assert_allclose(found.inverse().apply(found.apply(x)), x, atol=1e-12)
    assert found.inverse().rms == pytest.approx(found.rms / found.scale)
    both = found.inverse() @ found
    assert both.scale == pytest.approx(1)
    assert float(both.pose.angle_to(Pose.identity())) < 1e-14
    with pytest.raises(TypeError):
        _ = found @ np.eye(3)
    with pytest.raises(ValueError, match="scale 1"):
        _ = found.pose


@pytest.mark.parametrize(
    ("points", "word"),
    [
        (np.outer(np.arange(5.0), [1, 2, 3]) + 7, "collinear"),
        (np.ones((5, 3)) * 1e6, "coincide"),
        (np.eye(3)[:2], "at least three"),
        (np.full((4, 3), np.nan), "at least three"),
    ],
)
def test_degenerate_sets_are_named(points, word):
    with pytest.raises(DegenerateGeometry, match=word) as caught:
        align(points, cloud(len(points)))
    assert any("rotation" in w for w in caught.value.weak)
    with pytest.raises(DegenerateGeometry, match=word):
        align(cloud(len(points)), points)


def test_an_ambiguous_mirror_image_is_named():
    octahedron = np.vstack([np.eye(3), -np.eye(3)])
    with pytest.raises(DegenerateGeometry, match="several rotations"):
        align(octahedron, -octahedron)


def test_bad_input_is_named():
    x = cloud()
    with pytest.raises(ValueError, match=r"\(20, 3\) and \(19, 3\)"):
        align(x, x[:-1])
    with pytest.raises(ValueError, match="weights"):
        align(x, x, weights=-np.ones(20))
    with pytest.raises(ValueError, match="weights"):
        align(x, x, weights=np.ones(3))
    with pytest.raises(ValueError, match="scale"):
        Similarity(0.0, np.eye(3), np.zeros(3))
    with pytest.raises(ValueError, match="one rotation"):
        Similarity(1.0, np.stack([np.eye(3)] * 2), np.zeros((2, 3)))
    with pytest.raises(ValueError, match="apply"):
        TRUE.apply(np.zeros((3, 2)))


def test_moved_cameras_take_the_same_pictures():
    x, camera = cloud(), Pose(exp_so3([0.3, 0.2, -0.5]), np.array([1.0, 2.0, 40.0]))
    batch = Pose(np.stack([camera.rotation] * 2), np.stack([camera.translation, camera.translation + 1]))
    np.testing.assert_allclose(TRUE.moved(camera).apply(TRUE.apply(x)), TRUE.scale * camera.apply(x), rtol=1e-12)
    np.testing.assert_allclose(TRUE.moved(batch).translation[0], TRUE.moved(camera).translation)
