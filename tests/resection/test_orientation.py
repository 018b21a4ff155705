"""Turning blocks outward."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.resection import orient_outward
from windmark.resection.orientation import solid_angles
from windmark.scene import Mesh, structured_triangles

sys.path.insert(0, str(Path(__file__).parent))
from resection_shapes import box, joined, moved, plate, sphere


def flipped(mesh, which):
    t = mesh.triangles.copy()
    t[which] = t[which][:, [0, 2, 1]]
    return Mesh.make(mesh.vertices, t)


def same_orientation(a, b):
    return np.einsum("tk,tk->t", a.triangle_normals(), b.triangle_normals()) >= 0


def test_blocks_of_any_handedness_become_one_outward_body(rng):
    mesh = joined(box(5, half=(1, 2, 3.0)), sphere(20, center=(9.0, 0, 0)))
    for _ in range(5):
        wild = flipped(mesh, rng.random(len(mesh.triangles)) < rng.random())
        got = orient_outward(wild)
        assert same_orientation(got, mesh).all()
        np.testing.assert_array_equal(np.sort(got.triangles), np.sort(mesh.triangles))
        np.testing.assert_array_equal(got.triangles[:, 0], wild.triangles[:, 0])
    assert same_orientation(orient_outward(mesh), mesh).all()


def test_half_model():
    whole = sphere(24)
    middle = whole.vertices[whole.triangles].mean(axis=1)
    half = Mesh.make(whole.vertices, whole.triangles[middle[:, 0] > 0])
    got = orient_outward(flipped(half, np.arange(len(half.triangles)) % 3 > 0))
    assert same_orientation(got, half).all()


def test_flat_plate_keeps_its_majority_or_faces_the_air():
    mesh = plate()
    some = np.arange(len(mesh.triangles)) % 3 == 0
    assert same_orientation(orient_outward(flipped(mesh, some)), mesh).all()
    assert not same_orientation(orient_outward(flipped(mesh, ~some)), mesh).any()
    assert same_orientation(orient_outward(flipped(mesh, ~some), outside=[0, 0, 5.0]), mesh).all()
    assert not same_orientation(orient_outward(mesh, outside=[0, 0, -5.0]), mesh).any()


def test_one_sided_strip_is_left_alone():
    n = 30
    angle = np.linspace(0, 2 * np.pi, n + 1)
    rim = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    out = np.stack([np.cos(angle) * np.cos(angle / 2), np.sin(angle) * np.cos(angle / 2), np.sin(angle / 2)], axis=1)
    xyz = np.concatenate([rim - 0.2 * out, rim + 0.2 * out])
    k = np.arange(n)
    strip = np.concatenate([np.stack([k, k + 1, k + n + 2], axis=1), np.stack([k, k + n + 2, k + n + 1], axis=1)])
    mesh = Mesh.make(xyz, strip)
    np.testing.assert_array_equal(orient_outward(mesh, outside=[0, 0, 9]).triangles, mesh.triangles)


def test_collapsed_and_empty():
    empty = Mesh.make(np.zeros((0, 3)), [])
    assert orient_outward(empty) is empty
    point = Mesh.make(np.zeros((3, 3)), [[0, 1, 2]])
    np.testing.assert_array_equal(orient_outward(point).triangles, point.triangles)
    with pytest.raises(ValueError, match="outside"):
        orient_outward(plate(), outside=[1, 2])
    with pytest.raises(ValueError, match="tolerance"):
        orient_outward(plate(), tolerance=-1)


def camera_at(eye, target=(0.0, 0, 0), size=(320, 240), focal=200.0):
    return Camera(size, focal), Pose.look_at(np.array(eye, float), np.array(target, float), [0.1, 0.2, 1])


def parts(mesh, *counts):
    """Triangle numbers of the parts of a joined mesh, given by how many triangles each has."""
    return np.split(np.arange(len(mesh.triangles)), np.cumsum(counts)[:-1])


def outward_of(mesh, which, center=(0, 0, 0)):
    """Share of the triangles with an area whose normal points away from a centre."""
    middle = mesh.vertices[mesh.triangles[which]].mean(axis=1) - np.array(center)
    away = np.einsum("tk,tk->t", mesh.triangle_normals()[which], middle)
    return float((away[np.abs(away) > 1e-12] > 0).mean())


@pytest.mark.parametrize("wall_as_file", [True, False])
@pytest.mark.parametrize("seen", [True, False])
def test_a_closed_box_of_walls_round_the_model_has_its_air_inside(wall_as_file, seen):
    walls, body = box(4, half=(5, 5, 5.0)), sphere(20)
    mesh = joined(body, walls if wall_as_file else flipped(walls, slice(None)))
    model, wall = parts(mesh, len(body.triangles), len(walls.triangles))
    cameras = [camera_at([0, -4, 0.5])] if seen else []
    got = orient_outward(flipped(mesh, model[::3]), cameras=cameras)
    assert outward_of(got, wall) == 0
    assert outward_of(got, model) == 1


def test_one_wall_behind_a_half_model_faces_the_camera():
    whole = sphere(24)
    half = Mesh.make(whole.vertices, whole.triangles[whole.vertices[whole.triangles].mean(axis=1)[:, 0] > 0])
    # A wall with a bend in it: its own centroid is on the side of the model, and so is the air.
    y, z = np.meshgrid(np.linspace(-4, 4, 9), np.linspace(-4, 4, 9))
    bent = np.stack([-0.5 + 0.1 * y**2, y, z], axis=-1).reshape(-1, 3)
    wall = Mesh.make(bent, structured_triangles(9, 9))
    mesh = joined(half, wall)
    mine, behind = parts(mesh, len(half.triangles), len(wall.triangles))
    for turned in (mesh, flipped(mesh, behind), flipped(mesh, mine)):
        got = orient_outward(turned, cameras=[camera_at([6, 1, 2.0])])
        assert outward_of(got, mine) == 1
        assert (got.triangle_normals()[behind][:, 0] > 0).all()


def test_a_flat_plate_faces_the_camera():
    mesh = plate()
    above, below = ([camera_at([0.3, 0.2, z])] for z in (5.0, -5.0))
    assert same_orientation(orient_outward(flipped(mesh, slice(None)), cameras=above), mesh).all()
    assert not same_orientation(orient_outward(mesh, cameras=below), mesh).any()


def test_a_sliver_of_the_other_side_does_not_turn_an_open_sheet():
    """A thin part whose edge is not in the grid: past its upper side a little of the lower one's back is seen."""
    upper, lower = plate(), moved(flipped(plate(), slice(None)), 0, 0, -0.04)
    thin = joined(upper, lower)
    above = [camera_at([2.5, -3.0, 4.0])]
    assert same_orientation(orient_outward(thin, cameras=above), thin).all()
    # Alone it is seen as a whole: that is its air side.
    assert not same_orientation(orient_outward(lower, cameras=above), lower).any()


