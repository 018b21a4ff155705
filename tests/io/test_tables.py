"""Detections and matches as tables."""

from __future__ import annotations

import numpy as np
import pytest

from windmark.io import FileError, read_detections, read_matches, write_detections, write_matches
from windmark.scene import Detections, MarkerSet, Matching

COLUMNS = "image,x,y,sigma_x,sigma_y,rho,radius,merit,axis_major,axis_minor,angle_deg,depth,flags"


def spots(m, seed=0):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(m, 2, 2)) + 2 * np.eye(2)
    return Detections.make(
        rng.uniform(0, 1000, (m, 2)),
        cov=root @ root.transpose(0, 2, 1) * 1e-3,
        merit=rng.random(m),
        radius_px=rng.random(m) + 2,
        axes_px=rng.random((m, 2)) + np.array([3, 2]),
        angle=rng.uniform(0, np.pi, m),
        depth=rng.uniform(5, 50, m),
        flags=rng.integers(0, 32, m),
    )


def assert_same(a, b):
    for field in ("xy", "merit", "radius_px", "axes_px", "depth", "flags"):
        np.testing.assert_array_equal(getattr(a, field), getattr(b, field), err_msg=field)
    np.testing.assert_allclose(a.cov, b.cov, rtol=1e-14)
    np.testing.assert_allclose(a.angle, b.angle, rtol=1e-15)


def test_round_trip_of_one_image(tmp_path):
    path, written = tmp_path / "d.csv", spots(20)
    write_detections(path, written, image='a, "b".png')
    assert path.read_text().splitlines()[0] == COLUMNS
    ((name, again),) = read_detections(path).items()
    assert name == 'a, "b".png'
    assert_same(again, written)


def test_round_trip_of_many_images(tmp_path):
    path, written = tmp_path / "d.csv", {"b": spots(3, 1), "a long name": spots(5, 2), "": spots(1, 3)}
    write_detections(path, written)
    again = read_detections(path)
    assert list(again) == list(written)
    for name, each in written.items():
        assert_same(again[name], each)


def test_unknown_values_stay_unknown(tmp_path):
    path = tmp_path / "d.csv"
    written = Detections.make([[1, 2], [3, 4]], cov=[np.full((2, 2), np.inf), np.eye(2)])
    write_detections(path, written, image="i")
    assert path.read_text().splitlines()[1:] == ["i,1.0,2.0,,,,,,,,,,0", "i,3.0,4.0,1.0,1.0,0.0,,,,,,,0"]
    again = read_detections(path)["i"]
    assert np.isnan(again.cov[0]).all()
    assert again.cov[1].tolist() == [[1, 0], [0, 1]]
    assert np.isnan(again.axes_px).all()
    assert np.isnan(again.merit).all()


def test_no_spots(tmp_path):
    write_detections(tmp_path / "d.csv", spots(0), image="i")
    assert (tmp_path / "d.csv").read_text() == COLUMNS + "\n"
    assert read_detections(tmp_path / "d.csv") == {}
    write_detections(tmp_path / "d.csv", {})
    assert read_detections(tmp_path / "d.csv") == {}


def test_table_of_another_program(tmp_path):
    path = tmp_path / "d.csv"
    path.write_text("y;x\n2;1\n4;3\n")
    d = read_detections(path, sigma_px=0.5)[""]
    assert d.xy.tolist() == [[1, 2], [3, 4]]
    assert d.cov.tolist() == [[[0.25, 0], [0, 0.25]]] * 2


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("image,x\na,1\n", "no column 'y'"),
        ("x,y\n1,?\n", r"line 2: y is '\?'"),
        ("x,y\n1,nan\n", "line 2: y is 'nan'"),
        ("x,y,sigma_x,sigma_y\n1,2,0,1\n", "line 2: sigma_x and sigma_y must be > 0"),
        ("x,y,sigma_x\n1,2,1\n", "header: the table has sigma_x but not sigma_y"),
        ("x,y,rho\n1,2,0\n1,2,1.5\n", "line 3: rho must be between -1 and 1"),
        ("x,y,flags\n1,2,1.5\n", "line 2: flags must be a whole number"),
        ("x,y,sigma\n1,2,1\n", "unknown column 'sigma'; the columns are image,x,y,sigma_x"),
    ],
)
def test_bad_detections(tmp_path, text, message):
    (tmp_path / "d.csv").write_text(text)
    with pytest.raises(FileError, match=message):
        read_detections(tmp_path / "d.csv")


def test_matches(tmp_path):
    path = tmp_path / "m.csv"
    markers = MarkerSet.make(["A", "B", "C,1"], np.zeros((3, 3)))
    found = Detections.make([[10, 20], [30, 40], [50, 60]])
    matching = Matching(np.array([2, 0]), np.array([2, 1]), np.array([5.0, 0.5]))
    write_matches(path, found, markers, matching, [[53, 64], [10, 20.5]], image="i.png")
    assert path.read_text().splitlines() == [
        "image,name,x,y,dx,dy,distance_px",
        'i.png,"C,1",50.0,60.0,3.0,4.0,5.0',
        "i.png,B,10.0,20.0,0.0,0.5,0.5",
    ]
    again = read_matches(path)
    assert len(again) == 2
    assert again.image.tolist() == ["i.png", "i.png"]
    assert again.name.tolist() == ["C,1", "B"]
    assert again.xy.tolist() == [[50, 60], [10, 20]]
    assert again.residual.tolist() == [[3, 4], [0, 0.5]]
    with pytest.raises(ValueError, match=r"projected_xy must be \(2, 2\), got \(3, 2\)"):
        write_matches(path, found, markers, matching, np.zeros((3, 2)))


def test_matches_by_hand_have_no_residual(tmp_path):
    (tmp_path / "m.csv").write_text("name,x,y\nA,1,2\n")
    m = read_matches(tmp_path / "m.csv")
    assert np.isnan(m.residual).all()
    assert m.image.tolist() == [""]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("image,name,x,y\ni,A,1,2\nj,A,1,2\ni,A,3,4\n", "line 4: the marker 'A' is already on line 2 for this image"),
        ("name,x,y\n,1,2\n", "line 2: name is empty"),
        ("name,x,y,dx\nA,1,2,3\n", "the table has dx but not dy"),
    ],
)
def test_bad_matches(tmp_path, text, message):
    (tmp_path / "m.csv").write_text(text)
    with pytest.raises(FileError, match=message):
        read_matches(tmp_path / "m.csv")
