"""Small files that ask for much: sizes are held against the bytes that are there before memory is asked for."""

from __future__ import annotations

import struct
import tracemalloc
import zlib

import h5py
import numpy as np
import pytest

from windmark import io
from windmark.io import FileError

# --- numbers in text


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.tri", "200000000 100000000 600000000*0.5 300000000*1"),
        ("a.xyz", "1 200000000 3 1 1800000000*1.5"),
        ("a.dat", 'VARIABLES = "x" "y" "z"\nZONE I=200000000, J=3, K=1, DATAPACKING=POINT\n1800000000*1.5\n'),
    ],
)
def test_repeat_counts_are_no_surface(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    with pytest.raises(FileError, match=r"the repeat counts stand for .* numbers, in .* bytes; expected at most 16"):
        io.read_mesh(tmp_path / name)


def test_repeat_counts_of_real_grids_are_read(tmp_path):
    """A flat grid: z and IBLANK are one word each."""
    x, y = np.meshgrid(np.arange(350.0), np.arange(450.0))
    words = " ".join(f"{v:g}" for v in [*x.ravel(), *y.ravel()])
    (tmp_path / "a.xyz").write_text(f"1\n350 450 1\n{words} {x.size}*0.0 {x.size}*1\n")
    assert len(io.read_mesh(tmp_path / "a.xyz").vertices) == x.size


def test_long_texts_are_read_in_pieces(tmp_path, make_mesh):
    mesh = make_mesh([(300, 400, 1)], single=False)
    io.write_mesh(tmp_path / "a.tri", mesh)
    assert (tmp_path / "a.tri").stat().st_size > 2 * 2**22  # of several pieces
    np.testing.assert_array_equal(io.read_mesh(tmp_path / "a.tri").vertices, mesh.vertices)
    lines = (tmp_path / "a.tri").read_text().splitlines()
    lines[100_000] = "1 2 x3"
    (tmp_path / "a.tri").write_text("\n".join(lines))
    with pytest.raises(FileError, match=r"line 100001: expected a number, got 'x3'"):
        io.read_mesh(tmp_path / "a.tri")


def peak(read, path):
    """Bytes that reading takes at most, the file's own text included, beside what stays loaded of the first time."""
    read(path)
    tracemalloc.start()
    try:
        read(path)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.slow
def test_an_obj_takes_a_few_times_what_it_holds(tmp_path, make_mesh):
    mesh = make_mesh([(180, 180, 1)], single=False)
    io.write_mesh(tmp_path / "a.obj", mesh)
    assert peak(io.read_mesh, tmp_path / "a.obj") < 10 * (mesh.vertices.nbytes + mesh.triangles.nbytes)


def test_a_table_takes_a_few_times_what_it_holds(tmp_path):
    rows = 28_000
    io.write_table(tmp_path / "a.csv", {"polygon": np.arange(rows) // 1000, "x": np.arange(rows), "y": np.arange(rows)})

    def read(path):
        table = io.read_table(path, required=(), known=None)
        return [table.numbers(column) for column in table.columns]

    assert peak(read, tmp_path / "a.csv") < 10 * rows * 3 * 8


# --- packed pictures


def tiff(width, height, strip, *, compression=8):
    """A page of 8-bit grey in one strip."""
    tags = [(256, 4, width), (257, 4, height), (258, 3, 8), (259, 3, compression), (262, 3, 1), (273, 4, 8),
            (277, 3, 1), (278, 4, height), (279, 4, len(strip))]  # fmt: skip
    table = b"".join(struct.pack("<HHII", tag, kind, 1, value) for tag, kind, value in tags)
    return b"II*\0" + struct.pack("<I", 8 + len(strip)) + strip + struct.pack("<H", len(tags)) + table + bytes(4)


def zeros(mib):
    """Deflated, piece by piece."""
    stream = zlib.compressobj(1)
    return b"".join([*(stream.compress(bytes(2**20)) for _ in range(mib)), stream.flush()])


@pytest.mark.parametrize("compression", [8, 5])
def test_pictures_packed_beyond_belief(tmp_path, compression):
    (tmp_path / "a.tif").write_bytes(tiff(60_000, 30_000, bytes(250_000), compression=compression))
    with pytest.raises(FileError, match=r"1717 MiB are to come from 0.239 MiB; expected at most 100 times as much"):
        io.read_image(tmp_path / "a.tif")


def test_a_strip_that_holds_more_than_its_page(tmp_path):
    """The page says 10,000 pixels; its strip unpacks to 600 MiB."""
    content = zeros(600)
    assert len(content) < 4e6
    (tmp_path / "a.tif").write_bytes(tiff(100, 100, content))
    with pytest.raises(FileError, match=r"a part of a page unpacks to more than the page's 10000 bytes"):
        io.read_image(tmp_path / "a.tif")


def test_masks_may_be_packed_well(tmp_path):
    (tmp_path / "a.tif").write_bytes(tiff(20_000, 5_000, zlib.compress(bytes(100_000_000), 1)))
    assert io.read_image(tmp_path / "a.tif").shape == (5_000, 20_000)


def test_hdf5_chunks_beyond_belief(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        images = file.create_dataset("images", (3, 40_000, 40_000), "u1", chunks=(1, 40_000, 40_000), compression=1)
        images.id.write_direct_chunk((0, 0, 0), bytes(1000))
    with pytest.raises(FileError, match=r"images: damaged, or packed beyond belief: 1526 MiB"):
        io.frames(tmp_path / "a.h5")


# --- names


LONG = "x" * 5000
MESH = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
FACET = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.obj", f"{MESH}g {LONG}\nf 1 2 3\n"),
        ("a.stl", f"solid {LONG[:3000]}\n{FACET}endsolid\n"),
        ("a.dat", f'VARIABLES = "x" "y" "z"\nZONE T="{LONG}", I=2, J=2, DATAPACKING=POINT\n' + "0 0 0 " * 4),
    ],
)
def test_names_of_parts_are_names(tmp_path, name, text):
    """As an array each triangle would take as much memory as the longest name."""
    (tmp_path / name).write_text(text)
    with pytest.raises(FileError, match=r"line \d+: the name 'xxx.* characters; expected at most 256"):
        io.read_mesh(tmp_path / name)


def test_names_of_markers_are_names(tmp_path):
    (tmp_path / "a.csv").write_text(f'name,x,y,z\na,1,2,3\n"b{LONG}",4,5,6\n')
    with pytest.raises(FileError, match=r"line 3: name begins 'bxxx.*' and has 5001 characters; expected at most 256"):
        io.read_markers(tmp_path / "a.csv")
    (tmp_path / "a.tgts").write_text(f"1 0 0 0 0 0 1 1 0 0 0 {LONG}\n")
    with pytest.raises(FileError, match=r"line 1: the name 'xxx.* has 5000 characters"):
        io.read_markers(tmp_path / "a.tgts")


def test_messages_stay_on_one_short_line(tmp_path):
    (tmp_path / "a.csv").write_text(f"name,{LONG},x,y,z\n")
    with pytest.raises(FileError, match=r"unknown column 'xxx") as error:
        io.read_markers(tmp_path / "a.csv")
    assert len(str(error.value)) < 1200
    assert "the columns are" in str(error.value) or "..." in str(error.value)


# --- work that grows with the file alone: with its square each of these took minutes


@pytest.mark.slow
def test_many_polygons(tmp_path):
    """Squares of one pixel on every second pixel of every second row."""
    rows = []
    for k in range(40_000):
        x, y = 2 * (k % 200), 2 * (k // 200)
        rows.append(
            f"p{k},{x - 0.5},{y - 0.5}\np{k},{x + 0.5},{y - 0.5}\np{k},{x + 0.5},{y + 0.5}\np{k},{x - 0.5},{y + 0.5}\n"
        )
    (tmp_path / "a.csv").write_text("polygon,x,y\n" + "".join(rows))
    mask = io.read_mask(tmp_path / "a.csv", (400, 400))
    assert mask[::2, ::2].all()
    assert mask.sum() == 40_000


@pytest.mark.slow
def test_many_frames_in_a_table(tmp_path):
    (tmp_path / "a.csv").write_text("image,x,y\n" + "".join(f"i{k % 30_000},{k},1\n" for k in range(60_000)))
    found = io.read_detections(tmp_path / "a.csv")
    assert len(found) == 30_000
    assert found["i7"].xy[:, 0].tolist() == [7, 30_007]


@pytest.mark.slow
def test_many_columns_and_modes(tmp_path):
    more = ",".join(f"c{k}" for k in range(60_000))
    (tmp_path / "a.csv").write_text(f"name,x,y,z,{more}\na,1,2,3{',1' * 60_000}\n")
    assert io.read_points(tmp_path / "a.csv").xyz.tolist() == [[1, 2, 3]]
    columns = ",".join(f"dx_{k},dy_{k},dz_{k}" for k in range(1, 20_001))
    (tmp_path / "m.csv").write_text(f"x,y,z,{columns}\n1,2,3{',1' * 60_000}\n")
    assert io.read_modes(tmp_path / "m.csv")[1].shape == (1, 3, 20_000)


def test_whole_numbers_are_digits_and_few(tmp_path):
    """Python takes "²" for a digit, and no more than 4,300 of them for a number."""
    for number in ("²", "9" * 5000):
        (tmp_path / "cameras.txt").write_text(f"1 PINHOLE {number} 480 500 500 320 240\n")
        with pytest.raises(FileError, match=r"expected CAMERA_ID MODEL WIDTH"):
            io.read_colmap(tmp_path)
    nines = "9" * 5000
    (tmp_path / "a.csv").write_text(f"x,y,z,dx_{nines},dy_1,dz_1\n1,2,3,4,5,6\n")
    with pytest.raises(FileError, match=r"no column 'dx_1'"):
        io.read_modes(tmp_path / "a.csv")
    (tmp_path / "a.dat").write_text(f'VARIABLES = "x" "y" "z"\nZONE I={nines}, J=2, DATAPACKING=POINT\n1 2 3\n')
    with pytest.raises(FileError, match=r"I is 9{40}; expected a whole number"):
        io.read_mesh(tmp_path / "a.dat")


@pytest.mark.parametrize("rest", ["_" * 200_000, "k=(" * 20_000])
def test_long_records_of_tecplot(tmp_path, rest):
    (tmp_path / "a.dat").write_text(f'VARIABLES = "x" "y" "z"\nZONE {rest}\n{rest}\n1 2 3\n')
    with pytest.raises(FileError):
        io.read_mesh(tmp_path / "a.dat")


def test_formats_that_name_things_twice_or_not_at_all(tmp_path):
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float {}\n"
    rest = "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
    (tmp_path / "a.ply").write_text(head.format("y") + rest)
    with pytest.raises(FileError, match=r"element vertex: 'y' is there more than once"):
        io.read_mesh(tmp_path / "a.ply")
    (tmp_path / "a.stl").write_text(f"\fsolid\f{FACET}")
    with pytest.raises(FileError, match=r"no line of that word"):
        io.read_mesh(tmp_path / "a.stl")
    for number in ("nan", "inf", "1.5"):
        (tmp_path / "a.tri").write_text(f"3 1\n0 0 0\n1 0 0\n0 1 0\n1 2 3\n{number}\n")
        with pytest.raises(FileError, match=r"triangle 1: its component is .*; expected a whole number"):
            io.read_mesh(tmp_path / "a.tri")


def test_many_keys_and_solids(tmp_path):
    (tmp_path / "a.json").write_text("{" + ",".join(f'"k{k}":1' for k in range(100_000)) + ',"k5":1}')
    with pytest.raises(FileError, match=r"key 'k5': the key is there more than once"):
        io.read_json(tmp_path / "a.json")
    (tmp_path / "a.stl").write_text("".join(f"solid s{k}\n{FACET}endsolid\n" for k in range(30_000)))
    assert len(io.read_mesh(tmp_path / "a.stl").triangles) == 30_000
