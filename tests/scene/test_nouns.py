"""The nouns check their shapes and say what is wrong; they hold columns and nothing else."""

import numpy as np
import pytest

from windmark.scene import (
    Block,
    Detections,
    MarkerSet,
    Matching,
    Mesh,
    Observations,
    Tracks,
    structured_triangles,
)
from windmark.scene.detections import middle_sigma


def test_markers_fill_what_is_unknown_and_make_normals_unit():
    markers = MarkerSet.make(["a", "b"], [[0, 0, 0], [1, 2, 3]], normal=[[0, 0, 2], [0, 0, 0]], radius=2.5)
    np.testing.assert_array_equal(markers.normal[0], [0, 0, 1])
    assert np.isnan(markers.normal[1]).all()  # a zero normal is no normal
    np.testing.assert_array_equal(markers.radius, 2.5)
    assert np.isnan(markers.sigma).all()
    assert markers.role.tolist() == ["model", "model"]


def test_markers_take_and_role():
    markers = MarkerSet.make(["a", "b", "c"], np.eye(3), role=["model", "wall", "model"])
    assert markers.with_role("model").name.tolist() == ["a", "c"]
    assert markers.take([2, 0]).name.tolist() == ["c", "a"]
    assert len(markers.take([])) == 0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"name": ["a", "a"]}, "unique.*a"),
        ({"xyz": [[0, 0, np.nan], [0, 0, 0]]}, "finite.*a"),
        ({"xyz": [[0, 0, 0]]}, r"xyz must be \(2, 3\)"),
        ({"role": "roof"}, "role.*roof"),
    ],
)
def test_wrong_markers_are_named(options, words):
    good = {"name": ["a", "b"], "xyz": np.zeros((2, 3))}
    with pytest.raises(ValueError, match=words):
        MarkerSet.make(**(good | options))


def test_detections_repeat_scalars_and_check_shapes():
    spots = Detections.make([[1, 2], [3, 4]], sigma_px=[0.1, 0.2], merit=0.3, radius_px=3)
    np.testing.assert_allclose(spots.cov[1], 0.04 * np.eye(2))
    assert spots.take([1]).xy.tolist() == [[3, 4]]
    assert len(Detections.make(np.empty((0, 2)))) == 0
    with pytest.raises(ValueError, match="finite"):
        Detections.make([[np.inf, 0]])
    with pytest.raises(ValueError, match="cov must be"):
        Detections(**{**vars(spots), "cov": np.zeros((1, 2, 2))})


def test_the_middle_sigma_is_that_of_one_coordinate():
    cov = np.array([np.diag([0.04, 0.12]), 0.01 * np.eye(2), np.eye(2)])
    assert middle_sigma(cov) == pytest.approx(np.sqrt(0.08))
    assert np.isnan(middle_sigma(cov[:0]))


def test_spots_say_how_many_are_flagged():
    assert "flagged=2" in repr(Detections.make(np.ones((5, 2)), flags=[0, 1, 0, 0, 6]))


def test_a_matching_is_one_to_one():
    assert len(Matching(np.array([0, 2]), np.array([1, 0]), np.zeros(2))) == 2
    with pytest.raises(ValueError, match="only once"):
        Matching(np.array([0, 0]), np.array([1, 2]), np.zeros(2))
    with pytest.raises(ValueError, match="same length"):
        Matching(np.array([0]), np.array([1, 2]), np.zeros(2))


def test_structured_triangles_cover_each_cell_twice_and_turn_as_asked():
    ni, nj = 4, 3
    x, y = np.meshgrid(np.arange(ni), np.arange(nj), indexing="xy")
    vertices = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1).astype(float)
    for reverse, sign in ((False, 1.0), (True, -1.0)):
        mesh = Mesh.make(vertices, structured_triangles(ni, nj, reverse=reverse))
        normals = mesh.triangle_normals()
        assert len(normals) == 2 * (ni - 1) * (nj - 1)
        np.testing.assert_array_equal(normals, np.tile([0, 0, sign], (len(normals), 1)))
        np.testing.assert_allclose(mesh.vertex_normals(), np.tile([0, 0, sign], (ni * nj, 1)))


