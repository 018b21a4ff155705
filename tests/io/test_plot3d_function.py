"""PLOT3D function files and their names."""

from __future__ import annotations

import itertools
import struct

import numpy as np
import pytest

from windmark.io import FileError, Plot3dLayout, detect_plot3d, read_plot3d_function, write_plot3d_function

LAYOUTS = [Plot3dLayout(False, o, m, "whole", r) for o, m, r in itertools.product("<>", (0, 4, 8), (4, 8))]
LAYOUTS += [Plot3dLayout(text=True), Plot3dLayout(text=True, real_bytes=8)]


def values(mesh, seed=0, dtype=np.float32):
    rng = np.random.default_rng(seed)
    cp = rng.normal(size=len(mesh.vertices)).astype(dtype)
    cp[::4] = np.nan
    return {"cp": cp, "p": rng.uniform(9e4, 1.1e5, len(mesh.vertices)).astype(dtype)}


@pytest.mark.parametrize("layout", LAYOUTS, ids=lambda x: x.words)
def test_round_trip_in_every_layout(tmp_path, blocks, layout):
    fields = values(blocks, dtype=np.float32 if layout.real_bytes == 4 else np.float64)
    write_plot3d_function(tmp_path / "a.f", blocks, fields, units={"p": "Pa", "length": "in"}, layout=layout)
    got = read_plot3d_function(tmp_path / "a.f", blocks)
    assert list(got) == ["cp", "p [Pa]"]
    for given, back in zip(fields.values(), got.values(), strict=True):
        np.testing.assert_array_equal(back.astype(given.dtype), given)
    if not layout.text:
        assert detect_plot3d(tmp_path / "a.f", "function") == layout


def test_the_default_file_byte_by_byte(tmp_path, make_mesh):
    mesh = make_mesh([(2, 1, 1), (1, 3, 1)])
    write_plot3d_function(tmp_path / "q.fun", mesh, {"a": [1, 2, 3, 4, 5], "b": [6.0, 7, 8, 9, np.nan]})

    def record(fmt, *numbers):
        payload = struct.pack("<" + fmt, *numbers)
        return struct.pack("<i", len(payload)) + payload + struct.pack("<i", len(payload))

    wanted = record("i", 2) + record("8i", 2, 1, 1, 2, 1, 3, 1, 2)
    wanted += record("4f", 1, 2, 6, 7) + record("6f", 3, 4, 5, 8, 9, np.float32(np.nan))
    assert (tmp_path / "q.fun").read_bytes() == wanted
    assert (tmp_path / "q.nam").read_text() == "a\nb\n"


def test_a_fill_value_instead_of_nan(tmp_path, blocks):
    fields = values(blocks)
    write_plot3d_function(tmp_path / "a.f", blocks, fields, fill=-99.0)
    got = read_plot3d_function(tmp_path / "a.f")
    np.testing.assert_array_equal(got["cp"], np.where(np.isnan(fields["cp"]), np.float32(-99), fields["cp"]))
    fields["cp"][1] = -99
    with pytest.raises(ValueError, match=r"fill: -99.0 is a value of 'cp'"):
        write_plot3d_function(tmp_path / "a.f", blocks, fields, fill=-99.0)


def test_the_layout_of_a_grid_may_be_given(tmp_path, blocks):
    grid = Plot3dLayout(byte_order=">", record_mark=8, records="component", iblank=True)
    write_plot3d_function(tmp_path / "a.f", blocks, values(blocks), layout=grid)
    assert detect_plot3d(tmp_path / "a.f", "function") == Plot3dLayout(byte_order=">", record_mark=8)


def test_names_are_optional_but_must_be_right(tmp_path, blocks):
    write_plot3d_function(tmp_path / "a.f", blocks, values(blocks))
    (tmp_path / "a.nam").write_text("cp\n\n")
    with pytest.raises(FileError, match=r"a.nam: 1 names; expected 2 different ones"):
        read_plot3d_function(tmp_path / "a.f")
    (tmp_path / "a.nam").unlink()
    assert list(read_plot3d_function(tmp_path / "a.f")) == ["f1", "f2"]


def test_files_that_are_not_of_this_grid(tmp_path, blocks, make_mesh):
    write_plot3d_function(tmp_path / "a.f", blocks, values(blocks))
    with pytest.raises(FileError, match=r"block 2 of 3: \(1, 6, 3\) nodes; expected the mesh's \(1, 3, 6\)"):
        read_plot3d_function(tmp_path / "a.f", make_mesh([(5, 4, 1), (1, 3, 6), (4, 1, 7)]))
    with pytest.raises(FileError, match="3 blocks; expected the mesh's 1"):
        read_plot3d_function(tmp_path / "a.f", make_mesh([(5, 4, 1)]))
    raw = (tmp_path / "a.f").read_bytes()
    (tmp_path / "a.f").write_bytes(raw[:-3])
    with pytest.raises(FileError, match=r"block 3 of 3 .*expected a record of 224 bytes .* the file ends at"):
        read_plot3d_function(tmp_path / "a.f")


def test_what_cannot_be_written(tmp_path, blocks, shell):
    with pytest.raises(ValueError, match="needs structured blocks"):
        write_plot3d_function(tmp_path / "a.f", shell, {"cp": np.zeros(len(shell.vertices))})
    with pytest.raises(ValueError, match="at least one"):
        write_plot3d_function(tmp_path / "a.f", blocks, {})
    with pytest.raises(ValueError, match=r"must not end in \.nam"):
        write_plot3d_function(tmp_path / "a.nam", blocks, values(blocks))
    assert not list(tmp_path.iterdir())


def test_neither_file_appears_on_a_full_disk(tmp_path, make_mesh, full_disk):
    mesh = make_mesh([(40, 30, 1)])
    with full_disk(3000), pytest.raises(FileError, match="cannot be written"):
        write_plot3d_function(tmp_path / "a.f", mesh, values(mesh))
    assert not list(tmp_path.iterdir())
