"""Near-symmetries of a set of markers, and what `prepare` makes of it."""

import numpy as np
import pytest
import registration_scenes as scenes

from windmark.registration import NotRegistered, prepare, register
from windmark.registration._kernels.symmetry import field_of
from windmark.registration.search import field
from windmark.registration.search.field import modes_of
from windmark.registration.search.layout import Layout, unit_model
from windmark.scene import MarkerSet


def grid(columns, rows, normals=True):
    xyz = np.stack(np.meshgrid(np.arange(columns) * 1.0, np.arange(rows) * 1.0, [0.0]), axis=-1).reshape(-1, 3)
    normal = np.tile([0.0, 0.0, 1.0], (len(xyz), 1)) if normals else None
    return MarkerSet.make([f"g{i}" for i in range(len(xyz))], xyz, normal=normal)


def brought(onto):
    return [int((row >= 0).sum()) for row in onto]


def assert_motions(layout, motions=None, determinant=1):
    """Every motion keeps lengths and brings the markers that it says, to within two fifths of their spacing."""
    onto, rotation, translation = motions or layout.symmetries
    xyz = layout.model.xyz
    spacing = np.linalg.norm(xyz - xyz[layout.model.near[:, 0]], axis=1)
    for row, r, t in zip(onto, rotation, translation, strict=True):
        np.testing.assert_allclose(r @ r.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(r) == pytest.approx(determinant)
        m = np.flatnonzero(row >= 0)
        assert len(set(row[m].tolist())) == len(m)
        moved = xyz[m] @ r.T + t
        assert (np.linalg.norm(moved - xyz[row[m]], axis=1) < 0.4 * spacing[m]).all()


def test_symmetries_of_a_grid():
    """Half a turn, and the shifts by one step: 6 x 4 markers less a row or a column."""
    layout = Layout(grid(6, 4))
    onto, _, _ = layout.symmetries
    assert_motions(layout)
    assert onto[0].tolist() == list(range(23, -1, -1))
    right = [i + 1 if i % 6 < 5 else -1 for i in range(24)]
    down = [i + 6 if i < 18 else -1 for i in range(24)]
    rows = onto.tolist()
    assert right in rows
    assert down in rows
    assert brought(onto) == sorted(brought(onto), reverse=True)
    assert not any((row == np.arange(24)).sum() > 12 for row in onto)


def test_quarter_turns_of_a_square_grid():
    onto, _, _ = Layout(grid(5, 5)).symmetries
    assert brought(onto)[:4] == [25, 25, 25, 20]


def test_turns_about_a_marker_far_from_the_middle_of_a_large_board():
    """Three quarter turns; `symmetries` has 200 shifts and turns that bring more markers onto others."""
    layout = Layout(grid(15, 15))
    marker = 4 * 15 + 9
    motions = layout.symmetries_with((marker, marker))
    assert_motions(layout, motions)
    number = len(layout.symmetries[0])
    turns = [row for row in motions[0][number:].tolist() if row[marker] == marker]
    right, above = marker + 1, marker - 15
    assert {(row[right], row[above]) for row in turns} == {
        (above, marker - 1), (marker - 1, marker + 15), (marker + 15, right)
    }  # fmt: skip
    assert layout.symmetries_with(None)[0] is layout.symmetries[0]
    onto = layout.symmetries_with((marker, marker + 30))[0][number:]
    assert all(row[marker] == marker + 30 for row in onto.tolist())
    assert any(row[right] == right + 30 for row in onto.tolist())


def test_a_flat_grid_without_normals_can_be_turned_over():
    with_normals, _, _ = Layout(grid(6, 4)).symmetries
    without, _, _ = Layout(grid(6, 4, normals=False)).symmetries
    assert brought(with_normals)[:2] == [24, 20]
    assert brought(without)[:4] == [24, 24, 24, 20]


def test_rows_are_nearly_symmetric_and_random_points_are_not():
    layout = Layout(scenes.scene(1, "A0").markers)
    assert_motions(layout)
    assert max(brought(layout.symmetries[0])) >= 18
    rng = np.random.default_rng(0)
    scattered = MarkerSet.make([f"m{i}" for i in range(30)], rng.normal(size=(30, 3)))
    assert len(Layout(scattered).symmetries[0]) == 0


def test_symmetries_of_many_markers():
    """Half a turn and the shortest shifts of a wall of 2,400 dots, none of which is quite in its place."""
    wall = grid(60, 40)
    wall.xyz[:] += np.random.default_rng(2).normal(0, 0.002, wall.xyz.shape)
    layout = Layout(wall)
    assert_motions(layout)
    onto, number = layout.symmetries[0], np.arange(2400)
    assert brought(onto) == sorted(brought(onto), reverse=True)
    assert onto[0].tolist() == number[::-1].tolist()
    for shift, gone in ((1, 40), (-1, 40), (60, 60), (-60, 60)):
        row = next(row for row in onto if ((row - number)[row >= 0] == shift).all())
        assert (row >= 0).sum() == 2400 - gone


def test_the_way_back_is_a_motion_too():
    """A wall whose dots are off by some percent of their distance: with every shift and turn its inverse is found.

    Of the real wall of 4,094 dots the shift by a column was found one way only, and a labelling that was shifted by
    one the other way had no rival.
    """
    wall = grid(20, 20)
    wall.xyz[:] += np.random.default_rng(2).normal(0, 0.015, wall.xyz.shape)
    onto = Layout(wall).symmetries[0]
    for there in onto[np.array(brought(onto)) > brought(onto)[-1]]:
        back = np.full(400, -1)
        back[there[there >= 0]] = np.flatnonzero(there >= 0)
        same = [2 * ((back == other) & (back >= 0)).sum() / (other >= 0).sum() for other in onto]
        assert max(same) > 0.9


def test_modes_of_some_stand_for_those_of_many_markers(monkeypatch):
    """The covariance of the displacements that they make is that of the whole process."""
    xyz = np.random.default_rng(4).uniform(-1, 1, size=(900, 3)) * [1.6, 1.2, 0.1]
    rigid = np.arange(900) % 50 == 0
    some = modes_of(field.field_of(xyz, rigid, field.REACH))
    monkeypatch.setattr(field, "LANDMARKS", 900)
    exact = modes_of(field.field_of(xyz, rigid, field.REACH))
    covariances = [np.einsum("kna,kma->nm", modes, modes) for modes in (some, exact)]
    np.testing.assert_allclose(*covariances, atol=0.005)
    assert covariances[1].max() > 1


def test_mirrors_of_a_grid():
    """Left and right exchanged, or up and down; with normals the plane's own is a choice of ours, and the first one."""
    layout = Layout(grid(6, 4))
    onto, turn, shift = layout.mirrors
    assert_motions(layout, (onto, turn, shift), -1)
    place = np.arange(24).reshape(4, 6)
    np.testing.assert_array_equal(onto[0], np.arange(24))
    np.testing.assert_allclose(turn[0], np.diag([1.0, 1.0, -1.0]), atol=1e-12)
    assert place[:, ::-1].ravel().tolist() in onto.tolist()
    assert place[::-1].ravel().tolist() in onto.tolist()


def test_mirrors_of_a_wing_with_relief_and_of_scattered_markers():
    wing = Layout(scenes.scene(1, "A").markers)
    onto, turn, shift = wing.mirrors
    np.testing.assert_array_equal(onto[0], np.arange(24))
    moved = wing.model.xyz @ turn[0].T + shift[0]
    assert 0 < np.linalg.norm(moved - wing.model.xyz, axis=1).max() < 0.3
    assert_motions(wing, (onto[1:], turn[1:], shift[1:]), -1)
    rng = np.random.default_rng(0)
    scattered = MarkerSet.make([f"m{i}" for i in range(30)], rng.normal(size=(30, 3)))
    assert max(brought(Layout(scattered).mirrors[0])) < 10  # in the plane of three of them, those that lie near it


def test_port_and_starboard_can_be_taken_for_each_other():
    layout = Layout(scenes.scene(1, "B").markers)
    onto, _, _ = layout.mirrors
    exchanged = [*range(15, 30), *range(15)]
    assert max((row[:30] == exchanged).sum() for row in onto) > 20


@pytest.mark.parametrize("count", [4, 5, 7])
def test_few_markers_can_be_prepared(count):
    layout = prepare(grid(3, 3).take(np.arange(count))).ready()
    assert layout.table(7).first[-1] > 0


def test_prepared_markers_change_nothing():
    scene = scenes.scene(31, "A", hidden=0.25, false=0.5)
    layout = prepare(scene.markers)
    plain, prepared = (register(scene.detections, scene.markers, scene.camera, layout=w) for w in (None, layout))
    np.testing.assert_array_equal(plain.cam_from_model.rotation, prepared.cam_from_model.rotation)
    np.testing.assert_array_equal(plain.matching.marker, prepared.matching.marker)
    assert plain.n_hypotheses == prepared.n_hypotheses
    with pytest.raises(ValueError, match="layout"):
        register(scene.detections, scenes.scene(32, "A").markers, scene.camera, layout=layout)


def test_the_moved_marker_of_a_grid_hidden_is_ambiguous():
    """Without the marker that breaks the symmetry, and its counterpart, half a turn explains the picture as well."""
    rng = np.random.default_rng(3)
    markers = grid(6, 4)
    markers.xyz[8, :2] += [0.3, 0.12]
    camera, pose = scenes.random_view(rng, markers)
    scene = scenes.image_of(rng, markers, camera, pose, noise_px=0.2)
    seen = register(scene.detections, markers, camera)
    assert seen
    assert scenes.pose_error_px(seen.cam_from_model, scene) < 2
    hidden = register(scene.detections.take((scene.label != 8) & (scene.label != 15)), markers, camera)
    assert isinstance(hidden, NotRegistered)
    assert hidden.cause == "ambiguous"
    assert np.degrees(hidden.best_candidate.angle_to(hidden.runner_up.cam_from_model)) > 100


def test_every_marker_is_in_its_cell():
    xyz = np.random.default_rng(6).normal(size=(200, 3)) * [1.0, 0.5, 0.0]
    field = field_of(unit_model(xyz, np.full((200, 3), np.nan))[0])
    assert sorted(field.member.tolist()) == list(range(200))
    assert 200 < np.prod(field.size) <= 4 * 200 + 8
    cell = np.repeat(np.arange(len(field.first) - 1), np.diff(field.first))
    place = np.minimum(((field.xyz[field.member] - field.low) * field.per_unit).astype(int), field.size - 1)
    np.testing.assert_array_equal(cell, np.ravel_multi_index(place.T, field.size))