@pytest.mark.parametrize("radius", [50, 500])
def test_a_far_field_does_not_join_the_sides_of_a_thin_trailing_edge(radius):
    """At its scale the last rows of both sides are one place; what was joined was turned for itself."""
    n = 81
    x, y = (g.ravel() for g in np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n)))
    half, t, far = 5e-5 + 0.02 * (1 - x), structured_triangles(n, n), sphere(10)
    xyz = np.concatenate([np.c_[x, y, half], np.c_[x, y, -half]])
    wing = Mesh.make(xyz, np.concatenate([t, t + n * n]))
    triangles = np.concatenate([wing.triangles, far.triangles + 2 * n * n])
    both = Mesh.make(np.concatenate([xyz, radius * far.vertices]), triangles)
    above = [camera_at([0.5, 0.5, 3.0], (0.5, 0.5, 0.0))]
    alone, beside = (orient_outward(m, cameras=above).triangles[: 2 * len(t)] for m in (wing, both))
    assert (beside == alone).all()


def test_a_body_with_separate_closed_parts_is_outward_without_and_with_cameras():
    """A nacelle in the box of the body, and a patch laid over the body just under its surface, make it no wall."""
    body, nacelle = sphere(30, radius=3.0), sphere(16, radius=0.4, center=(2.6, 2.6, 0))
    on_top = (body.vertices[body.triangles].mean(axis=1) > [1, -1, 0]).all(axis=1)
    patch = Mesh.make(0.9999 * body.vertices, body.triangles[on_top])
    mesh = joined(body, nacelle, patch)
    own, pod, over = parts(mesh, len(body.triangles), len(nacelle.triangles), len(patch.triangles))
    for cameras in ([], [camera_at([9, 2, 3.0]), camera_at([-9, 2, 3.0])]):
        got = orient_outward(flipped(mesh, slice(None, None, 2)), cameras=cameras)
        assert outward_of(got, own) == 1
        assert outward_of(got, pod, (2.6, 2.6, 0)) == 1
        assert outward_of(got, over) == 1


