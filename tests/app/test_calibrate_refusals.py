"""What `windmark calibrate` cannot do, it says: code 1 for the data, 2 for files and usage; nothing half-written."""

import networks
import numpy as np
import pytest

from windmark import io
from windmark.scene import MarkerSet

SIZE = "1500x1000"


@pytest.fixture
def plate(tmp_path):
    """Rough markers, matches of 8 pictures, and results of an earlier run that must not be touched."""
    case = networks.make(78, points=20, views=8)
    net = case.network
    points = case.start.points.copy()
    points[2] = (points[0] + points[1]) / 2  # three on a line
    io.write_markers(tmp_path / "rough.csv", MarkerSet.make([f"m{k:02d}" for k in range(20)], points))
    table(tmp_path / "matches.csv", net, np.ones(len(net.view), bool))
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "earlier.txt").write_text("kept")
    return case, tmp_path


def table(path, net, keep):
    io.write_table(path, {
        "image": np.array([f"v{v:02d}" for v in net.view[keep]]), "x": net.xy[keep, 0], "y": net.xy[keep, 1],
        "name": np.array([f"m{p:02d}" for p in net.point[keep]]),
    })  # fmt: skip


def call(windmark, folder, *more, matches="matches.csv", markers="rough.csv", datum="free"):
    done = windmark("calibrate", folder / matches, "-m", folder / markers, "--unit", "mm", "--size", SIZE, "--datum",
                    datum, "-o", folder / "out", *more)  # fmt: skip
    assert [p.name for p in (folder / "out").iterdir()] == ["earlier.txt"]
    assert "Traceback" not in done.err
    return done


def test_three_marks_in_every_picture(windmark, plate):
    case, folder = plate
    net = case.network
    order = np.concatenate([np.arange((net.view == v).sum()) for v in range(8)])
    table(folder / "few.csv", net, order < 3)
    done = call(windmark, folder, "--json", matches="few.csv")
    assert done.code == 1
    assert done.json["cause"] == "too_few"
    assert "no view has four marks" in done.json["reason"]
    assert done.json["dropped"]["v03"] == "view with 3 marks; 4 are needed"


def test_every_marker_seen_once(windmark, plate):
    case, folder = plate
    net = case.network
    first = np.zeros(len(net.view), bool)
    first[np.unique(net.point, return_index=True)[1]] = True
    table(folder / "once.csv", net, first)
    done = call(windmark, folder, "--json", matches="once.csv")
    assert done.code == 1
    assert "seen at least twice" in done.json["reason"]
    assert "seen in one view only" in done.json["dropped"]["m05"]


@pytest.mark.slow
def test_a_datum_that_leaves_the_network_turning(windmark, plate):
    """Three held markers on a line fix position and scale, but not the turn about the line."""
    done = call(windmark, plate[1], "--json", datum="fixed:m00,m01,m02")
    assert done.code == 1
    assert done.json["weak"] == ["datum"]
    assert "of seven motions free; it needs three markers that are not on a line" in done.json["reason"]


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("matches.csv", "image,marker,x,y\nv0,m00,1,2\n", "column"),
        ("matches.csv", "image,name,x,y\nv0,m00,one,2\n", "line 2"),
        ("matches.csv", "image,name,x,y\nv0,m00,inf,2\n", "line 2"),
        ("matches.csv", "image,name,x,y\nv0,,1,2\n", "name is empty"),
        ("rough.csv", "", "rough.csv"),
        ("rough.csv", "name,x,y\nm00,1,2\n", "z"),
        ("rough.csv", "name,x,y,z\nm00,1,2,nan\n", "line 2"),
        ("rough.csv", "name,x,y,z\nm00,1,2,3\nm00,1,2,3\n", "m00"),
    ],
)
def test_wrong_tables(windmark, plate, name, text, words):
    folder = plate[1]
    (folder / name).write_text(text)
    done = call(windmark, folder)
    assert done.code == 2
    assert name in done.err
    assert words in done.err


@pytest.mark.parametrize("name", ["matches.csv", "rough.csv"])
def test_files_that_are_not_there(windmark, plate, name):
    (plate[1] / name).unlink()
    done = call(windmark, plate[1])
    assert done.code == 2
    assert name in done.err


def test_a_camera_file_that_is_none(windmark, plate):
    folder = plate[1]
    (folder / "camera.json").write_text('{"focal": 3}')
    done = windmark("calibrate", folder / "matches.csv", "-m", folder / "rough.csv", "--unit", "mm", "--datum", "free",
                    "-c", folder / "camera.json", "-o", folder / "new")  # fmt: skip
    assert done.code == 2
    assert "not a camera file" in done.err
    assert not (folder / "new").exists()


def test_a_folder_to_compare_with_that_has_no_results(windmark, plate):
    done = call(windmark, plate[1], "--against", plate[1] / "nowhere")
    assert done.code == 2
    assert "nowhere" in done.err


def test_a_picture_that_is_none(windmark, plate):
    folder = plate[1]
    (folder / "p.png").write_text("no picture")
    done = windmark("calibrate", folder / "p.png", "-m", folder / "rough.csv", "--unit", "mm", "--datum", "free", "-r",
                    3, "-o", folder / "new")  # fmt: skip
    assert done.code == 2
    assert "p.png" in done.err
    assert not (folder / "new").exists()
