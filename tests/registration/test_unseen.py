"""What a bow that the picture does not show would do to the pose, and that it is said."""

from __future__ import annotations

import bent_scenes
import numpy as np
import registration_scenes as scenes
import settle_scenes as settling

from windmark.registration import register
from windmark.registration.judge.unseen import unchecked_bend, unseen_bend
from windmark.registration.settle.solution import beyond_rigid

MARGIN = 10.0


def test_a_flat_wing_alone_is_turned_no_farther_than_is_said():
    """Bent by up to 2 % of its span and accepted as straight: tens of its sigmas from where its root is."""
    off = 0
    for n in range(20):
        bend = bent_scenes.Bend((0.005, 0.01, 0.02)[n % 3], bent_scenes.SHAPES[n % 2])
        image, _ = bent_scenes.scene(19_190_000 + n, "A", bend)
        found = register(image.detections, image.markers, image.camera)
        if not found or found.deformation is not None:
            continue
        turn = found.cam_from_model.angle_to(image.cam_from_model)
        off += bool(np.mean(scenes.whitened_error(found, image) ** 2) > 5)
        _, best = settling.best_of(image)
        assert "bending" in [u.what for u in found.unchecked]
        assert turn < unseen_bend(best, 0.05, MARGIN)[1]
    assert off >= 8


def test_nothing_is_said_of_a_stiff_model():
    image = scenes.scene(7, "A")
    for most, said in ((0.05, True), (0.0, False)):
        found = register(image.detections, image.markers, image.camera, max_deformation=most)
        assert ("bending" in [u.what for u in found.unchecked]) == said
    assert unchecked_bend(settling.best_of(image)[1], 0.0, MARGIN) == []


def test_a_bow_is_no_larger_than_allowed():
    image = scenes.scene(7, "A")
    _, best = settling.best_of(image)
    bow, turn = unseen_bend(best, 0.05, MARGIN)
    assert 0 < bow < 0.05
    assert turn > 0.01
    least, less = unseen_bend(best, 0.0005, MARGIN)
    assert least <= 0.0005
    assert less < 0.5 * turn


def test_a_rigid_motion_is_no_bow():
    xyz = np.random.default_rng(2).normal(size=(9, 3))
    moved = np.array([1.0, 2.0, 3.0]) + np.cross([0.1, -0.2, 0.3], xyz)
    np.testing.assert_allclose(beyond_rigid(xyz, np.stack([moved, 2 * moved])), 0.0, atol=1e-12)
    bow = np.zeros((9, 3))
    bow[:, 2] = xyz[:, 0] ** 2
    rest = beyond_rigid(xyz, bow)
    assert np.abs(rest).max() > 0.1
    np.testing.assert_allclose(beyond_rigid(xyz, rest), rest, atol=1e-12)
    line = np.outer(np.arange(5.0), [1.0, 0.0, 0.0])
    np.testing.assert_allclose(beyond_rigid(line, np.cross([0, 0, 0.1], line)), 0.0, atol=1e-12)
