"""What a bow that the picture does not show would do to the pose, and that it is said; and what of a second copy."""

from __future__ import annotations

from dataclasses import replace

import bent_scenes
import numpy as np
import pytest
import registration_scenes as scenes
import settle_scenes as settling

from windmark.registration import register
from windmark.registration.judge.first_order import PRIOR, look_at
from windmark.registration.judge.unseen import least_copy, unchecked_bend, unchecked_copy
from windmark.registration.search.field import STIFF
from windmark.registration.settle._kernels.doubt import doubt_kernel
from windmark.registration.settle._kernels.slopes import slopes_kernel
from windmark.registration.settle._kernels.unseen import _motions
from windmark.registration.settle.settling import opened
from windmark.registration.settle.solution import beyond_rigid
from windmark.scene import MarkerSet

MARGIN = 10.0


def unseen_bend(best, most, margin):
    """Largest bow and largest turn of a root that do not show."""
    look = look_at(best, PRIOR * most * best.views.layout.size, margin)
    return look.bow, look.turn


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
    assert unchecked_bend(look_at(settling.best_of(image)[1], 0.0, MARGIN)) == []


def test_a_bow_is_no_larger_than_allowed():
    image = scenes.scene(7, "A")
    _, best = settling.best_of(image)
    bow, turn = unseen_bend(best, 0.05, MARGIN)
    assert 0 < bow < 0.05
    assert turn > 0.01
    least, less = unseen_bend(best, 0.0005, MARGIN)
    assert least <= 0.0005
    assert less < 0.5 * turn


@pytest.mark.parametrize("kind", ["A", "B"])
def test_a_copy_of_as_many_markers_as_are_named_is_evidence_and_one_of_less_is_not(kind):
    """Neighbours of one marker, as the edge of what hides leaves them."""
    image = scenes.scene(11, kind, noise_px=0.2)
    views, best = settling.best_of(image)
    least = least_copy(best, 0, MARGIN)
    assert 5 < least < 16
    match, near = best.state.match[0], views.layout.model.near
    middle = int(best.pairs()[1][0])
    some = [m for m in (middle, *near[middle]) if match[m] >= 0]
    worth = []
    for count in (least - 2, least + 2):
        alone = np.full_like(best.state.match, -1)
        alone[0, some[:count]] = match[some[:count]]
        taken = np.isin(np.arange(len(image.detections)), alone[0], invert=True)
        copy = settling.settle(views.without([taken]), best.state.rotation, best.state.translation, alone)
        worth.append(copy.evidence if copy is not None else -np.inf)
    assert worth[0] < MARGIN < worth[1]


def test_copies_are_named_where_enough_spots_are_left_for_one_and_no_label_says_which():
    alone, among = (scenes.scene(7, "A", false=false) for false in (0.0, 0.5))
    left = len(among.detections) - settling.best_of(among)[1].count
    (said,) = unchecked_copy(settling.best_of(among)[1], 0.0, MARGIN)
    assert f"among the {left} spots" in said.words
    assert unchecked_copy(settling.best_of(alone)[1], 0.0, MARGIN) == []
    (over,) = unchecked_copy(settling.best_of(alone)[1], 1.0, MARGIN)
    assert "max_time_s" in over.words
    spot = int(np.flatnonzero(among.label >= 0)[0])
    found = register(among.detections, among.markers, among.camera, fixed={spot: int(among.label[spot])})
    assert "copy" not in [u.what for u in found.unchecked]


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


def test_the_kernel_says_what_least_squares_do():
    """By LAPACK, from the normal equations of a model that may bend."""
    for kind in "AC":
        views, best = settling.best_of(scenes.scene(8, kind, hidden=0.3))
        layout, matched = views.layout, np.asarray((best.state.match >= 0).any(axis=0))
        amplitude = PRIOR * 0.05 * layout.size * layout.far_field.amplitude(STIFF)
        modes = amplitude[:, None, None] * layout.far_field.modes
        bent = views.bent(modes)
        normal = doubt_kernel(bent.sights, opened(bent, best.state))[0] + np.diag(np.arange(6 + len(modes)) >= 6)
        taken = np.linalg.solve(normal[:6, :6], normal[:6, 6:])
        open_ = np.linalg.inv(np.linalg.cholesky(normal[6:, 6:] - normal[6:, :6] @ taken)).T
        turns = (best.state.rotation @ (amplitude * layout.far_field.motions[matched, :3]) - taken[:3]) @ open_
        _, sigma, way = np.linalg.svd(turns[(turns**2).sum(axis=(1, 2)).argmax()], full_matrices=False)
        rest = beyond_rigid(layout.model.xyz[matched], modes[:, matched]) / layout.size
        rest = np.sqrt(2 * MARGIN) * np.tensordot(open_.T, rest, 1)
        own = np.linalg.norm(np.tensordot(way[0], rest, 1), axis=1).max()
        turn = min(0.05 / own, 1.0) * np.sqrt(2 * MARGIN) * sigma[0]
        bow = min(np.sqrt((rest**2).sum(axis=(0, 2)).max()), 0.05)
        np.testing.assert_allclose(unseen_bend(best, 0.05, MARGIN), (bow, turn), rtol=1e-8)


@pytest.mark.slow
def test_slopes_make_the_normal_equations():
    views, best = settling.best_of(scenes.scene(9, "B", hidden=0.3))
    bent = views.bent(0.3 * views.layout.modes)
    normal, side = doubt_kernel(bent.sights, opened(bent, best.state))
    slopes, off = slopes_kernel(views.sights, best.state, views.layout.modes_of_each, 0.3)
    np.testing.assert_allclose(slopes.T @ slopes, normal, atol=1e-9 * np.abs(normal).max())
    np.testing.assert_allclose(slopes.T @ off, side, atol=1e-9 * np.abs(side).max() + 1e-9)


def test_a_row_of_markers_has_five_motions():
    """Beside its own axis it cannot be turned: what bends it is no motion, and nothing divides by nothing."""
    xyz, seen = np.outer(np.linspace(-1, 1, 7), [1.0, 0.0, 0.0]), np.ones(7, dtype=bool)
    basis = _motions(xyz, seen, 7, np.zeros(3))
    np.testing.assert_allclose(basis @ basis.T, np.diag([0.0, 1, 1, 1, 1, 1]), atol=1e-12)


def test_a_marker_that_the_table_has_twice_is_named():
    """One of its names is taken, by chance; markers back to back are two."""
    scene = scenes.scene(3, "A")
    markers = scene.markers
    a = int(register(scene.detections, markers, scene.camera).matching.marker[4])
    for turned, told in ((1.0, True), (-1.0, False)):
        again = markers.take([a])
        again = replace(again, name=np.array(["again"]), normal=turned * again.normal)
        twice = MarkerSet.make(
            [*markers.name, "again"], np.concatenate([markers.xyz, again.xyz]),
            normal=np.concatenate([markers.normal, again.normal]),
        )  # fmt: skip
        found = register(scene.detections, twice, scene.camera)
        words = [u.words for u in found.unchecked if u.what == "twice"]
        assert bool(words) == told
        assert all(f"{markers.name[a]} and again" in w for w in words)
