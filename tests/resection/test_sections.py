"""Cuts of the mesh and profiles along them."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from windmark.geometry import Camera
from windmark.resection import map_pixels, sample_line, section, surface_line
from windmark.resection.chains import chain_segments, weld
from windmark.scene import Mesh

sys.path.insert(0, str(Path(__file__).parent))
from resection_shapes import box, joined, looking_at, moved, plate, sphere


def rebuilt(mesh, cut):
    """The section's points from their triangles and weights."""
    a, b, c = (mesh.vertices[mesh.triangles[cut.triangle, k]] for k in range(3))
    return a + cut.barycentric[:, :1] * (b - a) + cut.barycentric[:, 1:] * (c - a)


def signed_area(points, normal):
    p = points - points[0]
    return 0.5 * np.cross(p[:-1], p[1:]).sum(axis=0) @ normal


@pytest.mark.parametrize("spacing", [None, 0.05])
def test_box_of_six_blocks_is_one_closed_line(spacing):
    mesh = box(6, half=(1.0, 2.0, 3.0))
    normal = np.array([0.0, 0.0, 1.0])
    cut = section(mesh, [0, 0, 0.3], 5 * normal, spacing=spacing)
    assert cut.closed.tolist() == [True]
    np.testing.assert_array_equal(cut.xyz[0], cut.xyz[-1])
    np.testing.assert_allclose(cut.arc[-1], 12.0)
    np.testing.assert_allclose(cut.xyz[:, 2], 0.3, atol=1e-12)
    np.testing.assert_allclose(rebuilt(mesh, cut), cut.xyz, atol=1e-12)
    assert cut.barycentric.min() > -1e-12
    assert cut.barycentric.sum(axis=1).max() < 1 + 1e-12
    np.testing.assert_allclose(cut.xyz[0], [-1, -2, 0.3], atol=0.03 if spacing else 1e-12)
    if spacing is None:
        np.testing.assert_allclose(signed_area(cut.xyz, normal), 8.0)
    else:
        np.testing.assert_allclose(np.diff(cut.arc), 0.05)
        assert signed_area(cut.xyz, normal) > 7.9
    below = section(mesh, [0, 0, 0.3], -normal)
    assert signed_area(below.xyz, normal) < -7.9


def test_globe_is_cut_in_a_circle_and_two_in_two():
    one, two = sphere(90), sphere(90, radius=0.5, center=(3.0, 0, 0))
    cut = section(joined(two, one), [0, 0, 0.2], [0.1, 0.2, 1.0])
    assert cut.closed.tolist() == [True, True]
    first, second = cut.lines()
    assert cut.arc[first][-1] > cut.arc[second][-1]
    assert (cut.line[first] == 0).all()
    assert (cut.line[second] == 1).all()
    assert cut.xyz[first][:, 0].max() < 1.01
    n = np.array([0.1, 0.2, 1.0]) / np.sqrt(1.05)
    radius = np.sqrt(1 - (0.2 * n[2]) ** 2)
    np.testing.assert_allclose(cut.arc[first][-1], 2 * np.pi * radius, rtol=2e-3)
    np.testing.assert_allclose((cut.xyz[first] - [0, 0, 0.2]) @ n, 0, atol=1e-12)
    assert signed_area(cut.xyz[first], n) > 0


def test_open_sheet_cut_through_its_nodes():
    # The plane runs along a line of nodes, and along the common border of two blocks.
    left, right = plate(5, 5, size=(2.0, 2.0)), plate(5, 5, size=(2.0, 2.0))
    mesh = joined(left, moved(right, 0, 2.0, 0))
    for y in (0.5, 1.0, 1.5):
        cut = section(mesh, [0, y, 0], [0, 1, 0])
        assert cut.closed.tolist() == [False]
        np.testing.assert_allclose(cut.xyz[:, 0], np.linspace(-1, 1, 5), atol=1e-12)
        np.testing.assert_allclose(cut.arc, np.linspace(0, 2, 5), atol=1e-12)
        np.testing.assert_allclose(rebuilt(mesh, cut), cut.xyz, atol=1e-12)
    across = section(mesh, [0.3, 0, 0], [1, 0, 0])
    assert len(across.closed) == 1  # over the seam
    assert across.arc[-1] == pytest.approx(4.0)
    assert across.xyz[0, 1] == pytest.approx(-1.0)


def test_plane_that_misses_or_only_touches():
    for point, normal in (([0, 0, 5.0], [0, 0, 1]), ([0, 0, 0], [0, 0, 1])):
        cut = section(plate(), point, normal)
        assert not cut
        assert len(cut) == 0
        assert cut.lines() == []
    assert not section(Mesh.make(np.zeros((0, 3)), []), [0, 0, 0], [0, 0, 1])


def test_three_sheets_in_one_line_end_there():
    # Three half planes that meet in the z axis, cut square to it: three open lines from the middle.
    v = [
        [0, 0, -1],
        [0, 0, 1],
        [1, 0, -1],
        [1, 0, 1],
        [-0.5, 0.9, -1],
        [-0.5, 0.9, 1],
        [-0.5, -0.9, -1],
        [-0.5, -0.9, 1],
    ]
    t = [[0, 2, 3], [0, 3, 1], [0, 4, 5], [0, 5, 1], [0, 6, 7], [0, 7, 1]]
    cut = section(Mesh.make(v, t), [0, 0, 0.25], [0, 0, 1])
    assert cut.closed.tolist() == [False] * 3
    for part in cut.lines():
        assert (np.abs(cut.xyz[part][[0, -1], :2]).sum(axis=1) < 1e-12).sum() == 1


