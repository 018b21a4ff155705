"""Pixel maps: exact surface points, hidden surfaces, awkward meshes."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from windmark.geometry import Camera, Pose, rays
from windmark.resection import PixelMap, map_pixels
from windmark.scene import Mesh

sys.path.insert(0, str(Path(__file__).parent))
from resection_shapes import (
    box,
    brute_first_hits,
    joined,
    lens_camera,
    looking_at,
    moved,
    pixel_grid,
    plate,
    soup,
    sphere,
)


def test_plane_through_a_distorted_lens_is_met_exactly():
    camera, pose = lens_camera(), looking_at([0.5, -2.0, 2.5])
    got = map_pixels(plate(size=(2.0, 1.6)), camera, pose)
    # By hand: the ray of each pixel in model coordinates, met with z = 0.
    rays = camera.unproject(pixel_grid(camera)) @ pose.rotation
    point = pose.center - rays * (pose.center[2] / rays[..., 2:])
    inside = (rays[..., 2] < 0) & (np.abs(point[..., 0]) < 1.0) & (np.abs(point[..., 1]) < 0.8)
    np.testing.assert_array_equal(got.valid, inside)
    assert 0.2 < inside.mean() < 0.9
    np.testing.assert_allclose(got.xyz()[inside], point[inside], atol=1e-12)
    np.testing.assert_allclose(got.depth()[inside], pose.apply(point[inside])[:, 2], rtol=1e-12)
    assert np.isnan(got.xyz()[~inside]).all()
    assert np.isnan(got.barycentric[~inside]).all()


def test_nearest_surface_wins_whatever_its_orientation(rng):
    mesh, camera, pose = soup(rng, 80), lens_camera(), looking_at([3.0, 1.0, 2.0])
    got = map_pixels(mesh, camera, pose)
    rays = camera.unproject(pixel_grid(camera)).reshape(-1, 3)[:, :2]
    triangle, depth = brute_first_hits(pose.apply(mesh.vertices), mesh.triangles, rays)
    np.testing.assert_array_equal(got.triangle.ravel(), triangle)
    np.testing.assert_allclose(np.nan_to_num(got.depth().ravel(), nan=np.inf), depth, rtol=1e-11)
    turned = Mesh.make(mesh.vertices, mesh.triangles[:, ::-1])
    np.testing.assert_array_equal(map_pixels(turned, camera, pose).triangle, got.triangle)


def test_backfaces_can_be_looked_through():
    mesh, camera, pose = box(n=3), Camera((40, 30), 60.0), looking_at([0.3, -5.0, 0.4])
    front, back = map_pixels(mesh, camera, pose), map_pixels(
        Mesh.make(mesh.vertices, mesh.triangles[:, ::-1]), camera, pose, cull_backfaces=True
    )  # fmt: skip
    np.testing.assert_array_equal(front.valid, back.valid)
    # Inside out and culled, only the far walls are left.
    assert (back.depth()[back.valid] > front.depth()[back.valid]).mean() > 0.99
    np.testing.assert_array_equal(map_pixels(mesh, camera, pose, cull_backfaces=True).triangle, front.triangle)


def test_camera_inside_a_closed_box_sees_walls_everywhere_and_clipped_triangles_count():
    # Two triangles to a wall: those beside the camera pass through its plane.
    mesh, camera = box(n=2, half=(2.0, 3.0, 4.0)), Camera((50, 40), 20.0, k1=-0.05)
    pose = looking_at([0.3, -0.2, 0.1], target=[1.0, 2.0, 0.5])
    got = map_pixels(mesh, camera, pose)
    assert got.valid.all()
    outside = np.abs(got.xyz()) / [2.0, 3.0, 4.0]
    np.testing.assert_allclose(outside.max(axis=-1), 1.0, atol=1e-12)
    assert (got.depth() > 0).all()
    crossing = (pose.apply(mesh.vertices)[mesh.triangles, 2] > 0).sum(axis=1)
    assert np.isin(got.triangle, np.flatnonzero((crossing == 1) | (crossing == 2))).any()
    assert not map_pixels(mesh, camera, pose, cull_backfaces=True).valid.any()


@pytest.mark.parametrize("mesh", [Mesh.make(np.zeros((0, 3)), []), Mesh.make(np.zeros((3, 3)), [])])
def test_empty_mesh(mesh):
    got = map_pixels(mesh, lens_camera(), Pose.identity())
    assert not got.valid.any()
    assert np.isnan(got.xyz()).all()
    assert np.isnan(got.obliquity_deg()).all()


def test_mesh_behind_the_camera():
    assert not map_pixels(box(center=(0, 0, -5.0)), lens_camera(), Pose.identity()).valid.any()


def test_triangles_without_area_and_unused_nan_nodes_change_nothing():
    mesh, camera, pose = plate(), lens_camera(), looking_at([0.5, -2.0, 2.5])
    bad = [[0, 0, 9], [3, 3, 3], [0, 4, 8]]  # an edge twice, a point, three nodes in a row
    more = Mesh.make(np.concatenate([mesh.vertices, [[np.nan] * 3]]), np.concatenate([bad, mesh.triangles]))
    want, got = map_pixels(mesh, camera, pose), map_pixels(more, camera, pose)
    np.testing.assert_array_equal(got.valid, want.valid)
    np.testing.assert_allclose(got.xyz(), want.xyz(), atol=1e-12)


def test_triangle_with_a_nan_node_is_not_seen():
    mesh = Mesh.make([[-1, -1, 3], [1, -1, 3], [0, 1, 3], [np.nan, 0, 2]], [[0, 1, 2], [0, 1, 3]])
    got = map_pixels(mesh, lens_camera(), Pose.identity())
    assert got.valid.any()
    assert not (got.triangle == 1).any()


def test_triangle_edge_on_is_not_seen():
    mesh = Mesh.make([[-1, 0, 3], [1, 0, 3], [0, 0, 5]], [[0, 1, 2]])
    assert not map_pixels(mesh, Camera((5, 5), 5.0), Pose.identity()).valid.any()


def test_pixels_beyond_the_lens_model_are_not_valid():
    camera = Camera((80, 80), 30.0, k1=-0.25)  # turns back at r = 1.15 ideal, 23 px
    got = map_pixels(plate(size=(90, 90)), camera, Pose(np.eye(3), np.array([0, 0, 5.0])))
    radius = np.linalg.norm(pixel_grid(camera) - 39.5, axis=-1)
    np.testing.assert_array_equal(got.valid, radius < 30 * (2 / 3) / np.sqrt(0.75))


def test_no_crack_where_rays_meet_nodes_and_edges():
    # A ray through each node of the plate and along its edges: a closed surface must not leak.
    camera = Camera((81, 81), 40.0, cx=40, cy=40)
    got = map_pixels(plate(11, 11, size=(4.0, 4.0)), camera, Pose(np.eye(3), np.array([0, 0, 2.0])))
    assert got.valid.all()


def test_of_two_triangles_at_one_depth_the_first_is_taken():
    mesh = plate(2, 2)
    twice = Mesh.make(mesh.vertices, np.concatenate([mesh.triangles, mesh.triangles]))
    assert map_pixels(twice, lens_camera(), looking_at([0.1, -1, 3.0])).triangle.max() == 1


def test_oblique_slivers_are_all_found():
    # A fan of slivers as CAD programs write them, each crossing the whole picture aslant.
    angle = np.linspace(0.3, 1.2, 400)
    rim = 9 * np.stack([np.cos(angle), np.sin(angle), np.full(400, 0.3)], axis=1)
    fan = [[0, k + 1, k + 2] for k in range(399)]
    mesh = Mesh.make(np.concatenate([[[-5.0, -5.0, 0.1]], rim]), fan)
    camera, pose = lens_camera((120, 90), 80.0), Pose(np.eye(3), np.array([0, 0, 6.0]))
    got = map_pixels(mesh, camera, pose)
    rays = camera.unproject(pixel_grid(camera)).reshape(-1, 3)[:, :2]
    triangle, _ = brute_first_hits(pose.apply(mesh.vertices), mesh.triangles, rays)
    assert (triangle >= 0).mean() > 0.2
    np.testing.assert_array_equal(got.triangle.ravel(), triangle)


def test_large_images_are_mapped_in_bands(monkeypatch):
    mesh, camera, pose = sphere(), lens_camera(), looking_at([2.0, 1.0, 1.0])
    whole = map_pixels(mesh, camera, pose)
    monkeypatch.setattr("windmark.resection.pixelmap.RAYS_AT_ONCE", 7 * camera.size_px[0])
    bands = map_pixels(mesh, camera, pose)
    np.testing.assert_array_equal(bands.triangle, whole.triangle)
    np.testing.assert_allclose(bands.barycentric, whole.barycentric, atol=1e-12)


@pytest.mark.parametrize(
    "camera",
    [
        Camera((31, 23), 40.0, 0.98, 14.0, 12.0),
        lens_camera(),
        Camera((90, 70), 30.0, k1=-0.25, p1=0.004, p2=0.003),  # corners without a ray
        Camera((90, 70), 45.0, k1=0.3, k2=0.1, k3=-0.02, tilt_x=-0.05),
    ],
)
def test_rays_of_pixels_are_those_of_the_camera(camera):
    want = camera.unproject(pixel_grid(camera))[..., :2]
    np.testing.assert_allclose(rays.pixel_rays(camera, 0, camera.size_px[1]), want, rtol=0, atol=1e-13)
    np.testing.assert_allclose(rays.pixel_rays(camera, 5, 2), want[5:7], rtol=0, atol=1e-13)


def test_rays_are_found_once_for_a_camera_and_kept_as_far_as_there_is_room(monkeypatch):
    asked, find = [], rays.pixel_rays
    monkeypatch.setattr(rays, "pixel_rays", lambda *a: (asked.append(a[1:]), find(*a))[1])
    monkeypatch.setattr(rays, "_KEPT", rays._Kept())
    monkeypatch.setattr(rays, "KEPT_BYTES", 2 * 40 * 30 * 16)
    camera, other = Camera((40, 30), 50.0, k1=-0.1), Camera((40, 30), 50.0, k1=-0.2)
    first = rays.kept_rays(camera, 0, 30)
    assert rays.kept_rays(replace(camera), 0, 30) is first
    np.testing.assert_array_equal(rays.kept_rays(other, 0, 30), find(other, 0, 30))
    assert rays.kept_rays(camera, 0, 30) is first
    assert len(asked) == 2
    rays.kept_rays(camera, 10, 20)  # the oldest, the other camera, makes room
    rays.kept_rays(other, 0, 30)
    assert asked == [(0, 30), (0, 30), (10, 20), (0, 30)]
    rays.kept_rays(Camera((200, 200), 50.0), 0, 200)  # more than there is room for
    assert rays.kept_rays(other, 0, 30) is rays.kept_rays(other, 0, 30)
    assert len(asked) == 5


def test_node_and_triangle_values_on_pixels():
    mesh, camera, pose = sphere(), lens_camera(), looking_at([2.0, 1.0, 1.0])
    got = map_pixels(mesh, camera, pose)
    linear = mesh.vertices @ [1.0, -2.0, 0.5] + 3
    xyz = got.xyz()
    np.testing.assert_allclose(got.interpolate(linear), xyz @ [1.0, -2.0, 0.5] + 3, atol=1e-12)
    both = got.interpolate(np.stack([linear, mesh.vertices[:, 0]], axis=1))
    np.testing.assert_allclose(both[..., 1], xyz[..., 0], atol=1e-12)
    ids = got.triangle_values(np.arange(len(mesh.triangles)))
    np.testing.assert_array_equal(ids[got.valid], got.triangle[got.valid])
    assert (ids[~got.valid] == 0).all()
    assert np.isnan(got.triangle_values(np.ones(len(mesh.triangles)))[~got.valid]).all()
    assert set(np.unique(got.triangle_values(mesh.volume))) == {"", "model"}
    np.testing.assert_array_equal(got.to_image(xyz[got.valid]), xyz)
    with pytest.raises(ValueError, match="node_values"):
        got.interpolate(linear[:-1])
    with pytest.raises(ValueError, match="triangle_values"):
        got.triangle_values(linear)
    with pytest.raises(ValueError, match="to_image"):
        got.to_image(linear)


def test_obliquity_of_a_plate():
    camera, pose = Camera((21, 21), 40.0), looking_at([0.0, -3.0, 3.0])
    flat = plate(size=(20, 20))
    got = map_pixels(flat, camera, pose)
    sight = pose.center - got.xyz()
    want = np.degrees(np.arccos(sight[..., 2] / np.linalg.norm(sight, axis=-1)))
    np.testing.assert_allclose(got.obliquity_deg(), want, atol=1e-6)
    assert got.obliquity_deg()[10, 10] == pytest.approx(45)
    under = map_pixels(Mesh.make(flat.vertices, flat.triangles[:, ::-1]), camera, pose)
    np.testing.assert_allclose(under.obliquity_deg(), want, atol=1e-6)


def test_points_follow_the_grid_when_it_deforms():
    mesh, camera, pose = plate(), lens_camera(), looking_at([0.5, -2.0, 2.5])
    got = map_pixels(mesh, camera, pose)
    bent = Mesh.make(mesh.vertices + np.outer(mesh.vertices[:, 0], [0, 0, 0.1]), mesh.triangles)
    moved, at_rest = got.xyz(bent), got.xyz()
    np.testing.assert_allclose(moved[..., 2], 0.1 * at_rest[..., 0], atol=1e-12)
    with pytest.raises(ValueError, match="nodes and triangles"):
        got.xyz(box())


def test_wrong_arguments():
    pose = Pose(np.stack([np.eye(3)] * 2), np.zeros((2, 3)))
    with pytest.raises(ValueError, match="single Pose"):
        map_pixels(plate(), lens_camera(), pose)
    with pytest.raises(ValueError, match=r"cam_from_model is an array; expected map_pixels\(mesh: Mesh"):
        map_pixels(plate(), lens_camera(), np.eye(4))
    with pytest.raises(ValueError, match="PixelMap"):
        PixelMap(np.zeros((3, 3), np.int32), np.zeros((3, 3, 2)), plate(), lens_camera(), Pose.identity())


def test_hidden_part_behind_another():
    near, far = sphere(center=(0, 0, 4.0), radius=0.5), plate(size=(20.0, 20.0))
    far = moved(far, 0, 0, 8.0)
    got = map_pixels(joined(far, near), Camera((41, 41), 40.0), Pose.identity())
    assert got.valid.all()
    first = got.triangle >= len(far.triangles)
    # The globe's limb is at asin(0.5 / 4); its polygon is at most that.
    angle = np.arctan(np.linalg.norm(pixel_grid(got.camera) - 20.0, axis=-1) / 40.0)
    assert not first[angle > np.arcsin(0.125)].any()
    assert first[angle < np.arcsin(0.125) * 0.95].all()
