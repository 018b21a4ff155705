"""Tables of joint covariances of markers, good and bad."""

from __future__ import annotations

import numpy as np
import pytest

from windmark.io import FileError, read_marker_covariance, write_marker_covariance
from windmark.scene import MarkerCovariance

HEAD = "first,second,xx,xy,xz,yx,yy,yz,zx,zy,zz\n"
A, B = "A,A,4,1,0,1,5,0,0,0,6\n", "B,B,7,0,0,0,8,0,0,0,9\n"


@pytest.fixture
def file(tmp_path):
    def write(text):
        (tmp_path / "cov.csv").write_text(text)
        return tmp_path / "cov.csv"

    return write


def test_one_line_for_each_pair(file):
    known = read_marker_covariance(file(f"# length unit: mm\n{HEAD}{A}{B}A,B,.1,.2,.3,.4,.5,.6,.7,.8,.9\n"))
    assert known.name.tolist() == ["A", "B"]
    assert known.length_unit == "mm"
    assert known.cov[0, 4] == 0.2  # x of A with y of B
    assert known.cov[2, 3] == 0.7  # z of A with x of B
    np.testing.assert_array_equal(known.cov, known.cov.T)
    turned = read_marker_covariance(file(f"{HEAD}{A}{B}B,A,.1,.4,.7,.2,.5,.8,.3,.6,.9\n"))
    np.testing.assert_array_equal(turned.cov, known.cov)


def test_pairs_without_a_line_are_not_correlated(file):
    known = read_marker_covariance(file(HEAD + B + A))
    assert known.name.tolist() == ["B", "A"]
    assert not known.cov[:3, 3:].any()
    np.testing.assert_array_equal(known.sigma, np.sqrt([[7, 8, 9], [4, 5, 6]]))


def test_what_is_written_is_read(tmp_path):
    rng = np.random.default_rng(0)
    root = rng.normal(size=(9, 9))
    root[6:, :6] = root[:6, 6:] = 0.0
    known = MarkerCovariance(["a", "b", "c"], root @ root.T, "mm")
    write_marker_covariance(tmp_path / "cov.csv", known)
    back = read_marker_covariance(tmp_path / "cov.csv")
    assert (back.name.tolist(), back.length_unit) == (["a", "b", "c"], "mm")
    np.testing.assert_array_equal(back.cov, known.cov)
    assert len((tmp_path / "cov.csv").read_text().splitlines()) == 2 + 4  # a and b with c are not there


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (HEAD + A + "A,B,0,0,0,0,0,0,0,0,0\n", "line 3: 'B' has no line with itself"),
        (HEAD + A + B + A, "line 4: A and A are already on line 2"),
        (HEAD + A + B + "A,B,0,0,0,0,0,0,0,0,0\nB,A,0,0,0,0,0,0,0,0,0\n", "line 5: B and A are already on line 4"),
        (HEAD + "A,A,4,1,0,2,5,0,0,0,6\n", "line 2: the covariance of A with itself is not symmetric"),
        (HEAD + "A,A,4,1,0,1,five,0,0,0,6\n", "line 2: yy is 'five'"),
        (HEAD + "A,A,4,3,0,3,1,0,0,0,6\n", "positive semidefinite"),
        (HEAD + "A,A,4,0,0,0,1,0,0,0,0\n", "variances > 0; it is not for A"),
        (HEAD + ",A,4,1,0,1,5,0,0,0,6\n", "line 2: first or second is empty"),
        (HEAD.replace(",zz", "") + "A,A,1,1,1,1,1,1,1,1\n", "zz"),
        (HEAD, "no markers"),
    ],
)
def test_what_is_wrong_is_named(file, text, words):
    with pytest.raises(FileError, match=words):
        read_marker_covariance(file(text))
