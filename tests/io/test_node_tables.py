"""Values per node as CSV and NetCDF, and the choice of reader and writer by name and content."""

from __future__ import annotations

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
import xarray

from windmark.io import FileError, read_mesh, read_nodes_netcdf, write_mesh, write_nodes_csv, write_nodes_netcdf


def values(mesh, seed=0):
    rng = np.random.default_rng(seed)
    cp = rng.normal(size=len(mesh.vertices)).astype(np.float32)
    cp[::4] = np.nan
    return {"cp": cp, "p": rng.uniform(9e4, 1.1e5, len(mesh.vertices))}


def test_csv_lines_are_nodes(tmp_path, make_mesh):
    mesh = make_mesh([(5, 4, 1), (1, 6, 3)], blanked=True)
    blocks = (replace(mesh.blocks[0], name='a, "b"'), mesh.blocks[1])
    mesh, fields = replace(mesh, blocks=blocks), values(mesh)
    write_nodes_csv(tmp_path / "a.csv", mesh, fields, units={"p": "Pa", "length": "in"})
    with open(tmp_path / "a.csv", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert list(rows[0]) == ["node", "block", "i", "j", "k", "x [in]", "y [in]", "z [in]", "blanked", "cp", "p [Pa]"]
    for n, row in enumerate(rows):
        block = blocks[n >= 20]
        i, j, k = (int(row[axis]) for axis in "ijk")
        ni, nj, _ = block.shape_ijk
        assert (int(row["node"]), row["block"]) == (n, block.name)
        assert block.first + i + ni * (j + nj * k) == n
        np.testing.assert_array_equal([np.float32(row[f"{axis} [in]"]) for axis in "xyz"], mesh.vertices[n])
        assert bool(int(row["blanked"])) == mesh.blanked[n]
        np.testing.assert_array_equal(np.float32(row["cp"]), fields["cp"][n])
        assert float(row["p [Pa]"]) == fields["p"][n]
    assert rows[0]["cp"] == "nan"


def test_csv_without_blocks(tmp_path, shell):
    write_nodes_csv(tmp_path / "a.csv", shell, values(shell))
    table = np.genfromtxt(tmp_path / "a.csv", delimiter=",", names=True)
    assert table.dtype.names == ("node", "x", "y", "z", "cp", "p")
    np.testing.assert_array_equal(table["y"], shell.vertices[:, 1])
    np.testing.assert_array_equal(table["cp"].astype(np.float32), values(shell)["cp"])


@pytest.mark.parametrize("kind", ["blocks", "blanked", "shell"])
def test_netcdf_keeps_everything(tmp_path, make_mesh, shell, kind):
    mesh = shell if kind == "shell" else make_mesh([(5, 4, 1), (1, 6, 3)], blanked=kind == "blanked", single=False)
    units, history = {"p": "Pa", "length": "mm"}, {"options": {"radius_px": 3.0, "names": ["a"]}, "date": "2024-05-01"}
    write_nodes_netcdf(tmp_path / "a.nc", mesh, values(mesh), units=units, history=history)
    got, fields, got_units, got_history = read_nodes_netcdf(tmp_path / "a.nc")
    for name in ("vertices", "triangles", "volume", "blanked"):
        np.testing.assert_array_equal(getattr(got, name), getattr(mesh, name))
    assert got.blocks == mesh.blocks
    assert (got_units, got_history) == (units, history)
    for name, given in values(mesh).items():
        np.testing.assert_array_equal(fields[name], given)
        assert fields[name].dtype == given.dtype
    np.testing.assert_array_equal(read_mesh(tmp_path / "a.nc", volumes="model").volume, "model")


def test_netcdf_says_what_it_holds(tmp_path, blocks):
    write_nodes_netcdf(tmp_path / "a.nc", blocks, values(blocks), units={"p": "Pa", "length": "in"}, history={"run": 7})
    with xarray.open_dataset(tmp_path / "a.nc", engine="h5netcdf") as data:
        assert data["cp"].dims == ("node",)
        assert data["vertices"].dims == ("node", "component")
        assert data["p"].attrs["units"] == "Pa"
        assert data["vertices"].attrs["units"] == data.attrs["length_unit"] == "in"
        assert data.attrs["source"].startswith("windmark ")
        assert json.loads(data.attrs["history"]) == {"run": 7}
        assert "NaN where the node has none" in data.attrs["conventions"]
        assert data["block"].values.tolist() == ["zone01", "zone02", "zone03"]
        assert data["block_shape"].values.tolist() == [[5, 4, 1], [1, 6, 3], [4, 1, 7]]


def test_netcdf_refuses_what_it_cannot_hold(tmp_path, blocks):
    with pytest.raises(ValueError, match="slash"):
        write_nodes_netcdf(tmp_path / "a.nc", blocks, {"x/c": np.zeros(66)})
    with pytest.raises(ValueError, match="used by the file format"):
        write_nodes_netcdf(tmp_path / "a.nc", blocks, {"Triangles": np.zeros(66)})
    for history in ({"a": object()}, {"a": float("nan")}):
        with pytest.raises(ValueError, match=r"history: .*expected what JSON can hold"):
            write_nodes_netcdf(tmp_path / "a.nc", blocks, history=history)
    assert not list(tmp_path.iterdir())


def test_damaged_netcdf(tmp_path, blocks):
    write_nodes_netcdf(tmp_path / "a.nc", blocks, values(blocks))
    raw = (tmp_path / "a.nc").read_bytes()
    for content in (b"", b"text", raw[: len(raw) // 2], raw[:8] + bytes(5000)):
        (tmp_path / "b.nc").write_bytes(content)
        with pytest.raises(FileError, match="expected a NetCDF file of node values"):
            read_mesh(tmp_path / "b.nc")
    xarray.Dataset({"a": ("n", [1, 2])}).to_netcdf(tmp_path / "b.nc", engine="h5netcdf")
    with pytest.raises(FileError, match="expected a NetCDF file of node values"):
        read_mesh(tmp_path / "b.nc")


@pytest.mark.parametrize("writer", [write_nodes_csv, write_nodes_netcdf])
def test_nothing_appears_on_a_full_disk(tmp_path, make_mesh, full_disk, writer):
    mesh = make_mesh([(40, 30, 1)])
    with full_disk(5000), pytest.raises(FileError, match="cannot be written"):
        writer(tmp_path / "a.out", mesh, values(mesh))
    assert not list(tmp_path.iterdir())


# --- read_mesh and write_mesh


@pytest.mark.parametrize("suffix", [".grid", ".x", ".xyz", ".g", ".p3d", ".dat", ".tec", ".vtp", ".vtm", ".nc"])
def test_formats_that_keep_blocks(tmp_path, blocks, suffix):
    write_mesh(tmp_path / f"a{suffix}", blocks, length_unit="in")
    got = read_mesh(tmp_path / f"a{suffix}")
    np.testing.assert_allclose(got.vertices, blocks.vertices, rtol=1e-8)
    np.testing.assert_array_equal(got.triangles, blocks.triangles)
    np.testing.assert_array_equal(got.volume, blocks.volume)
    assert got.blocks == blocks.blocks


@pytest.mark.parametrize("suffix", [".grid", ".dat", ".stl", ".nc"])
def test_the_content_tells_the_format_where_it_can(tmp_path, blocks, suffix):
    write_mesh(tmp_path / f"a{suffix}", blocks)
    (tmp_path / f"a{suffix}").rename(tmp_path / "surface")
    if suffix == ".stl":
        (tmp_path / "surface").rename(tmp_path / "surface.STL")
        assert len(read_mesh(tmp_path / "surface.STL").triangles) == len(blocks.triangles)
    else:
        assert read_mesh(tmp_path / "surface").blocks == blocks.blocks


def test_options_and_names_that_do_not_fit(tmp_path, blocks):
    with pytest.raises(ValueError, match=r"must end in one of .*'\.vtp'"):
        write_mesh(tmp_path / "a.iges", blocks)
    write_mesh(tmp_path / "a.vtp", blocks)
    with pytest.raises(ValueError, match="volume_face: is for PLOT3D"):
        read_mesh(tmp_path / "a.vtp", volume_face="kmin")
    with pytest.raises(ValueError, match="volumes: the file has no"):
        read_mesh(tmp_path / "a.vtp", volumes={"wing": "w"})


def test_a_vtk_file_under_another_name_says_so(tmp_path, blocks):
    write_mesh(tmp_path / "a.vtp", blocks)
    (tmp_path / "a.vtp").rename(tmp_path / "a.grid")
    with pytest.raises(FileError, match="looks like a VTK file"):
        read_mesh(tmp_path / "a.grid")


def test_plot3d_text_under_the_name_of_tecplot(tmp_path):
    (tmp_path / "a.dat").write_text("1\n2 2 1\n0 1 0 1\n0 0 1 1\n0 0 0 0.5\n")
    assert len(read_mesh(tmp_path / "a.dat").triangles) == 2
