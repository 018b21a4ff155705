"""NASA's surface grid: 14 zones, 309,062 nodes, read and written in every format that keeps its blocks."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from windmark.io import (
    Plot3dLayout,
    detect_plot3d,
    read_markers,
    read_mesh,
    read_nodes_netcdf,
    read_plot3d_function,
    read_tecplot,
    write_mesh,
    write_nodes_csv,
    write_nodes_netcdf,
    write_nodes_vtk,
    write_plot3d_function,
    write_tecplot,
)


@pytest.fixture(scope="module")
def grid_path(shared_data):
    return shared_data / "nasa-upsp-cam5" / "fml_tc3_volume.grid"


@pytest.fixture(scope="module")
def grid(grid_path):
    return read_mesh(grid_path)


@pytest.fixture(scope="module")
def fields(grid):
    cp = np.sin(grid.vertices @ [1.0, 2.0, 3.0]).astype(np.float32)
    return {"cp": np.where(grid.vertices[:, 2] > -6, np.float32(np.nan), cp)}


def test_the_grid_is_what_its_description_says(grid, grid_path):
    assert detect_plot3d(grid_path) == Plot3dLayout()
    assert (len(grid.blocks), len(grid.vertices)) == (14, 309062)
    assert grid.blanked is None
    assert set(grid.volume) == {f"zone{k:02d}" for k in range(1, 15)}
    plate = grid.vertices[grid.vertices[:, 2] <= -7]
    np.testing.assert_allclose(np.ptp(plate, axis=0)[:2], [37, 10], atol=0.5)
    raised = grid.vertices[grid.vertices[:, 2] > -7]
    np.testing.assert_allclose(raised.min(axis=0)[:2], [-6.5, -1], atol=0.06)
    np.testing.assert_allclose(raised.max(axis=0), [-5.5, 1, -5], atol=0.06)


def test_all_cells_have_an_area(grid):
    cells = sum((i - 1) * (j - 1) for i, j in (sorted(b.shape_ijk)[1:] for b in grid.blocks))
    assert len(grid.triangles) == 2 * cells
    assert (np.linalg.norm(grid.triangle_normals(), axis=1) > 0).all()


def test_every_target_is_near_a_node(grid, shared_data):
    markers = read_markers(shared_data / "nasa-upsp-cam5" / "fml_tc3_volume.tgts")
    distance, _ = cKDTree(grid.vertices).query(markers.xyz)
    assert len(markers) == 24
    assert distance.max() < 0.034


def test_written_as_plot3d_it_is_the_same_file(grid, grid_path, tmp_path):
    write_mesh(tmp_path / "a.grid", grid)
    assert (tmp_path / "a.grid").read_bytes() == grid_path.read_bytes()


@pytest.mark.parametrize("suffix", [".vtp", ".vtm", ".nc"])
def test_binary_formats_keep_the_mesh_exactly(grid, tmp_path, suffix):
    write_mesh(tmp_path / f"a{suffix}", grid, length_unit="in")
    got = read_mesh(tmp_path / f"a{suffix}")
    for name in ("vertices", "triangles", "volume"):
        np.testing.assert_array_equal(getattr(got, name), getattr(grid, name))
    assert got.blocks == grid.blocks


def test_stl_merges_the_seams(grid, tmp_path):
    write_mesh(tmp_path / "a.stl", grid)
    got = read_mesh(tmp_path / "a.stl")
    assert len(got.triangles) == len(grid.triangles)
    assert len(got.vertices) == 304566  # len(np.unique(grid.vertices, axis=0)), which takes seconds


def test_values_come_back_from_every_format(grid, fields, tmp_path):
    units = {"cp": "1", "length": "in"}
    write_plot3d_function(tmp_path / "a.f", grid, fields, units=units)
    write_tecplot(tmp_path / "a.dat", grid, fields, units=units)
    write_nodes_netcdf(tmp_path / "a.nc", grid, fields, units=units)
    write_nodes_csv(tmp_path / "a.csv", grid, fields, units=units)
    mesh, tecplot = read_tecplot(tmp_path / "a.dat")
    np.testing.assert_array_equal(mesh.vertices.astype(np.float32), grid.vertices)
    np.testing.assert_array_equal(mesh.triangles, grid.triangles)
    np.testing.assert_array_equal(tecplot["cp [1]"].astype(np.float32), fields["cp"])
    np.testing.assert_array_equal(read_plot3d_function(tmp_path / "a.f", grid)["cp [1]"], fields["cp"])
    np.testing.assert_array_equal(read_nodes_netcdf(tmp_path / "a.nc")[1]["cp"], fields["cp"])
    lines = (tmp_path / "a.csv").read_text().splitlines()
    assert lines[0] == "node,block,i,j,k,x [in],y [in],z [in],cp [1]"
    last = [np.float32(cell) for cell in lines[-1].split(",")[5:]]
    assert lines[-1].startswith("309061,zone14,740,200,0,")
    np.testing.assert_array_equal(last, [*grid.vertices[-1].astype(np.float32), fields["cp"][-1]])


def test_paraview_opens_the_results(grid, fields, tmp_path):
    pyvista = pytest.importorskip("pyvista")
    write_nodes_vtk(tmp_path / "a.vtp", grid, fields)
    write_nodes_vtk(tmp_path / "a.vtm", grid, fields)
    surface = pyvista.read(tmp_path / "a.vtp")
    np.testing.assert_array_equal(surface["cp"], fields["cp"])
    np.testing.assert_array_equal(surface.points, grid.vertices)
    pieces = pyvista.read(tmp_path / "a.vtm")
    assert pieces.keys() == [b.name for b in grid.blocks]
    np.testing.assert_array_equal(np.concatenate([p["cp"] for p in pieces]), fields["cp"])
