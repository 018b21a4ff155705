"""AIAA 2005-5007, section III.D: what the paper says of resection, on scenes with known truth."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from windmark.geometry import Camera, Pose, PoV
from windmark.resection import map_pixels, sample, sample_line, silhouette, virtual_image
from windmark.scene import Mesh, structured_triangles

sys.path.insert(0, str(Path(__file__).parents[1] / "resection"))
from resection_shapes import joined, looking_at, plate, sphere


def wing(n=41):
    """A thick swept plate: curved in both directions, so that no 2D warp follows it."""
    s, t = np.meshgrid(np.linspace(-1, 1, n), np.linspace(-1, 1, n))
    xyz = np.stack([s + 0.4 * t, 1.5 * t, 0.5 * (1 - s * s) * (1.2 - t)], axis=-1)
    return Mesh.make(xyz.reshape(-1, 3), structured_triangles(n, n))


def paint(xyz):
    x, y, z = np.moveaxis(xyz, -1, 0)
    return 100 + 40 * np.sin(6 * x + 2 * z) * np.cos(5 * y)


def photograph(mesh, camera, pose):
    return np.nan_to_num(paint(map_pixels(mesh, camera, pose).xyz())).astype(np.float32)


CAMERA = Camera((200, 160), 190.0, k1=-0.08, k2=0.02)


def test_interpolation_on_the_projected_triangle_is_the_limit_of_ours():
    """ "A bilinear interpolation is done on the projected triangle to relate each pixel with a point on the model." """
    camera, pose = Camera((200, 160), 190.0), looking_at([1.0, -2.5, 2.0])
    gaps = []
    for n in (11, 21, 41):
        mesh = wing(n)
        pixel_map = map_pixels(mesh, camera, pose)
        corners, _ = camera.project(pose.apply(mesh.vertices))
        t = mesh.triangles[pixel_map.triangle[pixel_map.valid]]
        a, b, c = (corners[t[:, k]] for k in range(3))
        rows, columns = np.nonzero(pixel_map.valid)
        p = np.stack([columns, rows], axis=1) - a
        e, f = b - a, c - a
        area = e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0]
        w = (
            np.stack([p[:, 0] * f[:, 1] - p[:, 1] * f[:, 0], e[:, 0] * p[:, 1] - e[:, 1] * p[:, 0]], axis=1)
            / area[:, None]
        )
        v = mesh.vertices
        on_triangle = v[t[:, 0]] + w[:, :1] * (v[t[:, 1]] - v[t[:, 0]]) + w[:, 1:] * (v[t[:, 2]] - v[t[:, 0]])
        gaps.append(np.median(np.linalg.norm(on_triangle - pixel_map.xyz()[pixel_map.valid], axis=1)))
    # The paper's way ignores perspective within a triangle: an error with the square of its size, ours has none.
    assert gaps[0] / gaps[1] == pytest.approx(4, rel=0.3)
    assert gaps[1] / gaps[2] == pytest.approx(4, rel=0.3)


def test_virtual_images_compensate_the_motion_of_the_model():
    """ "All images are recomputed according to an unique PoV, which provides 3D image alignment." """
    mesh, reference = wing(), looking_at([0.8, -2.5, 3.0])
    moved = Pose.exp([0.06, -0.04, 0.05, 0.05, -0.03, 0.1]) @ reference
    off, on = photograph(mesh, CAMERA, reference), photograph(mesh, CAMERA, moved)
    pixel_map = map_pixels(mesh, CAMERA, reference)
    inner = pixel_map.valid & ~silhouette(pixel_map, width_px=3)
    on[silhouette(map_pixels(mesh, CAMERA, moved))] = np.nan
    aligned, valid = virtual_image(on, pixel_map, CAMERA, moved)
    use = valid & inner
    assert use.sum() > 0.9 * inner.sum()
    before, after = np.nanstd((on - off)[inner]), np.std((aligned - off)[use])
    assert before > 15
    assert after < 0.1
    # "For 3D models, a 3D method must be used": the best 2D warp (a homography) leaves much more.
    assert after < 0.1 * _after_best_homography(off, on, pixel_map, moved, inner)


def _after_best_homography(off, on, pixel_map, moved, inner):
    from windmark.resection import interpolate_image

    xyz = pixel_map.xyz()[inner]
    there, _ = CAMERA.project(moved.apply(xyz))
    rows, columns = np.nonzero(inner)
    x, y, one = columns / 100.0, rows / 100.0, np.ones(len(rows))
    u, v = there.T / 100.0
    zero = 0 * one
    a = np.concatenate([
        np.stack([x, y, one, zero, zero, zero, -u * x, -u * y], axis=1),
        np.stack([zero, zero, zero, x, y, one, -v * x, -v * y], axis=1),
    ])  # fmt: skip
    h = np.append(np.linalg.lstsq(a, np.concatenate([u, v]), rcond=None)[0], 1.0).reshape(3, 3)
    q = h @ np.stack([x, y, one])
    warped = interpolate_image(np.nan_to_num(on), 100 * (q[:2] / q[2]).T)
    return np.nanstd(warped - off[inner])


def test_views_according_to_a_perfect_pov():
    """ "They are often used to create views according to a perfect PoV as a top view." """
    mesh = plate(21, 21, size=(3.0, 2.4))
    oblique = looking_at([-1.5, -2.5, 2.5])
    top_camera = Camera((121, 97), 200.0)
    # The PoV that looks straight down from 5 units above: x to the right, y up in the picture.
    top = Pose.from_pov(PoV(180.0, 0.0, 0.0, 0.0, 0.0, 5.0))
    pixel_map = map_pixels(mesh, top_camera, top)
    got, valid = virtual_image(photograph(mesh, CAMERA, oblique), pixel_map, CAMERA, oblique)
    # 200 px / 5 units = 40 px per unit, without any perspective of the oblique view left.
    x, y = np.meshgrid((np.arange(121) - 60) / 40, (48 - np.arange(97)) / 40)
    truth = paint(np.stack([x, y, 0 * x], axis=-1))
    inner = valid & (np.abs(x) < 1.4) & (np.abs(y) < 1.1)
    assert inner.sum() > 0.8 * (pixel_map.valid & (np.abs(x) < 1.4) & (np.abs(y) < 1.1)).sum()
    assert np.abs(got - truth)[inner].max() < 2.0
    assert np.abs(got - truth)[inner].mean() < 0.15


def test_several_views_are_combined():
    """ "Virtual images can be used to combine several views." """
    mesh = joined(sphere(80))
    views = [looking_at([3.2 * np.cos(a), 3.2 * np.sin(a), 0.8]) for a in np.radians([-60, 0, 60])]
    pixel_map = map_pixels(mesh, CAMERA, looking_at([3.0, 0.0, 0.5]))
    drawn = []
    for pose in views:
        image = photograph(mesh, CAMERA, pose)
        image[silhouette(map_pixels(mesh, CAMERA, pose))] = np.nan
        drawn.append(virtual_image(image, pixel_map, CAMERA, pose, max_obliquity_deg=50))
    valid = np.stack([v for _, v in drawn])
    assert valid.any(axis=0).sum() > 1.2 * valid[1].sum()
    mean = np.nanmean(np.stack([g for g, _ in drawn])[:, valid.any(axis=0)], axis=0)
    truth = paint(pixel_map.xyz()[valid.any(axis=0)])
    assert np.sqrt(np.mean((mean - truth) ** 2)) < 0.2


def test_results_on_points_and_on_a_line():
    """ "If the results are required on a given point set or on a line, the image coordinates of the points are
    calculated and used to get the wanted information." """
    mesh, pose = wing(81), looking_at([0.8, -2.5, 3.0])
    image = photograph(mesh, CAMERA, pose)
    image[silhouette(map_pixels(mesh, CAMERA, pose))] = np.nan
    taps = mesh.vertices[np.random.default_rng(0).choice(len(mesh.vertices), 200)]
    values = sample(image, CAMERA, pose, taps, mesh=mesh)
    known = np.isfinite(values)
    assert known.sum() > 100
    error = np.abs(values - paint(taps))[known]
    assert np.median(error) < 0.05
    assert error.max() < 4.0  # of +-40: next to the outline a pixel spans much of the pattern
    # The chord at a span station, y = 0.3.
    chord = sample_line(image, CAMERA, pose, mesh, [-0.7, 0.3, 0.3], [0.9, 0.3, 0.2], n=120)
    np.testing.assert_allclose(chord.xyz[:, 1], 0.3, atol=0.15)
    seen = np.isfinite(chord.values)
    assert seen.mean() > 0.8
    assert np.sqrt(np.mean((chord.values - paint(chord.xyz))[seen] ** 2)) < 0.5  # of +-40
