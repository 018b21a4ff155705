"""CSV: what is written comes back exactly, what is wrong is named with its line."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from windmark.io import FileError, read_table, write_table
from windmark.io.errors import LARGEST

COLUMNS = ("name", "x", "y")


def table(tmp_path, text, required=COLUMNS, known=COLUMNS):
    path = tmp_path / "table.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_table(path, required=required, known=known)


@pytest.mark.parametrize(
    "text",
    [
        "name,x,y\na,1,2\nb,3.5,-4e-2\n",
        "name,x,y\r\na,1,2\r\nb,3.5,-4e-2\r\n",
        "name,x,y\ra,1,2\rb,3.5,-4e-2",
        "\ufeffName;Y;X\na;2;1\nb;-4e-2;3.5",
        "# a comment\n\n X\tname\tY \n1\ta\t2\n  # another, with commas\n3.5\tb\t-4e-2\n\n",
        'name,x,y\n"a", "1",2\n b ,3.5 , -4e-2 \n',
        "name,x,y,,\na,1,2,,\nb,3.5,-4e-2,,\n,,,,\n",
    ],
)
def test_every_dialect_gives_the_same_table(tmp_path, text):
    t = table(tmp_path, text)
    assert t.text("name") == ["a", "b"]
    assert t.numbers("x").tolist() == [1.0, 3.5]
    assert t.numbers("y").tolist() == [2.0, -0.04]


def test_line_numbers_count_comments_and_quoted_line_ends(tmp_path):
    t = table(tmp_path, 'name,x,y\n# c\n"a\n# no comment",1,2\n\nb,1,2\n')
    assert t.text("name") == ["a\n# no comment", "b"]
    assert t.lines.tolist() == [3, 6]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the file is empty"),
        ("\n \n", "the file is empty"),
        ("# only\n# comments\n", "no header line; expected name,x,y"),
        ("a,1,2\n", "line 1: no column 'name'"),
        ("name,x\na,1\n", "line 1: no column 'y' in the header 'name,x'; the columns are name,x,y"),
        ("name,x,y,z\na,1,2,3\n", "line 1: unknown column 'z'; the columns are name,x,y"),
        ("name,x,y,X\na,1,2,3\n", "line 1: the column 'x' is there more than once"),
        ("name,x,,y\na,1,,2\n", "line 1: unknown column ''"),
        ("name,x,y\na,1\n", r"line 2: 2 values; expected 3 \(name, x, y\)"),
        ("name,x,y\n\na,1,2,3\n", "line 3: 4 values; expected 3"),
        ('name,x,y\n"a,1,2\n', "line 2: not a CSV row: unexpected end of data"),
        ('name,x,y\n"a"b,1,2\n', "line 2: not a CSV row"),
        (b"name,x,y\nd\xe9,1,2\n", "line 2: byte 0xe9 is not UTF-8"),
        (b"\x89PNG\r\n\x1a\n\0\0\0", "not a text file"),
    ],
)
def test_faults_are_named(tmp_path, text, message):
    with pytest.raises(FileError, match=message):
        table(tmp_path, text)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be"])
def test_utf_16_of_a_spreadsheet(tmp_path, encoding):
    """With its mark, "Unicode text" as it is exported: it was "not a text file"."""
    mark = {"utf-16": b"", "utf-16-le": b"\xff\xfe", "utf-16-be": b"\xfe\xff"}[encoding]
    t = table(tmp_path, mark + "name\tx\ty\nFlügel\t1\t2\n".encode(encoding))
    assert t.text("name") == ["Flügel"]
    assert t.numbers("y").tolist() == [2]
    with pytest.raises(FileError, match="begins as UTF-16 and is not"):
        table(tmp_path, b"\xff\xfe" + "name,x,y\n".encode("utf-16-le") + b"\x00\xd8\x01")


@pytest.mark.parametrize("first", ["sep=;", '"sep=;"', "SEP=;"])
def test_a_hint_to_spreadsheets_is_no_header(tmp_path, first):
    t = table(tmp_path, f"{first}\nname;x;y\na;1;2\n")
    assert t.numbers("x").tolist() == [1]
    assert t.lines.tolist() == [3]


@pytest.mark.parametrize("cell", ["", "nan", "inf", "-Infinity", "abc", "1.2.3", "1_000", "0x10", "--1", "1e999"])
def test_no_number(tmp_path, cell):
    t = table(tmp_path, f"name,x,y\na,1,2\nb,{cell},2\n")
    with pytest.raises(FileError, match=rf"line 3: x is '{cell}'; expected a finite number"):
        t.numbers("x")


@pytest.mark.parametrize("cell", ["1e19", "-1e300", "1000000000000000001000"])
def test_what_nothing_can_be_reckoned_with_is_no_number(tmp_path, cell):
    """Markers at 1e300 ended `markers check` in a fault, a normal of 1e300 in warnings of numpy."""
    t = table(tmp_path, f"name,x,y\na,1e18,2\nb,-1e18,{cell}\n")
    assert t.numbers("x").tolist() == [1e18, -1e18]
    with pytest.raises(FileError, match=rf"line 3: y is '{cell}'; expected a finite number of at most 1e\+18"):
        t.numbers("y", optional=True)


def test_decimal_comma_is_explained(tmp_path):
    t = table(tmp_path, "name;x;y\na;1,5;2\n")
    with pytest.raises(FileError, match="line 2: x is '1,5'; expected a finite number with a decimal point"):
        t.numbers("x")


def test_empty_cells_of_an_optional_column(tmp_path):
    t = table(tmp_path, "name,x,y\na,,NaN\nb,1,2\n")
    np.testing.assert_array_equal(t.numbers("x", optional=True), [np.nan, 1])
    np.testing.assert_array_equal(t.numbers("y", optional=True), [np.nan, 2])
    t = table(tmp_path, "name,x,y\na,inf,2\n")
    with pytest.raises(FileError, match="x is 'inf'"):
        t.numbers("x", optional=True)


def test_missing_file_and_folder(tmp_path):
    with pytest.raises(FileError, match=r"none\.csv: no such file"):
        read_table(tmp_path / "none.csv", required=COLUMNS, known=COLUMNS)
    with pytest.raises(FileError, match="this is a folder"):
        read_table(tmp_path, required=COLUMNS, known=COLUMNS)


words = st.text(st.characters(codec="utf-8", exclude_characters="\0"), min_size=1).filter(lambda s: s == s.strip())


@given(rows=st.lists(st.tuples(words, st.floats(-LARGEST, LARGEST) | st.just(np.nan), st.integers(-(2**62), 2**62))))
def test_round_trip_is_exact(one_folder, rows):
    path = one_folder / "t.csv"
    names, floats, ints = ([row[k] for row in rows] for k in range(3))
    write_table(path, {"name": np.array(names, dtype=object), "x": np.array(floats), "y": np.array(ints, dtype=int)})
    t = read_table(path, required=COLUMNS, known=COLUMNS)
    assert t.text("name") == names
    np.testing.assert_array_equal(t.numbers("x", optional=True), floats)
    assert [int(cell) for cell in t.text("y")] == ints


@given(data=st.binary(max_size=200))
def test_any_bytes_give_a_table_or_a_file_error(one_folder, data):
    path = one_folder / "t.csv"
    path.write_bytes(b"name,x,y\n" + data)
    try:
        numbers = read_table(path, required=COLUMNS, known=COLUMNS).numbers("x")
    except FileError:
        return
    assert np.isfinite(numbers).all()


def test_writing_checks_the_columns(tmp_path):
    with pytest.raises(ValueError, match=r"equally long, got \{'a': \(2,\), 'b': \(3,\)\}"):
        write_table(tmp_path / "t.csv", {"a": np.zeros(2), "b": np.zeros(3)})
    with pytest.raises(ValueError, match="one-dimensional"):
        write_table(tmp_path / "t.csv", {"a": np.zeros((2, 2))})
    assert not list(tmp_path.iterdir())


def test_booleans_and_float32(tmp_path):
    write_table(tmp_path / "t.csv", {"on": np.array([True, False]), "v": np.array([0.1, np.nan], dtype=np.float32)})
    assert (tmp_path / "t.csv").read_bytes() == b"on,v\n1,0.10000000149011612\n0,\n"
