"""What hides a point: the tree of boxes against rays at every triangle."""

import numpy as np
import pytest

import windmark as wm
from windmark.resection import REASONS, see_points
from windmark.scene.triangle_tree import TriangleTree
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