def test_chains_by_hand():
    lines = chain_segments(np.array([[1, 2], [5, 6], [2, 3], [2, 2], [3, 2], [0, 1], [7, 5], [6, 7]]))
    assert [p.tolist() for p, _ in lines] == [[3, 2, 1, 0], [5, 6, 7, 5]]
    assert [s.tolist() for _, s in lines] == [[2, 0, 5], [1, 7, 6]]
    number, xyz = weld(np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1e-7], [1, 1e-9, 0], [2.0, 0, 0]]), 1e-6)
    assert number.tolist() == [0, 1, 0, 1, 2]
    np.testing.assert_array_equal(xyz, [[0, 0, 0], [1, 0, 0], [2, 0, 0]])


def test_wrong_arguments():
    with pytest.raises(ValueError, match="normal"):
        section(plate(), [0, 0, 0], [0, 0, 0])
    with pytest.raises(ValueError, match="point"):
        section(plate(), [0, 0], [0, 0, 1])
    with pytest.raises(ValueError, match="spacing"):
        section(plate(), [0, 0, 0], [0, 1, 0], spacing=0)


class TestSampleLine:
    camera = Camera((200, 150), 160.0, k1=-0.04)

    def painted(self, mesh, pose):
        xyz = map_pixels(mesh, self.camera, pose).xyz()
        return np.nan_to_num(10 + xyz[..., 0] + 3 * xyz[..., 1] ** 2)

    def test_along_a_plate(self):
        mesh, pose = plate(9, 7), looking_at([0.3, -2.0, 3.5])
        start, end = [-1.2, -0.9, 0.0], [1.1, 0.8, 0.0]
        got = sample_line(self.painted(mesh, pose), self.camera, pose, mesh, start, end, n=50)
        np.testing.assert_allclose(got.xyz, np.linspace(start, end, 50), atol=1e-9)
        np.testing.assert_allclose(got.arc, np.linspace(0, np.hypot(2.3, 1.7), 50))
        assert got.view.visible.all()
        np.testing.assert_allclose(got.values, 10 + got.xyz[:, 0] + 3 * got.xyz[:, 1] ** 2, atol=2e-3)
        back = sample_line(self.painted(mesh, pose), self.camera, pose, mesh, end, start, n=50)
        np.testing.assert_allclose(back.values, got.values[::-1], atol=1e-5)
        assert len(surface_line(mesh, start, end).arc) == 200  # as of `sample_line`

    def test_over_the_edge_of_a_box_the_short_way(self):
        mesh, pose = box(9), looking_at([2.5, -2.0, 4.0])
        # From the top over the edge x = 1 down the side: 0.5 + 0.5 along the surface.
        got = sample_line(self.painted(mesh, pose), self.camera, pose, mesh, [0.5, 0.2, 1], [1, 0.2, 0.5], n=21)
        np.testing.assert_allclose(got.arc[-1], 1.0)
        np.testing.assert_allclose(got.xyz[10], [1, 0.2, 1], atol=1e-9)
        assert got.view.visible.all()
        # The other way round the box, from the top to the side that looks away.
        far = sample_line(self.painted(mesh, pose), self.camera, pose, mesh, [-0.5, 0.2, 1], [-1, 0.2, 0.5], n=21)
        np.testing.assert_allclose(far.arc[-1], 1.0)
        np.testing.assert_array_equal(np.isnan(far.values), far.xyz[:, 2] < 1 - 1e-9)

    def test_closed_section_is_left_at_its_seam(self):
        # The line's own first point is at least x: go from one side of it to the other.
        mesh, pose = sphere(72), looking_at([-4.0, 0.3, 0.2])
        a = np.radians(20)
        ends = [[-np.cos(a), -np.sin(a), 0.001], [-np.cos(a), np.sin(a), 0.001]]
        got = sample_line(self.painted(mesh, pose), self.camera, pose, mesh, *ends, normal=[0, 0, 1], n=31)
        np.testing.assert_allclose(got.arc[-1], np.radians(40), rtol=5e-3)
        np.testing.assert_allclose(got.xyz[0], ends[0], atol=5e-3)
        np.testing.assert_allclose(got.xyz[-1], ends[1], atol=5e-3)
        assert got.xyz[15, 0] == pytest.approx(-1, abs=5e-3)

    def test_wrong_arguments(self):
        mesh, pose = plate(), looking_at([0.3, -2.0, 3.5])
        image = np.zeros((150, 200))
        with pytest.raises(ValueError, match="differ"):
            sample_line(image, self.camera, pose, mesh, [0, 0, 0], [0, 0, 0])
        with pytest.raises(ValueError, match="plane"):
            sample_line(image, self.camera, pose, mesh, [0, 0, 0], [0, 0, 1])
        with pytest.raises(ValueError, match="at least 2"):
            sample_line(image, self.camera, pose, mesh, [0, 0, 0], [1, 0, 0], n=1)
        with pytest.raises(ValueError, match="does not meet"):
            sample_line(image, self.camera, pose, mesh, [0, 0, 5], [1, 0, 5], normal=[0, 0, 1])
        with pytest.raises(ValueError, match="no triangles"):
            sample_line(image, self.camera, pose, Mesh.make([[0, 0, 0]], []), [0, 0, 5], [1, 0, 5])
        with pytest.raises(ValueError, match="200 x 150"):
            sample_line(image.T, self.camera, pose, mesh, [0, 0, 0], [1, 0, 0])
