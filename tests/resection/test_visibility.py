"""Which nodes a camera sees: each reason, seams, silhouettes, orientation, sequences."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.resection import REASONS, nearest_on_surface, see_nodes, see_points
from windmark.resection.reasons import BLANKED, FACING_AWAY, HIDDEN, LENS, OBLIQUE, OUTSIDE, VISIBLE
from windmark.scene import Mesh

sys.path.insert(0, str(Path(__file__).parent))
from resection_shapes import box, brute_hidden, joined, lens_camera, looking_at, moved, plate, sphere

CAMERA = Camera((400, 300), 300.0, k1=-0.05)


def test_box_on_a_plate():
    # A tower of 0.8 x 0.8 x 1.0 on a plate, seen from the +x, +y side.
    floor, tower = plate(21, 21, size=(4.0, 4.0)), box(9, half=(0.4, 0.4, 0.5), center=(0, 0, 0.5))
    mesh, eye = joined(floor, tower), np.array([3.0, 2.0, 2.5])
    pose = looking_at(eye)
    view = see_nodes(mesh, CAMERA, pose)
    blocks = np.repeat(np.arange(6), 81)  # -x +x -y +y -z +z
    tower_reason = view.reason[len(floor.vertices) :]
    for block, want in enumerate([FACING_AWAY, VISIBLE, FACING_AWAY, VISIBLE, FACING_AWAY, VISIBLE]):
        assert (tower_reason[blocks == block] == want).all(), block
    # The floor: nodes whose line to the eye passes through the tower's inside (slabs), or that it stands on.
    nodes = floor.vertices
    step = eye - nodes
    with np.errstate(divide="ignore", invalid="ignore"):
        t0, t1 = (np.array([-0.4, -0.4, 0.0]) - nodes) / step, (np.array([0.4, 0.4, 1.0]) - nodes) / step
    enter, leave = np.minimum(t0, t1).max(axis=1), np.maximum(t0, t1).min(axis=1)
    through = leave - np.maximum(enter, 0.0)
    clear = np.abs(through) > 1e-6
    floor_reason = view.reason[: len(nodes)]
    assert clear.mean() > 0.9
    np.testing.assert_array_equal((floor_reason == HIDDEN)[clear], (through > 0)[clear])
    assert (floor_reason == HIDDEN).sum() > 10
    np.testing.assert_allclose(view.xy, CAMERA.project(pose.apply(mesh.vertices))[0], atol=1e-9)
    np.testing.assert_allclose(view.depth, pose.apply(mesh.vertices)[:, 2], atol=1e-12)
    assert view.counts["visible"] == view.visible.sum()
    assert sum(view.counts.values()) == len(view) == len(mesh.vertices)


def test_reasons_and_their_order():
    camera = Camera((60, 60), 60.0, k1=-0.25)  # the lens model ends at u = 1.15, the image at about u = 0.55

    def triangle(x, y, z, *, turned=False, tilted=False):
        corners = np.array([[-0.1, -0.1, 0], [0.1, -0.1, 0], [0, 0.1, 0]])
        if tilted:
            corners = corners[:, [0, 2, 1]] * [1, 1, 5] - [0, 0.01, 0]
        return moved(Mesh.make(corners, [[0, 1, 2] if turned else [0, 2, 1]]), x, y, z)

    parts = {
        VISIBLE: triangle(0, 0, 2), HIDDEN: triangle(0, 0, 4), OUTSIDE: triangle(1.6, 0, 2), LENS: triangle(6, 0, 2),
        FACING_AWAY: triangle(0, 0.5, 2, turned=True), OBLIQUE: triangle(0, -0.5, 2, tilted=True),
    }  # fmt: skip
    behind, alone = triangle(0, 0, -2), Mesh.make([[0.2, 0.2, 1.0]], [])
    mesh = joined(*parts.values(), behind, alone)
    view = see_nodes(mesh, camera, Pose.identity(), max_obliquity_deg=70)
    want = np.append(np.repeat([*parts, OUTSIDE], 3), BLANKED)
    np.testing.assert_array_equal(view.reason, want)
    assert np.isnan(view.obliquity_deg[-1])
    free = see_nodes(mesh, camera, Pose.identity())
    np.testing.assert_array_equal(free.reason, np.where(want == OBLIQUE, VISIBLE, want))
    # A blanked node is blanked first of all.
    marked = Mesh(mesh.vertices, mesh.triangles, mesh.volume, blanked=np.arange(len(mesh.vertices)) % 2 == 0)
    reason = see_nodes(marked, camera, Pose.identity()).reason
    np.testing.assert_array_equal(reason, np.where(marked.blanked, BLANKED, free.reason))
    assert REASONS[reason[0]] == "blanked"


@pytest.mark.parametrize("eye", [[4.0, 0.5, 1.0], [0.3, -0.2, 5.0], [-2.0, -2.0, -1.0]])
def test_globe_agrees_with_segments_to_the_camera(eye):
    mesh, pose = sphere(40), looking_at(eye, up=[0, 1, 0.1])
    view = see_nodes(mesh, CAMERA, pose, two_sided=True)
    nodes = np.arange(len(mesh.vertices))
    want = brute_hidden(mesh, pose.center, nodes, margin=1e-9)
    cosine = mesh.vertices @ pose.center - 1.0
    poles = np.linalg.norm(mesh.vertices[:, :2], axis=1) < 1e-9  # many nodes in one place: the twin cannot tell
    seam = np.isin(nodes % 41, (0, 40))
    clear = ~poles & ~seam & (np.abs(cosine) > 1e-9)
    # Lines through an edge or a node: rounding tells the twin which side it passes, so a step aside must not matter.
    for step in 1e-7 * np.array([[1.0, -2.0, 3.0], [-3.0, 1.0, 2.0], [2.0, 3.0, -1.0]]):
        clear &= brute_hidden(mesh, pose.center + step, nodes, margin=1e-9) == want
    assert clear.mean() > 0.8
    np.testing.assert_array_equal(view.reason[clear] == HIDDEN, want[clear])
    # Well within the limb everything is visible, well beyond nothing.
    assert view.visible[cosine > 0.02].all()
    assert not view.visible[cosine < -np.sin(np.radians(9.1)) * np.linalg.norm(eye)].any()  # cells are 9 degrees


def test_seam_and_poles_do_not_flicker():
    # Nodes of the seam exist twice; both must get the same answer, whichever triangle rounding prefers.
    mesh = sphere(60)
    rows = np.arange(31) * 61
    for angle in np.linspace(0, 6, 13):
        view = see_nodes(mesh, CAMERA, looking_at([3 * np.cos(angle), 3 * np.sin(angle), 1.0]), two_sided=True)
        np.testing.assert_array_equal(view.visible[rows], view.visible[rows + 60])
        assert len(np.unique(view.visible[:61])) == 1
        assert view.visible[-61:].all()


def test_nodes_on_a_flat_face_are_all_seen_at_grazing_angles():
    mesh = plate(41, 41)
    for height in (0.3, 0.03, 0.003):
        view = see_nodes(mesh, Camera((800, 200), 300.0), looking_at([6.0, 1.0, height], target=[0, 0, height]))
        assert view.visible.all()


def test_orientation_is_trusted_or_not():
    mesh, pose = box(5), looking_at([3.0, 2.5, 2.0])
    inside_out = Mesh.make(mesh.vertices, mesh.triangles[:, ::-1])
    right, wrong = see_nodes(mesh, CAMERA, pose), see_nodes(inside_out, CAMERA, pose)
    both, both_wrong = (see_nodes(m, CAMERA, pose, two_sided=True) for m in (mesh, inside_out))
    assert right.visible.sum() == 3 * 25
    # Inside out: what faces us is on the far side, behind the near one; only the far walls' outer rims show.
    assert not wrong.visible[right.visible].any()
    assert (wrong.reason[right.visible] == FACING_AWAY).all()
    np.testing.assert_array_equal(both.reason, both_wrong.reason)
    np.testing.assert_allclose(both.obliquity_deg, both_wrong.obliquity_deg)
    assert both.obliquity_deg.max() <= 90 < right.obliquity_deg.max()
    # Two-sided, a node counts as seen where its twin on a visible face is: on the rims.
    extra = both.visible & ~right.visible
    assert set(np.unique(np.abs(mesh.vertices[extra]).max(axis=1))) <= {1.0}
    assert right.visible[np.flatnonzero(right.visible)].all()
    assert both.visible[right.visible].all()


def test_open_sheet_from_below():
    mesh = plate()
    above, below = looking_at([0.5, 0.2, 4.0], up=[0, 1, 0]), looking_at([0.5, 0.2, -4.0], up=[0, 1, 0])
    assert see_nodes(mesh, CAMERA, above).visible.all()
    assert (see_nodes(mesh, CAMERA, below).reason == FACING_AWAY).all()
    assert see_nodes(mesh, CAMERA, below, two_sided=True).visible.all()


def test_obliquity_and_its_limit():
    eye = np.array([0.0, -2.0, 2.0])
    mesh, pose = plate(31, 31, size=(3.0, 3.0)), looking_at(eye)
    sight = eye - mesh.vertices
    want = np.degrees(np.arccos(sight[:, 2] / np.linalg.norm(sight, axis=1)))
    view = see_nodes(mesh, CAMERA, pose)
    np.testing.assert_allclose(view.obliquity_deg, want, atol=1e-9)
    limited = see_nodes(mesh, CAMERA, pose, max_obliquity_deg=50)
    np.testing.assert_array_equal(limited.reason == OBLIQUE, view.visible & (want > 50))
    assert (limited.reason == OBLIQUE).any()
    assert limited.visible.any()


def test_tolerance_bridges_blocks_that_do_not_match():
    # The second block lies a little below the first where they overlap.
    upper, lower = plate(11, 11), plate(11, 11)
    lower = moved(lower, 1.23, 0.17, -0.001)
    mesh, pose = joined(upper, lower), looking_at([0.5, 0, 6.0], target=[0.5, 0, 0], up=[0, 1, 0])
    assert see_nodes(mesh, CAMERA, pose).counts["hidden"] > 20
    assert see_nodes(mesh, CAMERA, pose, tolerance=0.002).counts["hidden"] == 0


def test_default_tolerance_ignores_unused_nodes():
    mesh = joined(plate(11, 11), Mesh.make([[1e30, np.nan, 0.0]], []))
    far = Mesh.make(mesh.vertices - [0, 0, 0.01], mesh.triangles)
    both = joined(mesh, far)
    blanked = ~np.isfinite(both.vertices).all(axis=1)
    both = Mesh(both.vertices, both.triangles, both.volume, blanked=blanked)
    view = see_nodes(both, CAMERA, looking_at([0.1, 0.1, 6.0], up=[0, 1, 0]))
    assert view.counts["blanked"] == 2
    assert view.reason[123:244].tolist().count(HIDDEN) > 80


def with_volumes(*meshes):
    """As `joined`, each part of its own volumes."""
    return replace(joined(*meshes), volume=np.concatenate([m.volume for m in meshes]))


@pytest.mark.parametrize("count", [1, 6])
def test_a_far_field_zone_does_not_loosen_what_hides_what(count):
    """A thin plate and the sheet 0.4 % of its size behind it, alone and inside a far field of 2,000 times its size."""
    upper, lower = plate(21, 21), moved(plate(21, 21), 0.0, 0.0, -0.004)
    model = joined(upper, lower)
    pose = looking_at([0.1, 0.1, 6.0], up=[0, 1, 0])
    alone = see_nodes(model, CAMERA, pose).reason
    assert (alone[441:] == HIDDEN).sum() > 300
    far = box(5, half=(2000.0, 2000.0, 2000.0))
    zones = [f"far{k * count // len(far.triangles)}" for k in range(len(far.triangles))]
    far = Mesh(far.vertices, far.triangles[:, ::-1], np.array(zones))
    inside, outside = with_volumes(model, far), with_volumes(far, model)
    for both, own in ((inside, slice(0, 882)), (outside, slice(len(far.vertices), None))):
        np.testing.assert_array_equal(see_nodes(both, CAMERA, pose).reason[own], alone)
        assert see_points([[0.1, 0.1, -0.004]], CAMERA, pose, mesh=both).reason[0] == HIDDEN
    assert inside.sizes[0] == pytest.approx(model.diagonal)
    assert inside.sizes[-1] == inside.diagonal
    assert inside.size == pytest.approx(model.diagonal)
    tap = nearest_on_surface(inside, [[0.1, 0.1, 0.5]], volume=None)
    assert tap.triangle[0] == -1  # half the model's size off: on no surface, however far the far field is


def test_a_far_field_of_the_same_volume_is_told_by_what_hangs_together():
    """As above, but nothing names the far field: one volume without blocks, its triangles among those of the model."""
    model = joined(plate(21, 21), moved(plate(21, 21), 0.0, 0.0, -0.004))
    far = box(5, half=(2000.0, 2000.0, 2000.0))
    both = joined(model, Mesh(far.vertices, far.triangles[:, ::-1], far.volume))
    mixed = np.random.default_rng(0).permutation(len(both.triangles))
    both = Mesh(both.vertices, both.triangles[mixed], np.full(len(mixed), "model"))
    pose = looking_at([0.1, 0.1, 6.0], up=[0, 1, 0])
    alone = see_nodes(model, CAMERA, pose).reason
    assert (alone[441:] == HIDDEN).sum() > 300
    np.testing.assert_array_equal(see_nodes(both, CAMERA, pose).reason[:882], alone)
    of_model = mixed < len(model.triangles)
    np.testing.assert_allclose(both.sizes[of_model], model.diagonal)
    assert (both.sizes[~of_model] == both.diagonal).all()
    moved_on = both.moved(2 * both.vertices)
    np.testing.assert_allclose(moved_on.sizes, 2 * both.sizes)
    np.testing.assert_allclose(moved_on.sizes, replace(both, vertices=2 * both.vertices).sizes)


def test_a_small_part_is_as_exact_as_its_coordinates():
    """A patch of a thousandth of the body, far from the origin: rounded to five digits it still hides nothing of it."""
    body = plate(21, 21, size=(2.0, 2.0))
    patch = moved(plate(5, 5, size=(2e-3, 2e-3)), 0.9, 0.9, 0.0)
    mesh = with_volumes(body, Mesh(patch.vertices, patch.triangles, np.full(len(patch.triangles), "patch")))
    assert mesh.sizes[-1] == pytest.approx(0.901)
    assert mesh.sizes[0] == mesh.diagonal


def test_a_tolerance_of_each_triangle():
    mesh, pose = box(3), looking_at([3.0, 2.5, 2.0])
    by_one = see_nodes(mesh, CAMERA, pose, tolerance=1e-3).reason
    np.testing.assert_array_equal(
        see_nodes(mesh, CAMERA, pose, tolerance=np.full(len(mesh.triangles), 1e-3)).reason, by_one
    )
    with pytest.raises(ValueError, match="one of each triangle"):
        see_nodes(mesh, CAMERA, pose, tolerance=np.zeros(3))


def test_nodes_crowded_in_a_corner(rng):
    # Most nodes in a millionth of the picture: the grid of rays has to adapt, and the answer must not change.
    fine = sphere(100, radius=2e-3, center=(0.4, 0.3, 0.3))
    mesh, pose = joined(box(4, half=(0.2, 0.2, 0.2)), fine, plate(5, 5)), looking_at([2.0, 2.5, 3.0])
    view = see_nodes(mesh, CAMERA, pose, two_sided=True, tolerance=1e-9)
    some = rng.choice(len(mesh.vertices), 400, replace=False)
    _, twins = np.unique(mesh.vertices.round(9), axis=0, return_inverse=True)
    some = some[np.bincount(twins)[twins[some]] == 1]  # of nodes in one place the segment test cannot tell
    want = brute_hidden(mesh, pose.center, some, margin=1e-9)
    np.testing.assert_array_equal(view.reason[some] == HIDDEN, want)
    assert 0.2 < want.mean() < 0.8


def test_follow_moves_the_nodes_and_keeps_what_hides_them():
    mesh, pose = box(9), looking_at([3.0, 2.5, 2.0])
    view = see_nodes(mesh, CAMERA, pose)
    turned = Pose.exp([0.01, -0.02, 0.03, 0.02, 0.01, -0.02]) @ pose
    moved = mesh.vertices * 1.01
    got = view.follow(CAMERA, turned, moved)
    np.testing.assert_allclose(got.xy, CAMERA.project(turned.apply(moved))[0], atol=1e-9)
    np.testing.assert_array_equal(got.visible, view.visible)
    away = view.follow(CAMERA, Pose.exp([0, 0.6, 0, 0, 0, 0]) @ pose, mesh.vertices)
    assert (away.reason[view.visible] == OUTSIDE).any()
    np.testing.assert_array_equal(away.reason[~view.visible], view.reason[~view.visible])
    # Back again: nothing is lost for good.
    np.testing.assert_array_equal(away.follow(CAMERA, pose, mesh.vertices).reason, view.reason)
    with pytest.raises(ValueError, match="xyz"):
        view.follow(CAMERA, pose, mesh.vertices[1:])


def test_points():
    mesh, pose = sphere(60), looking_at([4.0, 0, 0])
    points = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, 0, 10.0], [np.nan, 0, 0], [-3.0, 0, 0]])
    view = see_points(points, CAMERA, pose, mesh=mesh)
    assert view.reason.tolist() == [VISIBLE, HIDDEN, OUTSIDE, OUTSIDE, HIDDEN]
    assert see_points(points, CAMERA, pose).reason.tolist() == [VISIBLE, VISIBLE, OUTSIDE, OUTSIDE, VISIBLE]
    # A tap a little below the facets of the polygon: the tolerance says how far.
    tap = np.array([[0.99, 0.02, 0.03]])
    assert see_points(tap, CAMERA, pose, mesh=mesh).reason[0] == HIDDEN
    assert see_points(tap, CAMERA, pose, mesh=mesh, tolerance=0.02).reason[0] == VISIBLE


def test_no_nodes_and_no_triangles():
    view = see_nodes(Mesh.make(np.zeros((0, 3)), []), lens_camera(), Pose.identity())
    assert len(view) == 0
    view = see_nodes(Mesh.make(np.ones((4, 3)), []), lens_camera(), Pose.identity())
    assert (view.reason == BLANKED).all()


@pytest.mark.parametrize(
    ("options", "word"),
    [({"max_obliquity_deg": 0}, "max_obliquity_deg"), ({"max_obliquity_deg": 200.0}, "max_obliquity_deg"),
     ({"tolerance": -1.0}, "tolerance"), ({"tolerance": np.nan}, "tolerance")],
)  # fmt: skip
def test_wrong_options(options, word):
    with pytest.raises(ValueError, match=word):
        see_nodes(plate(), lens_camera(), Pose.identity(), **options)


def test_wrong_arguments():
    batch = Pose(np.stack([np.eye(3)] * 2), np.zeros((2, 3)))
    with pytest.raises(ValueError, match="single Pose"):
        see_nodes(plate(), lens_camera(), batch)
    with pytest.raises(ValueError, match="xyz"):
        see_points(np.zeros(3), lens_camera(), Pose.identity())