def test_mesh_knows_unused_nodes_and_its_size():
    mesh = Mesh.make([[0, 0, 0], [3, 0, 0], [0, 4, 0], [9, 9, 9]], [[0, 1, 2]])
    assert np.isnan(mesh.vertex_normals()[3]).all()
    assert Block("b", (5, 1, 7), 0).size == 35
    assert Mesh.make(np.empty((0, 3)), np.empty((0, 3), int)).diagonal == 0
    with pytest.raises(ValueError, match="index"):
        Mesh.make(np.zeros((2, 3)), [[0, 1, 2]])
    with pytest.raises(ValueError, match="blanked"):
        Mesh(mesh.vertices, mesh.triangles, mesh.volume, (), np.zeros(2, bool))


def test_observations_and_tracks():
    one = np.array([0, 0])
    Observations(one, np.array([0, 1]), np.zeros((2, 2)), np.zeros((2, 2, 2)))
    with pytest.raises(ValueError, match="finite"):
        Observations(one, one, np.full((2, 2), np.nan), np.zeros((2, 2, 2)))
    with pytest.raises(ValueError, match="cov must be"):
        Observations(one, one, np.zeros((2, 2)), np.zeros((2, 2)))
    Tracks(np.array([0, 1]), one, np.array([0, 1]))
    with pytest.raises(ValueError, match="one track only"):
        Tracks(np.array([0, 1]), one, np.array([3, 3]))


def test_pieces_are_what_hangs_together_by_common_places_also_when_moved():
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    quad = np.array([[0, 1, 2], [0, 2, 3]])
    xyz = np.concatenate([corners, corners + np.array([1, 0, 0]), corners + np.array([0.5, 0.5, 3.0])])
    mesh = Mesh.make(xyz, np.concatenate([quad, quad + 4, quad + 8]))
    assert mesh.pieces[:4].tolist() == [mesh.pieces[0]] * 4
    assert mesh.pieces[4] == mesh.pieces[5] != mesh.pieces[0]
    # Bent apart it is still one piece: what hangs together is the grid at rest's.
    bent = mesh.moved(xyz + np.arange(12)[:, None])
    assert bent.moved(2 * xyz).pieces.tolist() == bent.pieces.tolist() == mesh.pieces.tolist()
    assert len(Mesh.make(np.zeros((0, 3)), np.zeros((0, 3), int)).pieces) == 0


@pytest.mark.parametrize(
    ("given", "want"),
    [(0.1, [0.1] * 3), ([1, 2, 3.0], [1, 2, 3.0]), ([1, 2, 3, 4.0], [4.0] * 3), ([[4], [0], [0], [4.0]], [4.0] * 3)],
)
def test_one_sigma_for_all_per_axis_or_per_marker(given, want):
    assert MarkerSet.make(list("abcd"), np.zeros((4, 3)), sigma=given).sigma[3].tolist() == want


def test_three_numbers_for_three_markers_may_be_either_and_are_refused():
    with pytest.raises(ValueError, match=r"sigma of three markers must be \(3, 1\)"):
        MarkerSet.make(list("abc"), np.zeros((3, 3)), sigma=[0.1, 0.2, 0.3])
    assert MarkerSet.make(list("abc"), np.zeros((3, 3)), sigma=[0.1, 0.1, 0.1]).sigma.tolist() == [[0.1] * 3] * 3


@pytest.mark.parametrize("column", ["sigma", "radius", "normal"])
def test_a_column_of_another_length_is_named(column):
    with pytest.raises(ValueError, match=f"{column} must be .* for 4 names, got"):
        MarkerSet.make(list("abcd"), np.zeros((4, 3)), **{column: np.ones((5, 3))})


def test_places_are_not_cut_anew():
    with pytest.raises(ValueError, match=r"xyz must be \(3, 3\) for 3 names, got \(3, 2\)"):
        MarkerSet.make(list("abc"), np.zeros((3, 2)))
    with pytest.raises(ValueError, match=r"xyz must be \(2, 3\) for 2 names, got \(3, 2\)"):
        MarkerSet.make(list("ab"), np.zeros((3, 2)))


def test_spots_from_centres_alone_have_no_flags_and_nothing_else_that_was_not_said():
    spots = Detections.make([[1, 2], [3, 4]])
    np.testing.assert_array_equal(spots.flags, 0)
    np.testing.assert_allclose(spots.cov, np.tile(0.1**2 * np.eye(2), (2, 1, 1)))
    for name in ("merit", "radius_px", "axes_px", "angle", "depth"):
        assert np.isnan(getattr(spots, name)).all()