def test_a_camera_outside_a_body_with_a_shell_inside_sees_that_it_is_no_wall():
    body, tank = sphere(30, radius=3.0), box(4)
    mesh = joined(body, tank)
    own, inner = parts(mesh, len(body.triangles), len(tank.triangles))
    got = orient_outward(flipped(mesh, own), cameras=[camera_at([9, 2, 3.0])])
    assert outward_of(got, own) == 1
    assert outward_of(got, inner) == 1


def test_nodes_in_no_triangle_change_nothing():
    mesh = joined(box(4), moved(sphere(16), 1.5, 0, 0))
    for far in ([[1e6, 0, 0], [0, -1e6, 3]], [[np.nan, 0, 0]], [[1.0, 1.0, 1.0 + 1e-6]]):
        more = Mesh(np.concatenate([mesh.vertices, far]), mesh.triangles[::-1], mesh.volume)
        plain = Mesh(mesh.vertices, mesh.triangles[::-1], mesh.volume)
        assert more.diagonal == plain.diagonal
        np.testing.assert_array_equal(orient_outward(more).triangles, orient_outward(plain).triangles)


def test_solid_angles_of_a_closed_surface_add_up():
    corners = box(4).vertices[box(4).triangles]
    assert solid_angles(corners - [0.3, -0.2, 0.5]).sum() == pytest.approx(4 * np.pi)
    assert solid_angles(corners - [3.0, -0.2, 0.5]).sum() == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize("height", [2.0, 0.5])
def test_open_walls_have_their_air_where_the_model_is(reverse, height):
    """A floor and a side wall in one sheet, the model between them or on the floor, no camera; right or turned."""
    floor, model = plate(9, 9, size=(10.0, 10.0)), sphere(12, radius=0.5, center=(0.5, 0.5, height))
    side = Mesh.make(
        floor.vertices @ np.array([[0, 0, 1.0], [0, 1, 0], [-1.0, 0, 0]]) + [-5.0, 0, 5.0], floor.triangles
    )
    walls = joined(floor, side)
    facing = np.einsum("tk,tk->t", walls.triangle_normals(), [0.5, 0.5, 2.0] - walls.vertices[walls.triangles[:, 0]])
    inside = walls.triangles.copy()
    inside[facing < 0] = inside[facing < 0][:, ::-1]
    mesh = joined(Mesh.make(walls.vertices, inside[:, ::-1] if reverse else inside), model)
    got = orient_outward(mesh).triangle_normals()[: len(inside)]
    middle = mesh.vertices[mesh.triangles[: len(inside)]].mean(axis=1)
    assert (np.einsum("tk,tk->t", got, [0.5, 0.5, 2.0] - middle) > 0).all()
