"""Nodes far from all their neighbours are named; tips, fans, stretched cells and soups of triangles have none."""

import numpy as np
import pytest

from windmark import synth
from windmark.pipeline.verdict.grid import grid_findings
from windmark.scene import MarkerSet, Mesh, structured_triangles
from windmark.scene.lone_nodes import lone_nodes, where
from windmark.scene.mesh import Block


def zone(n=20, m=16, stretch=1.0):
    """A half cylinder as one structured zone whose cells grow along it by so much each."""
    x = np.cumsum(stretch ** np.arange(n)) - 1.0
    at = np.linspace(0, np.pi, m)
    xyz = np.stack([np.tile(x, m), 4 * np.repeat(np.cos(at), n), 4 * np.repeat(np.sin(at), n)], axis=1)
    t = structured_triangles(n, m)
    return Mesh(xyz, t, np.full(len(t), "zone01"), (Block("zone01", (n, m, 1), 0),))


def soup(mesh):
    """Every triangle with corners of its own."""
    return Mesh.make(mesh.vertices[mesh.triangles].reshape(-1, 3), np.arange(3 * len(mesh.triangles)).reshape(-1, 3))


def fan(height, count=60):
    """A cone, or a disc for 0, of one point and a ring, closed by another point below."""
    at = 2 * np.pi * np.arange(count) / count
    ring = np.stack([np.cos(at), np.sin(at), 0 * at], axis=1)
    k = np.arange(count)
    up = np.stack([k, (k + 1) % count, 0 * k + count], axis=1)
    return Mesh.make(np.vstack([ring, [[0, 0, height], [0, 0, -0.1]]]),
                     np.vstack([up, up[:, [1, 0, 2]] + np.array([0, 0, 1])]))  # fmt: skip


def displaced(mesh, node, by):
    xyz = mesh.vertices.copy()
    xyz[node] += by
    return mesh.moved(xyz)


@pytest.mark.parametrize("node", [0, 7, 19, 100, 165, 319])  # corners, borders, inside
@pytest.mark.parametrize("by", [(0.0, 9.0, 9.0), (1e8, 1e8, 1e8)])
def test_one_displaced_node_is_named(node, by):
    mesh = displaced(zone(), node, by)
    assert [one.node for one in lone_nodes(mesh)] == [node]
    assert where(mesh, node) == f"node i={node % 20}, j={node // 20}, k=0 (from 0) of zone01"


def test_of_a_soup_of_triangles_too():
    mesh = soup(displaced(zone(), 165, (0.0, 30.0, 30.0)))
    (one,) = lone_nodes(mesh)
    np.testing.assert_allclose(mesh.vertices[one.node], zone().vertices[165] + [0.0, 30.0, 30.0])
    assert where(mesh, one.node) == f"node {one.node} of model (from 0)"


def test_two_at_one_fill_value():
    mesh = zone()
    mesh.vertices[[165, 250]] = 1e8
    assert lone_nodes(mesh)[0].node == 165


@pytest.mark.parametrize(
    "mesh",
    [zone(), zone(stretch=1.6), soup(zone(stretch=1.6)), fan(0.0), fan(3.0), soup(fan(3.0)), zone(2, 2), zone(2, 30),
     Mesh.make([[0, 0, 0], [1, 0, 0], [0.5, 90, 0]], [[0, 1, 2]]), Mesh.make(np.zeros((0, 3)), np.zeros((0, 3)))],
)  # fmt: skip
def test_sound_grids_have_none(mesh):
    assert lone_nodes(mesh) == []


@pytest.mark.parametrize("seed", [3, 4])
def test_simulated_grids_have_none(seed):
    mesh = synth.wind_tunnel(seed, size_px=(320, 256), nodes=4000, clutter=None).mesh
    assert lone_nodes(mesh) == []
    assert lone_nodes(soup(mesh)) == []


def test_the_verdict_names_it_and_asks_nothing_else_of_such_a_grid():
    mesh = zone()
    markers = MarkerSet.make([f"m{k}" for k in range(40)], mesh.vertices[20:300:7])
    assert grid_findings(markers, mesh, "mm") == []
    (found,) = grid_findings(markers, displaced(mesh, 165, (0.0, 60.0, 60.0)), "mm")
    assert (found.word, found.cause) == ("doubtful", "file")
    assert found.reason.startswith("node i=5, j=8, k=0 (from 0) of zone01 lies 8")
    assert found.reason.endswith(" in the grid, which lie within 2.6 mm: a fill value or a typing error?")


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("count", [6, 36])
def test_the_tip_of_a_slender_cone_is_no_lone_node(count, closed):
    """What every STL of a cone has: one fan of long triangles; behind it the base, or a finely meshed body."""
    around = np.linspace(0, 2 * np.pi, count, endpoint=False)
    rings = [np.column_stack([np.full(count, -5.0 * k), 5 * np.cos(around), 5 * np.sin(around)]) for k in range(4)]
    k = np.arange(count)
    after = (k + 1) % count
    if closed:
        xyz = np.vstack([[[60.0, 0, 0], [0.0, 0, 0]], rings[0]])
        faces = [np.stack([np.full(count, n), k + 2, after + 2], axis=1) for n in (0, 1)]
    else:
        xyz = np.vstack([[[60.0, 0, 0]], *rings])
        faces = [np.stack([np.zeros(count, int), k + 1, after + 1], axis=1)]
        for n in range(3):
            a, b = 1 + n * count, 1 + (n + 1) * count
            faces += [np.stack([a + k, b + k, a + after], axis=1), np.stack([a + after, b + k, b + after], axis=1)]
    assert lone_nodes(Mesh.make(xyz, np.concatenate(faces))) == []
