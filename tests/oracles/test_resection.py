"""Resection against independent answers: analytic bodies, brute force, VTK, SciPy, OpenCV."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from windmark.geometry import Camera
from windmark.resection import interpolate_image, map_pixels, see_nodes
from windmark.resection.reasons import HIDDEN, VISIBLE

sys.path.insert(0, str(Path(__file__).parents[1] / "resection"))
from resection_shapes import (
    box,
    brute_first_hits,
    brute_hidden,
    joined,
    lens_camera,
    looking_at,
    pixel_grid,
    plate,
    soup,
    sphere,
)


def test_brute_force_rays_through_a_soup():
    rng = np.random.default_rng(5)
    mesh, camera, pose = soup(rng, 400, size=0.15), lens_camera((50, 36), 40.0), looking_at([1.5, 1.0, 2.0])
    got = map_pixels(mesh, camera, pose)
    rays = camera.unproject(pixel_grid(camera)).reshape(-1, 3)[:, :2]
    triangle, depth = brute_first_hits(pose.apply(mesh.vertices), mesh.triangles, rays)
    np.testing.assert_array_equal(got.triangle.ravel(), triangle)
    np.testing.assert_allclose(np.nan_to_num(got.depth().ravel(), nan=np.inf), depth, rtol=1e-10)
    assert len(np.unique(triangle)) > 150


def test_fine_globe_tends_to_the_analytic_sphere():
    camera, pose = lens_camera((80, 60), 70.0), looking_at([2.5, 1.0, 1.5])
    rays = camera.unproject(pixel_grid(camera)) @ pose.rotation
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    along = rays @ pose.center
    root = along**2 - pose.center @ pose.center + 1
    inside = root > 0
    point = pose.center - rays * (along + np.sqrt(np.where(inside, root, 0)))[..., None]
    worst = []
    for n in (40, 80, 160):
        got = map_pixels(sphere(n), camera, pose)
        # The polyhedron lies inside the sphere and within its sagitta.
        assert not got.valid[~inside].any()
        well = inside & (root > 4 * (np.pi / n) ** 2)
        assert got.valid[well].all()
        worst.append(np.linalg.norm(got.xyz() - point, axis=-1)[well & (root > 0.2)].max())
    assert worst[0] / worst[1] == pytest.approx(4, rel=0.35)
    assert worst[1] / worst[2] == pytest.approx(4, rel=0.35)


def test_vtk_rays_agree():
    pyvista = pytest.importorskip("pyvista")
    mesh = joined(plate(13, 11, size=(3.0, 2.5)), sphere(30, radius=0.6, center=(0.2, 0.1, 0.7)))
    camera, pose = lens_camera((60, 44), 50.0), looking_at([2.0, -1.5, 2.5])
    got = map_pixels(mesh, camera, pose)
    surface = pyvista.PolyData.from_regular_faces(mesh.vertices, mesh.triangles)
    xyz, rng, hits = got.xyz(), np.random.default_rng(0), 0
    directions = camera.unproject(pixel_grid(camera)) @ pose.rotation
    for row, column in rng.integers(0, [44, 60], (300, 2)):
        found, _ = surface.ray_trace(pose.center, pose.center + 20 * directions[row, column], first_point=True)
        assert (found.size > 0) == got.valid[row, column]
        if found.size:
            hits += 1
            np.testing.assert_allclose(found, xyz[row, column], atol=2e-5)  # VTK returns single precision
    assert 100 < hits < 290


def test_hidden_nodes_against_segments():
    # 2,000 nodes of a cluttered scene, each tested by its straight line to the camera.
    parts = [plate(31, 31), box(7, half=(0.3, 0.4, 0.5), center=(0.3, 0.2, 0.5)), sphere(28, 0.3, (-0.8, -0.6, 0.6))]
    mesh, eye = joined(*parts), [2.2, -1.6, 2.4]
    camera, pose = Camera((1200, 900), 700.0, k1=-0.05, k2=0.01), looking_at(eye)
    view = see_nodes(mesh, camera, pose, two_sided=True)
    tested = np.flatnonzero((view.reason == HIDDEN) | (view.reason == VISIBLE))
    # Nodes in one place (seams, the pole) hide each other for the segment test by rounding: leave them out,
    # the room's own tests of seams are for them.
    _, place = np.unique(mesh.vertices.round(9), axis=0, return_inverse=True)
    tested = tested[np.bincount(place)[place[tested]] == 1]
    want = brute_hidden(mesh, pose.center, tested, margin=1e-9)
    got = view.reason[tested] == HIDDEN
    assert len(tested) > 1200
    assert 0.1 < want.mean() < 0.6
    # Nodes at which something lies on the very surface (the box stands on the plate) depend on the tolerance.
    touching = np.abs(mesh.vertices[tested, 2]) < 1e-9
    np.testing.assert_array_equal(got[~touching], want[~touching])
    assert (got == want).mean() >= 0.999


def test_linear_interpolation_is_scipy_s():
    ndimage = pytest.importorskip("scipy.ndimage")
    rng = np.random.default_rng(3)
    image, xy = rng.normal(size=(40, 50)).astype(np.float32), rng.uniform(0, 39, (500, 2))
    want = ndimage.map_coordinates(image.astype(float), xy.T[::-1], order=1)
    np.testing.assert_allclose(interpolate_image(image, xy, interpolation="linear"), want, atol=1e-6)


def test_interpolation_is_opencv_s_to_its_quantisation():
    cv2 = pytest.importorskip("cv2")
    rng = np.random.default_rng(4)
    image = rng.normal(size=(40, 50)).astype(np.float32)
    # OpenCV rounds positions to 1/32 px; on those both must agree. Its cubic has a = -0.75, so only linear compares.
    xy = rng.integers(3 * 32, 36 * 32, (400, 2)) / 32.0
    x, y = (v.astype(np.float32)[:, None] for v in xy.T)
    want = cv2.remap(image, x, y, cv2.INTER_LINEAR)[:, 0]
    np.testing.assert_allclose(interpolate_image(image, xy, interpolation="linear"), want, atol=1e-5)


def test_cubic_has_the_error_of_its_order():
    # Keys: the error of a = -1/2 falls with the third power of the step, the linear one with the second.
    error = {}
    for interpolation in ("linear", "cubic"):
        for period in (12.0, 24.0):
            x, y = np.meshgrid(np.arange(60.0), np.arange(60.0))
            image = np.sin(2 * np.pi * x / period) * np.cos(2 * np.pi * y / period)
            xy = np.random.default_rng(1).uniform(5, 54, (2000, 2))
            truth = np.sin(2 * np.pi * xy[:, 0] / period) * np.cos(2 * np.pi * xy[:, 1] / period)
            error[interpolation, period] = np.abs(
                interpolate_image(image, xy, interpolation=interpolation) - truth
            ).max()
    assert error["linear", 12.0] / error["linear", 24.0] == pytest.approx(4, rel=0.2)
    assert error["cubic", 12.0] / error["cubic", 24.0] > 7
    assert error["cubic", 24.0] < 0.1 * error["linear", 24.0]
