"""The curvature of grids of known surfaces."""

import numpy as np
import pytest

from windmark.errors import UsageError
from windmark.geometry import surface_curvature

RADIUS = 50.0


def sheet(u, v, place):
    """(V, 3) nodes of `place` over a grid of parameters, and its triangles."""
    columns = len(v)
    nodes = place(*np.meshgrid(u, v, indexing="ij")).reshape(-1, 3)
    k = (columns * np.arange(len(u) - 1)[:, None] + np.arange(columns - 1)).ravel()
    halves = np.stack([k, k + columns, k + 1], axis=1), np.stack([k + 1, k + columns, k + columns + 1], axis=1)
    return nodes, np.concatenate(halves).astype(np.int32)


def tube(step_deg=2.0, along=2.0, rough=0.0):
    """Half a cylinder along y."""
    rng = np.random.default_rng(1)

    def place(t, y):
        nodes = np.stack([RADIUS * np.cos(t), y, RADIUS * np.sin(t)], axis=-1)
        return nodes + rough * rng.normal(size=nodes.shape)

    return sheet(np.radians(np.arange(0, 180.1, step_deg)), np.arange(0, 200.1, along), place)


def on_tube(count=8):
    rng = np.random.default_rng(2)
    t = np.radians(rng.uniform(40, 140, count))
    normal = np.column_stack([np.cos(t), 0 * t, np.sin(t)])
    return RADIUS * normal + np.outer(rng.uniform(20, 180, count), [0, 1, 0]), normal


@pytest.mark.parametrize(("step_deg", "along", "most"), [(2, 2, 0.01), (0.5, 20, 0.01), (10, 5, 0.05), (10, 200, 0.3)])
@pytest.mark.parametrize("inside_out", [False, True])
def test_cylinder(step_deg, along, most, inside_out):
    """Also where cells are forty times as long as they are wide, so that the nearest nodes are in one line, or large as
    the markers' distance from each other, and where the grid's triangles are clockwise.
    """
    nodes, triangles = tube(step_deg, along)
    xyz, normal = on_tube()
    triangles = triangles[:, ::-1] if inside_out else triangles
    form = surface_curvature(nodes, triangles, xyz, normal, np.full(len(xyz), 3.0))
    around = np.cross(normal, [0.0, 1, 0])
    np.testing.assert_allclose(RADIUS * np.einsum("ki,kij,kj->k", around, form, around), 1, atol=most)
    np.testing.assert_allclose(RADIUS * (form @ [0.0, 1, 0]), 0, atol=0.01)
    np.testing.assert_allclose(np.einsum("kij,kj->ki", form, normal), 0, atol=1e-9)


def test_saddle_has_two_signs():
    nodes, triangles = sheet(
        np.linspace(-20, 20, 41), np.linspace(-20, 20, 41), lambda x, y: np.stack([x, y, (x * x - y * y) / 80], axis=-1)
    )
    form = surface_curvature(nodes, triangles, [[0, 0, 0.0]], [[0, 0, 1.0]], [2.0])[0]
    np.testing.assert_allclose(form, np.diag([-1 / 40, 1 / 40, 0]), atol=1e-6)


def test_the_other_side_of_a_thin_edge_says_nothing():
    """Two sheets half a marker apart, the lower one curved the other way."""
    x, y = np.linspace(-20, 20, 41), np.linspace(-20, 20, 41)
    above, triangles = sheet(x, y, lambda x, y: np.stack([x, y, -x * x / 100], axis=-1))
    below, more = sheet(x, y, lambda x, y: np.stack([x, y, x * x / 50 - 1.0], axis=-1))
    nodes, triangles = np.concatenate([above, below]), np.concatenate([triangles, more[:, ::-1] + len(above)])
    form = surface_curvature(nodes, triangles, [[0, 0, 0.0]], [[0, 0, 1.0]], [2.0])[0]
    np.testing.assert_allclose(form, np.diag([1 / 50, 0, 0]), atol=1e-5)


def test_what_is_not_told_is_flat():
    """A plane, a crease, a rough grid; no normal, no radius, no surface there, no grid."""
    xyz, normal = on_tube(1)
    crease = sheet(
        np.linspace(-20, 20, 41), np.linspace(-20, 20, 41), lambda x, y: np.stack([x, y, -0.3 * abs(x)], axis=-1)
    )
    plane = sheet(np.linspace(-20, 20, 41), np.linspace(-20, 20, 41), lambda x, y: np.stack([x, y, 0 * x], axis=-1))
    top = [[0.0, 0, 0]], [[0.0, 0, 1]]
    for grid, (place, up), radius in (
        (plane, top, 2.0), (crease, top, 2.0), (tube(rough=0.2), (xyz, normal), 3.0),
        (tube(), (xyz, normal * np.nan), 3.0), (tube(), (xyz, normal), np.nan), (tube(), (1.2 * xyz, normal), 3.0),
        ((np.zeros((0, 3)), np.zeros((0, 3), np.int32)), top, 3.0),
    ):  # fmt: skip
        form = surface_curvature(*grid, place, up, [radius])
        np.testing.assert_allclose(form, 0, atol=1e-9)


def test_nodes_that_are_nowhere_tell_nothing():
    """Of a grid with holes: those beside one are left out, too, the others count."""
    nodes, triangles = tube()
    xyz, normal = on_tube()
    far = np.argmax(np.linalg.norm(nodes - xyz[0], axis=1))
    near = np.argmin(np.linalg.norm(nodes - xyz[0], axis=1))
    whole = surface_curvature(nodes, triangles, xyz, normal, np.full(len(xyz), 3.0))
    nodes[[far, near]] = np.nan
    form = surface_curvature(nodes, triangles, xyz, normal, np.full(len(xyz), 3.0))
    assert np.isfinite(form).all()
    np.testing.assert_array_equal(form[1:], whole[1:])


def test_a_grid_of_a_marker_s_own_size_turns_too_much():
    nodes, triangles = tube()
    xyz, normal = on_tube(1)
    assert not surface_curvature(nodes / 25, triangles, xyz / 25, normal, [3.0]).any()


def test_wrong_shapes():
    with pytest.raises(UsageError, match="normal"):
        surface_curvature(*tube(), [[0, 0, 0.0]], [0, 0, 1.0], [2.0])
