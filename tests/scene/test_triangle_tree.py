"""What hides a point: the tree of boxes against rays at every triangle."""

import numpy as np
import pytest

import windmark as wm
from windmark.resection import REASONS, see_points
from windmark.scene.triangle_tree import LEAF, TriangleTree
from windmark.tasks.sight import UNDER_GRID, sight


def bumpy(rng, side=40):
    """A surface with hills, in two volumes, and a plate that stands before a part of it."""
    x, y = np.meshgrid(np.linspace(-1, 1, side), np.linspace(-1, 1, side))
    z = 0.3 * np.sin(3 * x + rng.uniform(0, 6)) * np.cos(4 * y) + 0.01 * rng.standard_normal(x.shape)
    k = np.arange(side * side).reshape(side, side)
    a, b, c, d = k[:-1, :-1].ravel(), k[:-1, 1:].ravel(), k[1:, 1:].ravel(), k[1:, :-1].ravel()
    floor = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    plate = np.array([[-0.5, -0.5, 0.9], [0.1, -0.5, 0.8], [0.1, 0.2, 0.9]])
    vertices = np.concatenate([np.stack([x, y, z], -1).reshape(-1, 3), plate])
    names = np.array(["floor"] * len(floor) + ["plate"])
    return wm.Mesh.make(vertices, np.concatenate([floor, [[side * side, side * side + 1, side * side + 2]]]), names)


@pytest.mark.parametrize("seed", range(3))
def test_markers_are_hidden_as_rays_at_all_triangles_say(seed):
    rng = np.random.default_rng(seed)
    mesh = bumpy(rng)
    xyz = np.column_stack([rng.uniform(-1, 1, (300, 2)), rng.uniform(-0.3, 0.5, 300)])
    markers = wm.MarkerSet.make([f"m{k}" for k in range(300)], xyz)
    camera, visible, hidden = wm.Camera((640, 480), 700.0, 1.0, 319.5, 239.5), sight(markers, mesh), 0
    for _ in range(12):
        eye = [*rng.uniform(-2.5, 2.5, 2), rng.uniform(0.6, 3.0)]
        pose = wm.Pose.look_at(eye, [0.0, 0.0, 0.0], [0.0, 1.0, 0.2])
        seen = see_points(xyz, camera, pose, mesh=mesh, tolerance=UNDER_GRID * mesh.sizes)
        expected = seen.reason != REASONS.index("hidden")
        np.testing.assert_array_equal(visible(pose, camera), expected)
        hidden += int((~expected).sum())
    assert hidden > 300


def test_a_grid_without_triangles_hides_nothing():
    mesh = wm.Mesh.make(np.zeros((4, 3)), np.zeros((0, 3)))
    markers = wm.MarkerSet.make(["a"], [[0.0, 0.0, 1.0]])
    camera = wm.Camera((640, 480), 700.0, 1.0, 319.5, 239.5)
    assert sight(markers, mesh)(wm.Pose.look_at([0, 0, 5.0], [0, 0, 0], [0, 1.0, 0]), camera).all()


def test_every_triangle_is_in_one_leaf():
    mesh = bumpy(np.random.default_rng(9), side=7)
    tree = TriangleTree.of(mesh)
    assert sorted(tree.order.tolist()) == list(range(len(mesh.triangles)))
    low, high = tree.corners.reshape(-1, 3, 3).min(axis=1), tree.corners.reshape(-1, 3, 3).max(axis=1)
    np.testing.assert_array_equal(tree.boxes[0], [*low.min(axis=0), *high.max(axis=0)])


@pytest.mark.parametrize("flat", [False, True])
def test_boxes_hold_what_is_below_them_and_nothing_more(flat):
    mesh = bumpy(np.random.default_rng(5), side=9)
    if flat:  # a wall across an axis: its boxes are as thick as nothing
        mesh = mesh.moved(np.roll(mesh.vertices * [1.0, 1.0, 0.0], 1, axis=1))
    tree = TriangleTree.of(mesh)
    count = len(mesh.triangles)
    assert len(tree.boxes) == 2 * tree.leaves - 1
    assert tree.leaves / 2 < -(-count // LEAF) <= tree.leaves
    np.testing.assert_array_equal(tree.corners.reshape(-1, 3, 3), mesh.vertices[mesh.triangles][tree.order])
    depth = tree.leaves.bit_length() - 1
    for node in range(len(tree.boxes)):
        level = (node + 1).bit_length() - 1
        width = LEAF << (depth - level)
        first = (node + 1 - (1 << level)) * width
        inside = tree.corners[first : first + width].reshape(-1, 3)
        if len(inside):
            np.testing.assert_array_equal(tree.boxes[node], [*inside.min(axis=0), *inside.max(axis=0)])
        else:
            assert np.isinf(tree.boxes[node]).all()


def test_neighbours_along_the_curve_share_their_cells():
    """What defines a Morton curve: all that is in one cell of 2, 4, 8, ... divisions follows each other."""
    rng = np.random.default_rng(8)
    middle = rng.uniform(-1, 1, (4000, 3)) * [3.0, 1.0, 0.2]
    middle[2000:] = middle[:2000] + 1e-3 * rng.normal(size=(2000, 3))
    corner = middle[:, None] + 1e-6 * np.array([[1, 0, 0], [-1, 1, 0], [0, -1, 0]])
    tree = TriangleTree.of(wm.Mesh.make(corner.reshape(-1, 3), np.arange(12000).reshape(-1, 3)))
    low, high = middle.min(axis=0), middle.max(axis=0)
    for level in range(1, 11):
        cell = np.minimum(((middle - low) / (high - low) * 2**level).astype(int), 2**level - 1)
        number = (cell @ [1, 2**level, 4**level])[tree.order]
        assert (np.diff(number) != 0).sum() + 1 == len(set(number.tolist())), level


@pytest.mark.parametrize(("count", "leaves"), [(1, 1), (LEAF, 1), (LEAF + 1, 2), (2 * LEAF + 1, 4), (4 * LEAF, 4)])
def test_few_triangles_one_over_the_other(count, leaves):
    """All have the same middle but in z; the eye above sees the topmost alone."""
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    xyz = np.concatenate([corners + np.array([0, 0, k]) for k in range(count)])
    tree = TriangleTree.of(wm.Mesh.make(xyz, np.arange(3 * count).reshape(-1, 3)))
    assert tree.leaves == leaves
    eye, least = np.array([0.2, 0.2, 100.0]), np.full(count, 1e-9)
    points = np.array([[0.2, 0.2, k + d] for k in range(count) for d in (-0.5, 0.5)])
    np.testing.assert_array_equal(tree.hides(eye, points, least), [d < count - 1 for d in points[:, 2]])
    assert not tree.hides(eye, np.array([[-0.5, 0.2, -1.0]]), least).any()
