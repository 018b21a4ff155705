"""Virtual images: 3D alignment, occlusion, both sides of a sheet, deformation, sequences."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.resection import map_pixels, node_values, see_pixels, silhouette, virtual_image
from windmark.resection.reasons import FACING_AWAY, HIDDEN, OBLIQUE, OUTSIDE
from windmark.scene import Mesh

sys.path.insert(0, str(Path(__file__).parent))
from resection_shapes import box, joined, lens_camera, looking_at, plate, sphere


def pattern(xyz):
    """A smooth paint that is different everywhere."""
    x, y, z = np.moveaxis(np.asarray(xyz), -1, 0)
    return 100 + 30 * np.sin(2 * x) + 20 * np.cos(3 * y - z) + 5 * z


def photograph(mesh, camera, pose, background=0.0):
    """What a camera sees of the painted model, each pixel exact at its centre."""
    return np.nan_to_num(pattern(map_pixels(mesh, camera, pose).xyz()), nan=background).astype(np.float32)


@pytest.mark.parametrize("interpolation", ["nearest", "linear", "cubic"])
def test_own_point_of_view_gives_the_image_back(interpolation, rng):
    mesh, camera, pose = joined(plate(9, 9), box(5, half=(0.4, 0.4, 0.4))), lens_camera(), looking_at([2, -2, 2.5])
    image = rng.integers(0, 4096, camera.size_px[::-1]).astype(np.uint16)
    pixel_map = map_pixels(mesh, camera, pose)
    got, valid = virtual_image(image, pixel_map, camera, pose, interpolation=interpolation)
    assert got.dtype == np.float32
    np.testing.assert_array_equal(valid, pixel_map.valid)
    np.testing.assert_array_equal(got[valid], image[valid].astype(np.float32))
    assert np.isnan(got[~valid]).all()
    assert 0.2 < valid.mean() < 1


def test_occlusion_between_two_views():
    floor, tower = plate(21, 21, size=(4.0, 4.0)), box(5, half=(0.4, 0.4, 0.5), center=(0, 0, 0.5))
    mesh, camera = joined(floor, tower), Camera((160, 120), 140.0, k1=-0.05)
    eye = np.array([3.0, -2.0, 2.5])
    real, virtual = looking_at(eye), looking_at([-3.0, -2.5, 3.5])
    pixel_map = map_pixels(mesh, camera, virtual)
    got, valid = virtual_image(photograph(mesh, camera, real), pixel_map, camera, real)
    xyz = pixel_map.xyz()
    # Truth by slabs: a point of the floor is hidden where its line to the eye goes through the tower.
    in_picture = camera.in_image(camera.project(real.apply(xyz))[0])
    on_floor = pixel_map.valid & (np.abs(xyz[..., 2]) < 1e-9) & in_picture
    step = eye - xyz
    with np.errstate(divide="ignore", invalid="ignore"):
        t0, t1 = (np.array([-0.4, -0.4, 0.0]) - xyz) / step, (np.array([0.4, 0.4, 1.0]) - xyz) / step
    through = np.maximum(t0, t1).min(axis=-1) - np.maximum(np.minimum(t0, t1).max(axis=-1), 0.0)
    np.testing.assert_array_equal(valid[on_floor], (through < 0)[on_floor])
    assert (on_floor & ~valid).sum() > 50
    assert not valid[~in_picture].any()
    # The tower's sides that face away from the real camera are not drawn.
    assert not valid[pixel_map.valid & (np.abs(xyz[..., 0] + 0.4) < 1e-9) & (xyz[..., 2] > 0.01)].any()
    top = pixel_map.valid & (np.abs(xyz[..., 2] - 1) < 1e-9)
    assert valid[top].all()
    # Near outlines of the real picture two surfaces mix; away from them the paint itself is found.
    error = np.abs(got - pattern(xyz))[valid]
    assert np.median(error) < 0.01
    assert np.mean(error > 1) > 0.02
    image = photograph(mesh, camera, real)
    image[silhouette(map_pixels(mesh, camera, real))] = np.nan
    clean, kept = virtual_image(image, pixel_map, camera, real)
    assert np.abs(clean - pattern(xyz))[kept].max() < 1
    assert kept.sum() > 0.85 * valid.sum()


def test_the_other_side_of_an_open_sheet_is_not_shown():
    mesh, camera = plate(), Camera((60, 50), 50.0)
    above, below = looking_at([0.5, 0.5, 5.0], up=[0, 1, 0]), looking_at([0.5, 0.5, -5.0], up=[0, 1, 0])
    image = photograph(mesh, camera, below)
    for sheet in (mesh, Mesh.make(mesh.vertices, mesh.triangles[:, ::-1])):
        pixel_map = map_pixels(sheet, camera, above)
        _, valid = virtual_image(image, pixel_map, camera, below)
        assert pixel_map.valid.any()
        assert not valid.any()
        assert (see_pixels(pixel_map, camera, below).reason == FACING_AWAY).all()


def test_deformed_grid_is_followed():
    mesh, camera = plate(31, 31), Camera((120, 90), 110.0, k1=-0.03)
    bent = Mesh.make(mesh.vertices + np.outer(mesh.vertices[:, 0] ** 2, [0, 0, 0.08]), mesh.triangles)
    real, virtual = looking_at([1.0, -3.0, 4.0]), looking_at([0.0, -0.5, 5.0])
    pixel_map = map_pixels(mesh, camera, virtual)
    # The paint moves with the surface: the photograph of the bent plate shows the pattern of the flat one.
    seen = map_pixels(bent, camera, real)
    image = np.nan_to_num(pattern(seen.xyz(mesh)))
    got, valid = virtual_image(image, pixel_map, camera, real, mesh=bent)
    naive, _ = virtual_image(image, pixel_map, camera, real)
    inner = valid & (np.abs(pixel_map.xyz()[..., :2]) < 1.3).all(axis=-1)
    truth = pattern(pixel_map.xyz())
    assert inner.sum() > 1000
    assert np.abs(got - truth)[inner].max() < 0.05
    assert np.nanmax(np.abs(naive - truth)[inner]) > 1
    with pytest.raises(ValueError, match="nodes and triangles"):
        virtual_image(image, pixel_map, camera, real, mesh=box())


def test_reasons_and_obliquity_of_pixels():
    mesh, camera = sphere(60), Camera((80, 80), 120.0)
    pixel_map = map_pixels(mesh, camera, looking_at([4.0, 0, 0]))
    side = looking_at([0, 4.0, 0])
    view = see_pixels(pixel_map, camera, side, max_obliquity_deg=60)
    found = {int(r) for r in np.unique(view.reason)}
    assert OBLIQUE in found
    assert found & {FACING_AWAY, HIDDEN}
    xyz = pixel_map.xyz()[pixel_map.valid]
    sight = side.center - xyz
    angle = np.degrees(np.arccos(np.einsum("nk,nk->n", xyz, sight) / np.linalg.norm(sight, axis=1)))
    assert np.abs(view.obliquity_deg - angle).max() < 8  # facets of 6 degrees
    assert view.obliquity_deg[view.visible].max() <= 60
    _, valid = virtual_image(np.ones((80, 80)), pixel_map, camera, side, max_obliquity_deg=60)
    np.testing.assert_array_equal(valid[pixel_map.valid], view.visible)
    narrow = see_pixels(pixel_map, Camera((20, 20), 120.0), looking_at([4.0, 0.3, 0]))
    assert (narrow.reason == OUTSIDE).any()


def test_sequence_with_one_test_of_visibility():
    mesh, camera, pose = sphere(40), lens_camera(), looking_at([3.0, 0.5, 0.4])
    pixel_map = map_pixels(mesh, camera, looking_at([3.0, -0.2, 0.5]))
    view = see_pixels(pixel_map, camera, pose)
    moved = Pose.exp([0.003, -0.002, 0.004, 0.01, 0.0, -0.01]) @ pose
    image = photograph(mesh, camera, moved)
    quick = view.follow(camera, moved, pixel_map.xyz()[pixel_map.valid])
    got = pixel_map.to_image(node_values(image, quick))
    want, valid = virtual_image(image, pixel_map, camera, moved)
    both = valid & np.isfinite(got)
    assert both.sum() > 0.98 * valid.sum()
    np.testing.assert_array_equal(got[both], want[both])


def test_nan_and_channels(rng):
    mesh, camera, pose = plate(), lens_camera(), looking_at([0.5, -2, 2.5])
    pixel_map = map_pixels(mesh, camera, pose)
    image = rng.uniform(size=(*camera.size_px[::-1], 2))
    image[10:20, 20:30, 1] = np.nan
    got, valid = virtual_image(image, pixel_map, camera, pose)
    assert got.shape == image.shape
    np.testing.assert_array_equal(valid, pixel_map.valid & np.isfinite(image).all(axis=-1))
    nothing, valid = virtual_image(np.full(camera.size_px[::-1], np.nan), pixel_map, camera, pose)
    assert not valid.any()
    assert np.isnan(nothing).all()


def test_empty_map_and_wrong_arguments():
    camera, pose = lens_camera(), looking_at([0.5, -2, 2.5])
    empty = map_pixels(Mesh.make(np.zeros((0, 3)), []), camera, pose)
    image = np.zeros(camera.size_px[::-1])
    got, valid = virtual_image(image, empty, camera, pose)
    assert got.shape == image.shape
    assert not valid.any()
    pixel_map = map_pixels(plate(), camera, pose)
    with pytest.raises(ValueError, match="60 x 44"):
        virtual_image(image.T, pixel_map, camera, pose)
    with pytest.raises(ValueError, match="max_obliquity_deg"):
        virtual_image(image, pixel_map, camera, pose, max_obliquity_deg=-1)
    with pytest.raises(ValueError, match="tolerance"):
        virtual_image(image, pixel_map, camera, pose, tolerance=-1)
    with pytest.raises(ValueError, match="interpolation"):
        virtual_image(image, pixel_map, camera, pose, interpolation="spline")
    with pytest.raises(ValueError, match="single Pose"):
        virtual_image(image, pixel_map, camera, Pose(np.stack([np.eye(3)] * 2), np.zeros((2, 3))))


def test_silhouette_finds_outlines_and_no_creases():
    camera = Camera((120, 90), 100.0)
    # A box seen on its edge before a wall: its outline is one, the crease between its faces is none.
    wall = Mesh.make(plate(41, 41, size=(40, 40)).vertices - [0, 0, 5.0], plate(41, 41).triangles)
    mesh = joined(wall, box(9, half=(0.5, 0.5, 0.5)))
    pixel_map = map_pixels(mesh, camera, looking_at([0.9, 0.7, 5.0], up=[0, 1, 0]))
    got = silhouette(pixel_map)
    part = np.where(pixel_map.triangle >= len(wall.triangles), 1, 0)
    want = np.zeros_like(got)
    for axis in (0, 1):
        change = np.diff(part, axis=axis) != 0
        want |= np.concatenate([change, np.zeros_like(change[:1] if axis == 0 else change[:, :1])], axis=axis)
        want |= np.concatenate([np.zeros_like(change[:1] if axis == 0 else change[:, :1]), change], axis=axis)
    np.testing.assert_array_equal(got, want)
    assert len(np.unique(mesh.triangle_normals()[pixel_map.triangle[part == 1]].round(3), axis=0)) == 3
    wide = silhouette(pixel_map, width_px=3)
    assert (wide | ~got).all()
    assert wide.sum() > 2 * got.sum()
    assert not silhouette(map_pixels(wall, camera, looking_at([0.9, 0.7, 5.0], up=[0, 1, 0]))).any()
    # A globe from near: its facets are no outlines, its limb against the background is.
    globe = map_pixels(sphere(40), camera, looking_at([3.0, 0, 0]))
    limb = silhouette(globe)
    assert limb.any()
    inner = np.linalg.norm(globe.xyz() - [1.0, 0, 0], axis=-1) < 0.8
    assert not limb[inner].any()
    with pytest.raises(ValueError, match="width_px"):
        silhouette(globe, width_px=0.5)
    with pytest.raises(ValueError, match="step_px"):
        silhouette(globe, step_px=-1)
