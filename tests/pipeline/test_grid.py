"""The grid as a job uses it: volumes by name, orientation."""

import numpy as np
import pytest

from windmark import io
from windmark.pipeline.grid import read_grid
from windmark.pipeline.project import GridEntry
from windmark.scene import Mesh


def box(turned=()):
    """A unit cube of 12 triangles, outward; ``turned`` triangles the other way round."""
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=float)
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    triangles = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    for k in turned:
        triangles[k] = triangles[k][::-1]
    return Mesh.make(corners, triangles)


def is_outward(mesh):
    """Whether every triangle of a box about (0.5, 0.5, 0.5) faces away from its middle."""
    middle = mesh.vertices[mesh.triangles].mean(axis=1) - 0.5
    return bool((np.einsum("tk,tk->t", mesh.triangle_normals(), middle) > 0).all())


@pytest.mark.parametrize("turned", [range(12), [4], [0, 5, 7]])
def test_auto_orientation_mends_what_is_turned(tmp_path, turned):
    io.write_mesh(tmp_path / "box.ply", box(turned))
    assert is_outward(read_grid(GridEntry(file=tmp_path / "box.ply")))
    assert not is_outward(read_grid(GridEntry(file=tmp_path / "box.ply", orientation="file")))


def test_zones_become_volumes_and_the_rest_drops_out(virtual_test):
    folder, test = virtual_test
    grid = folder / "model.grid"
    mesh = read_grid(GridEntry(file=grid, volumes={"wing": ("zone01", "zone02"), "body": ("zone04",)}))
    assert set(mesh.volume) == {"wing", "body"}
    np.testing.assert_allclose(mesh.vertices, test.mesh.vertices, rtol=1e-6)
    assert len(mesh.triangles) < len(test.mesh.triangles)
    with pytest.raises(io.FileError, match=r"model\.grid.*zone77.*zone01"):
        read_grid(GridEntry(file=grid, volumes={"wing": ("zone77",)}))
