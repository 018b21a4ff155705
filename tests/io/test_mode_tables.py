"""Tables of mode shapes."""

import numpy as np
import pytest

from windmark.io import FileError, read_modes

GOOD = "# plate\nx,y,z,dx_1,dy_1,dz_1,dx_2,dy_2,dz_2\n0,1,2,3,4,5,6,7,8\n10,11,12,13,14,15,16,17,18\n"


def test_nodes_and_shapes(tmp_path):
    path = tmp_path / "modes.csv"
    path.write_text(GOOD)
    nodes, shapes = read_modes(path)
    np.testing.assert_array_equal(nodes, [[0, 1, 2], [10, 11, 12]])
    np.testing.assert_array_equal(shapes[:, :, 0], [[3, 4, 5], [13, 14, 15]])
    np.testing.assert_array_equal(shapes[:, :, 1], [[6, 7, 8], [16, 17, 18]])
    path.write_text("Z;DX_1;x;y;dy_1;dz_1\n2;3;0;1;4;5\n")
    nodes, shapes = read_modes(path)
    np.testing.assert_array_equal(nodes, [[0, 1, 2]])
    np.testing.assert_array_equal(shapes, [[[3], [4], [5]]])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x,y,z\n1,2,3\n", "header: no mode in the header"),
        ("x,y,z,dx_1,dy_1\n1,2,3,4,5\n", "line 1: no column 'dz_1'"),
        ("x,y,z,dx_2,dy_2,dz_2\n1,2,3,4,5,6\n", "line 1: no column 'dx_1'"),
        ("x,y,z,dx_99999999999,dy_1,dz_1\n1,2,3,4,5,6\n", "line 1: no column 'dx_1'"),
        ("x,y,z,dx_1,dy_1,dz_1,mass\n1,2,3,4,5,6,7\n", "line 1: unknown column 'mass'"),
        ("x,y,z,dx_1,dy_1,dz_1\n1,2,3,4,5,six\n", "line 2: dz_1 is 'six'; expected a finite number"),
        ("x,y,z,dx_1,dy_1,dz_1\n1,2,3,4,5\n", "line 2: 5 values; expected 6"),
        ("x,y,z,dx_1,dy_1,dz_1\n", "no rows"),
        ("", "empty"),
    ],
)
def test_faults_are_told_with_line_and_column(tmp_path, text, words):
    path = tmp_path / "modes.csv"
    path.write_text(text)
    with pytest.raises(FileError, match=words) as caught:
        read_modes(path)
    assert str(path) in str(caught.value)
