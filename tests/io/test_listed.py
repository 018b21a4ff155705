"""Tables of other programs: columns that the user names."""

import numpy as np
import pytest

from windmark import io
from windmark.errors import UsageError


def listed(tmp_path, text, columns="name,x,y,z"):
    (tmp_path / "t.txt").write_text(text, encoding="utf-8")
    return io.read_listed_markers(tmp_path / "t.txt", columns.split(","))


@pytest.mark.parametrize("text", [
    "T1 0.5 0 -2.25\nT2 1e3 7 1\n",
    "point  x  y  z\nT1\t0.5\t0\t-2.25\nT2\t1000\t7\t1\n",
    "# a comment\n\n T1, 0.5, 0, -2.25,\n\"T2\",1000.0,7,1\n",
    "Name;X (mm);Y (mm);Z (mm)\nT1;0,5;0;-2,25\nT2;1000;7;1\n",
    "T1 0,5 0 -2,25\n! another comment\nT2 1000 7,0 1\n",
    "T1;0.5;0;-2.25\r\nT2;1000;7;1",
])  # fmt: skip
def test_separators_and_decimal_marks(tmp_path, text):
    markers, left = listed(tmp_path, text)
    assert markers.name.tolist() == ["T1", "T2"]
    np.testing.assert_array_equal(markers.xyz, [[0.5, 0, -2.25], [1000, 7, 1]])
    assert left == [line for line in text.splitlines() if line.lower().startswith(("point", "name"))]


def test_sigmas_roles_and_columns_that_are_left_out(tmp_path):
    text = "V 2.1\nPoint X Y Z sX sY sZ rays role\nA 1 2 3 .01 .02 .03 12 wall\nB 4 5 6 .01 .02 .03 9 primary\n"
    markers, left = listed(tmp_path, text, "name,x,y,z,sigma_x,sigma_y,sigma_z,-,role")
    np.testing.assert_array_equal(markers.sigma, [[0.01, 0.02, 0.03]] * 2)
    assert markers.role.tolist() == ["wall", "primary"]
    assert left == ["V 2.1", "Point X Y Z sX sY sZ rays role"]


def test_without_names_rows_are_counted(tmp_path):
    markers, _ = listed(tmp_path, "1 2 3\n4 5 6\n", "x,y,z")
    assert markers.name.tolist() == ["1", "2"]


@pytest.mark.parametrize("head", ["survey of 12 May 2019 mm", "point X Y Z rays", "Wing left 12 model 3"])
def test_a_title_with_numbers_is_none_where_a_coordinate_is_a_word(tmp_path, head):
    markers, left = listed(tmp_path, f"{head}\na 1 2 3\nb 4 5 6\n", "name,x,y,z")
    assert (markers.name.tolist(), left) == (["a", "b"], [head])


@pytest.mark.parametrize(("text", "columns", "words"), [
    ("a 1 2 3\nb 1 2\n", "name,x,y,z", "line 2: expected 4 values (name, x, y, z), got 'b 1 2'"),
    ("a 1 2 3\nb 1 2 nan\n", "name,x,y,z", "line 2: expected 4 values"),
    ("a 1 2 3\nb 1 2 1e999\n", "name,x,y,z", "line 2: expected 4 values"),
    ("a 1 2 3\na 1 2 4\n", "name,x,y,z", "line 2: the name 'a' is already on line 1"),
    # Amid points it is a thousand, and no row is taken for a header.
    ("a 1,234 2 3\nb 1.5 2 3\nc 1.5 2 3\n", "name,x,y,z", "line 1: expected 4 values"),
    ("a 1 2 nan\nb 1.5 2 3\n", "name,x,y,z", "line 1: expected 4 values"),
    # A name of several words is no title: the first marker was gone, and that was good.
    ("Wing left 1 2 3\nb 4 5 6\n", "name,x,y,z", "line 1: expected 4 values (name, x, y, z), got 'Wing left 1 2 3'"),
    ("Wing, left,1,2,3,x\nb,4,5,6,x\n", "name,x,y,z,-", "line 1: expected 5 values"),
    ("a 1 2 3 1\nb 1 2 3 0\n", "name,x,y,z,radius", "line 2: radius must be > 0"),
    ("a 1 2 3 4\n", "name,x,y,z", "line 1: no line has 4 values (name, x, y, z); this one is 'a 1 2 3 4'"),
    ("# nothing\n", "name,x,y,z", "no line has 4 values"),
    ("a 1 2 3 tip\n", "name,x,y,z,role", "line 1: role is 'tip'"),
])  # fmt: skip
def test_what_is_no_row_is_named(tmp_path, text, columns, words):
    with pytest.raises(io.FileError) as error:
        listed(tmp_path, text, columns)
    assert words in str(error.value), str(error.value)


@pytest.mark.parametrize(("columns", "words"), [
    ("name,x,y", "z is not named"),
    ("name,x,y,z,w", "'w' is no column"),
    ("x,y,z,x", "x is named more than once"),
])  # fmt: skip
def test_columns_that_are_none(tmp_path, columns, words):
    with pytest.raises(UsageError, match=words):
        listed(tmp_path, "a 1 2 3\n", columns)


def test_a_long_head_and_a_long_table(tmp_path):
    head = [f"remark {k}" for k in range(700)]
    rows = [f"m{k};{k},5;0;1" for k in range(3000)]
    markers, left = listed(tmp_path, "\n".join(head + rows))
    assert left == head
    assert len(markers) == 3000
    np.testing.assert_array_equal(markers.xyz[:, 0], np.arange(3000) + 0.5)
