"""Parts without thickness that the grid has as two zones, one for each side."""

import sys
from pathlib import Path

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.resection import map_pixels, orient_outward, see_nodes, sides_in_doubt
from windmark.scene import Block, Mesh, structured_triangles

sys.path.insert(0, str(Path(__file__).parent))
from resection_shapes import sphere

NX, NY = 9, 7
CAMERA = Camera((320, 240), 200.0)
ABOVE, BELOW = ([(CAMERA, Pose.look_at([0.3, 0.2, z], np.zeros(3), [0.1, 1, 0]))] for z in (6.0, -6.0))


def zones(*grids, wound=None):
    """Structured zones (ni, nj, 3) as a mesh; those of ``wound`` False the other way round."""
    xyz, triangles, blocks, first = [], [], [], 0
    for k, g in enumerate(grids):
        ni, nj = g.shape[:2]
        blocks.append(Block(f"zone {k + 1}", (ni, nj, 1), first))
        triangles.append(structured_triangles(ni, nj, first, wound is not None and not wound[k]))
        xyz.append(g.transpose(1, 0, 2).reshape(-1, 3))
        first += ni * nj
    t = np.concatenate(triangles)
    return Mesh(np.concatenate(xyz), t, np.full(len(t), "model"), tuple(blocks))


def fin(bend=0.0):
    x, y = np.meshgrid(np.linspace(-2, 2, NX), np.linspace(-1.5, 1.5, NY), indexing="ij")
    return np.stack([x, y, bend * (x**2 + 0.4 * x * y)], axis=-1)


def up(mesh, zone):
    """Whether all triangles of a zone are turned upward, or none."""
    cells = np.cumsum([0, *((b.shape_ijk[0] - 1) * (b.shape_ijk[1] - 1) for b in mesh.blocks)])
    z = mesh.triangle_normals()[2 * cells[zone] : 2 * cells[zone + 1], 2]
    z = z[z != 0]
    assert (z > 0).all() or (z < 0).all()
    return bool(z[0] > 0)


@pytest.mark.parametrize("bend", [0.0, 0.1])
@pytest.mark.parametrize("other", ["winding", "diagonals"])
@pytest.mark.parametrize("cameras", [ABOVE, BELOW, ABOVE + BELOW, []])
def test_the_side_that_the_camera_cannot_see_has_no_values(bend, other, cameras):
    """As the file winds them, whatever a camera sees: it meets both at one place."""
    a = fin(bend)
    mesh = zones(a, a, wound=(True, False)) if other == "winding" else zones(a, a[::-1])
    turned = orient_outward(mesh, cameras=cameras)
    assert (up(turned, 0), up(turned, 1)) == (True, False)
    assert sides_in_doubt(mesh, turned) == ()
    for camera, pose in cameras:
        seen = see_nodes(turned, camera, pose).visible
        front = pose.center[2] > 0
        assert seen[: NX * NY].all() == front
        assert seen[NX * NY :].any() == (not front)


@pytest.mark.parametrize("first", [True, False])
def test_of_two_sides_at_one_place_the_one_that_faces_the_camera_is_met(first):
    a = fin()
    turned = orient_outward(zones(a, a, wound=(first, not first)), cameras=ABOVE)
    seen = map_pixels(turned, *ABOVE[0])
    met = np.unique(seen.triangle[seen.valid])
    assert (turned.triangle_normals()[met, 2] > 0).all()


@pytest.mark.parametrize("inward", [False, True])
def test_other_parts_tell_how_the_file_winds(inward):
    ball = sphere(16, 0.5, (0, 0, -3.0)).vertices.reshape(9, 17, 3).transpose(1, 0, 2)
    mesh = zones(ball, fin(), fin(), wound=(not inward, True, False))
    turned = orient_outward(mesh)
    assert (up(turned, 1), up(turned, 2)) == (not inward, inward)
    assert sides_in_doubt(mesh, turned) == ()


def test_where_nothing_tells_which_side_is_which_it_is_said():
    a, ball = fin(), sphere(16, 0.5, (0, 0, -3.0)).vertices.reshape(9, 17, 3).transpose(1, 0, 2)
    mesh = zones(a, a)
    turned = orient_outward(mesh, cameras=ABOVE)
    assert up(turned, 0) != up(turned, 1)
    assert sides_in_doubt(mesh, turned) == (("zone 1", "zone 2"),)
    mixed = zones(ball, ball + np.array([0, 0, -2.0]), a, a, wound=(True, False, True, False))
    assert sides_in_doubt(mixed, orient_outward(mixed)) == (("zone 3", "zone 4"),)


def test_a_fin_on_a_body_leaves_the_body_whole():
    """The root's edges are the body's, too: there four triangles meet."""
    x, y, z = np.linspace(-2, 2, NX), np.linspace(-1.5, 1.5, NY), np.linspace(0, 1.2, 5)
    floor = np.stack(np.broadcast_arrays(x[:, None], y[None], 0.0), axis=-1)
    wall = np.stack(np.broadcast_arrays(x[:, None], y[NY // 2], z[None]), axis=-1)
    mesh = zones(floor, wall, wall, wound=(True, True, False))
    mesh.triangles[:20] = mesh.triangles[:20, ::-1]  # of the floor alone some are the wrong way round
    turned = orient_outward(mesh, cameras=ABOVE)
    assert up(turned, 0)
    normal = turned.triangle_normals()
    count = 2 * (NX - 1) * (NY - 1)
    one, two = np.split(normal[count:, 1], 2)
    assert np.ptp(np.sign(one)) == np.ptp(np.sign(two)) == 0
    assert np.sign(one[0]) == -np.sign(two[0])


def test_zones_that_overlap_by_some_cells_have_no_two_sides():
    a = fin()
    left, right = a[:6], a[4:]
    mesh = zones(left, right)
    turned = orient_outward(mesh, cameras=ABOVE)
    assert up(turned, 0)
    assert up(turned, 1)
    assert sides_in_doubt(mesh, turned) == ()


def test_a_closed_body_that_is_there_twice_stays_outward():
    ball = sphere(16).vertices.reshape(9, 17, 3).transpose(1, 0, 2)
    mesh = zones(ball, ball)
    turned = orient_outward(mesh)
    middle = turned.vertices[turned.triangles].mean(axis=1)
    assert (np.einsum("tk,tk->t", turned.triangle_normals(), middle) >= -1e-12).all()
    assert sides_in_doubt(mesh, turned) == ()
