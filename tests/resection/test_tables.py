"""What nodes and points are as tables: the same numbers under their names; the obliquity at its ends."""

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.resection import sample_points, see_nodes
from windmark.resection.visibility import _obliquity_deg
from windmark.scene import Mesh

SQUARE = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.2], [1.0, 1.0, 0.3], [-1.0, 1.0, 0.1], [0.0, 0.0, -9.0]])
MESH = Mesh.make(SQUARE, [[0, 1, 2], [0, 2, 3]], volume=np.array(["left", "right"]))
CAMERA, ABOVE = Camera((16, 12), 40.0, 1.0, 7.5, 5.5), Pose.look_at([0.5, 0, 10.0], [0, 0, 0], [0, 1.0, 0])


def test_nodes_and_points_as_tables():
    pytest.importorskip("pandas")
    view = see_nodes(MESH, CAMERA, ABOVE)
    table = view.to_pandas()
    np.testing.assert_array_equal(table[["x", "y"]], view.xy)
    y, x = np.mgrid[:12, :16]
    found = sample_points(100.0 + 3 * x + 5.0 * y, CAMERA, ABOVE, MESH, [[0.1, 0.05, 0.1625], [0.3, -0.2, 0.17]])
    points = found.to_pandas()
    np.testing.assert_array_equal(points["value"], found.value)
    np.testing.assert_array_equal(points[["x_px", "y_px"]], found.xy)
    np.testing.assert_array_equal(points[["x", "y", "z"]], found.xyz)
    assert found.xy[0, 0] > 5 > found.xyz[0, 0]


def test_obliquity_is_nought_face_on_a_right_angle_edge_on_and_unknown_without_a_normal():
    cam, normals = (
        np.tile([0.0, 0.0, 5.0], (5, 1)),
        np.array([[0.0, 0, -2], [0, 0, 2], [3, 0, 0], [0, 0, 0], [1, 0, -1]]),
    )
    np.testing.assert_allclose(_obliquity_deg(normals, cam, False), [0, 180, 90, np.nan, 45])
    np.testing.assert_allclose(_obliquity_deg(normals, cam, True), [0, 0, 90, np.nan, 45])
