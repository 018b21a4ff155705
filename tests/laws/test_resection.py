"""Laws of the pixel map, of visibility and of virtual images."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from windmark.geometry import Camera, Pose
from windmark.resection import interpolate_image, map_pixels, section, see_nodes, virtual_image
from windmark.scene import Mesh

sys.path.insert(0, str(Path(__file__).parents[1] / "resection"))
from resection_shapes import box, joined, looking_at, pixel_grid, plate, soup, sphere

LAW = settings(max_examples=15, deadline=None, derandomize=True)
SEEDS = st.integers(0, 2**32 - 1)


def scene(seed):
    """A mesh, a camera with a real lens, and a pose, at random."""
    rng = np.random.default_rng(seed)
    body = [soup(rng, 30), joined(plate(), sphere(14, radius=0.7)), box(3, half=rng.uniform(0.3, 1, 3))][seed % 3]
    k1, k2, p1, p2 = rng.uniform(-1, 1, 4) * [0.1, 0.03, 3e-3, 3e-3]
    tilt = rng.uniform(-0.05, 0.05, 2)
    camera = Camera(
        (40, 30),
        rng.uniform(25, 80),
        rng.uniform(0.97, 1.03),
        k1=k1,
        k2=k2,
        p1=p1,
        p2=p2,
        tilt_x=tilt[0],
        tilt_y=tilt[1],
    )
    eye = rng.normal(size=3)
    eye *= rng.uniform(1.5, 5) / np.linalg.norm(eye)
    return rng, body, camera, looking_at(eye, target=rng.uniform(-0.3, 0.3, 3), up=rng.normal(size=3))


@LAW
@given(SEEDS)
def test_a_pixel_s_point_projects_back_to_the_pixel(seed):
    _, mesh, camera, pose = scene(seed)
    pixel_map = map_pixels(mesh, camera, pose)
    xy, valid = camera.project(pose.apply(pixel_map.xyz()[pixel_map.valid]))
    assert valid.all()
    assert np.abs(xy - pixel_grid(camera)[pixel_map.valid]).max(initial=0) < 1e-6
    assert (pixel_map.depth()[pixel_map.valid] > 0).all()


@LAW
@given(SEEDS)
def test_order_of_triangles_and_of_their_corners_does_not_matter(seed):
    rng, mesh, camera, pose = scene(seed)
    order, turn = rng.permutation(len(mesh.triangles)), rng.integers(0, 3, len(mesh.triangles))
    corners = (turn[:, None] + np.arange(3)) % 3
    other = Mesh.make(mesh.vertices, np.take_along_axis(mesh.triangles[order], corners, axis=1))
    a, b = map_pixels(mesh, camera, pose), map_pixels(other, camera, pose)
    np.testing.assert_array_equal(a.valid, b.valid)
    np.testing.assert_allclose(b.depth(), a.depth(), rtol=1e-11)
    np.testing.assert_allclose(b.xyz(), a.xyz(), atol=1e-9)
    same = order[b.triangle[b.valid]] == a.triangle[a.valid]
    assert same.mean() > 0.95 if same.size else True  # only rays on common edges may choose
    np.testing.assert_array_equal(
        see_nodes(mesh, camera, pose, two_sided=True).reason, see_nodes(other, camera, pose, two_sided=True).reason
    )


@LAW
@given(SEEDS, st.floats(1e-3, 1e3))
def test_unit_of_length_does_not_matter(seed, scale):
    _, mesh, camera, pose = scene(seed)
    other = Mesh.make(mesh.vertices * scale, mesh.triangles)
    far = Pose(pose.rotation, pose.translation * scale)
    a, b = map_pixels(mesh, camera, pose), map_pixels(other, camera, far)
    assert (a.triangle == b.triangle).mean() > 0.999
    same = a.valid & (a.triangle == b.triangle)
    np.testing.assert_allclose(b.barycentric[same], a.barycentric[same], atol=1e-8)
    x, y = see_nodes(mesh, camera, pose), see_nodes(other, camera, far)
    assert (x.reason == y.reason).mean() > 0.999
    np.testing.assert_allclose(y.obliquity_deg, x.obliquity_deg, atol=1e-6)


@LAW
@given(SEEDS, st.integers(-10, 10))
def test_power_of_two_scale_changes_no_bit(seed, power):
    _, mesh, camera, pose = scene(seed)
    scale = 2.0**power
    a = map_pixels(mesh, camera, pose)
    b = map_pixels(
        Mesh.make(mesh.vertices * scale, mesh.triangles), camera, Pose(pose.rotation, pose.translation * scale)
    )
    np.testing.assert_array_equal(a.triangle, b.triangle)
    np.testing.assert_array_equal(a.barycentric, b.barycentric)


@LAW
@given(SEEDS)
def test_moving_model_and_camera_together_changes_nothing(seed):
    rng, mesh, camera, pose = scene(seed)
    move = Pose.exp(rng.normal(size=6))
    other = Mesh.make(move.apply(mesh.vertices), mesh.triangles)
    a, b = map_pixels(mesh, camera, pose), map_pixels(other, camera, pose @ move.inverse())
    assert (a.triangle == b.triangle).mean() > 0.995
    np.testing.assert_allclose(b.depth()[a.valid & b.valid], a.depth()[a.valid & b.valid], rtol=1e-6)
    x, y = see_nodes(mesh, camera, pose), see_nodes(other, camera, pose @ move.inverse())
    assert (x.reason == y.reason).mean() > 0.99


@LAW
@given(SEEDS)
def test_virtual_image_from_the_image_s_own_pose_is_the_image(seed):
    rng, mesh, camera, pose = scene(seed)
    image = rng.normal(size=camera.size_px[::-1]).astype(np.float32)
    pixel_map = map_pixels(mesh, camera, pose)
    for interpolation in ("nearest", "linear", "cubic"):
        got, valid = virtual_image(image, pixel_map, camera, pose, interpolation=interpolation)
        np.testing.assert_array_equal(got[valid], image[valid])
        assert valid.sum() >= 0.995 * pixel_map.valid.sum()  # grazing triangles of a soup may hide themselves


@LAW
@given(SEEDS)
def test_what_a_pixel_sees_is_a_node_that_is_seen(seed):
    # Put a node where a pixel's centre sees the surface: it is visible and falls on that pixel.
    rng, mesh, camera, pose = scene(seed)
    pixel_map = map_pixels(mesh, camera, pose)
    rows, columns = np.nonzero(pixel_map.valid)
    if not len(rows):
        return
    some = rng.choice(len(rows), min(20, len(rows)))
    rows, columns = rows[some], columns[some]
    t, x = mesh.triangles[pixel_map.triangle[rows, columns]], pixel_map.xyz()[rows, columns]
    new = len(mesh.vertices) + np.arange(len(rows), dtype=np.int32)
    fans = [np.stack([t[:, k], t[:, (k + 1) % 3], new], axis=1) for k in range(3)]
    other = Mesh.make(np.concatenate([mesh.vertices, x]), np.concatenate([mesh.triangles, *fans]))
    view = see_nodes(other, camera, pose, two_sided=True)
    assert view.visible[new].all()
    np.testing.assert_allclose(view.xy[new], np.stack([columns, rows], axis=1), atol=1e-6)


@LAW
@given(SEEDS)
def test_sampling_follows_shifts_flips_and_turns_of_the_image(seed):
    rng = np.random.default_rng(seed)
    image, xy = rng.normal(size=(24, 24)).astype(np.float32), rng.uniform(-1, 24, (60, 2))
    for interpolation in ("linear", "cubic"):
        got = interpolate_image(image, xy, interpolation=interpolation)
        for other, there in (
            (image[:, ::-1], [23, 0] + xy * [-1, 1]), (image[::-1], [0, 23] + xy * [1, -1]), (image.T, xy[:, ::-1]),
            (np.pad(image, 3)[3:-3, 3:-3], xy),
        ):  # fmt: skip
            np.testing.assert_allclose(
                interpolate_image(other, there, interpolation=interpolation), got, atol=1e-5, equal_nan=True
            )


@LAW
@given(SEEDS)
def test_section_of_a_closed_body_is_closed_and_in_the_plane(seed):
    rng = np.random.default_rng(seed)
    mesh = [sphere(14), box(3)][seed % 2]
    point, normal = rng.uniform(-0.5, 0.5, 3), rng.normal(size=3)
    cut = section(mesh, point, normal)
    assert cut.closed.tolist() == [True]
    np.testing.assert_allclose((cut.xyz - point) @ normal, 0, atol=1e-12)
    assert cut.arc[-1] > 2 * np.sqrt(np.pi) * 0.5
