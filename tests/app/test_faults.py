"""What is said, what is a fault, and what ends windmark: exit codes, laws that exit, names, encodings."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from windmark import detection, io
from windmark.deformation.law import LawError
from windmark.errors import DataError, UsageError, WindmarkError
from windmark.geometry import Camera, DegenerateGeometry, Pose
from windmark.pipeline.settings import unusable_name


def broken(*_, **__):
    """A programming error as numpy has them: a ValueError of its own."""
    return np.zeros(3) + np.zeros(4)


def test_own_errors_are_told_from_those_that_a_fault_brings_about():
    for make, ours in (
        (lambda: detection.detect(np.zeros((9, 9)), radius_px=-1.0), True),
        (lambda: io.read_markers("nowhere.csv"), True),
        (lambda: Camera((0, 5), 1.0), False),  # a camera that windmark has made up: whoever reads one says it otherwise
        (lambda: Pose(np.eye(4), np.zeros(3)), False),
        (broken, False),
        (lambda: np.linalg.inv(np.zeros((2, 2))), False),
    ):
        with pytest.raises(ValueError) as caught:
            make()
        assert isinstance(caught.value, WindmarkError) is ours
    for own in (io.FileError, DegenerateGeometry, LawError, UsageError, DataError):
        assert issubclass(own, WindmarkError)


@pytest.fixture
def picture(tmp_path):
    io.write_image(tmp_path / "a.png", np.full((40, 50), 99, np.uint8))
    return tmp_path / "a.png"


def test_wrong_shapes_that_windmark_hands_to_itself_are_faults(windmark, picture, monkeypatch):
    monkeypatch.setattr(detection, "find_markers", lambda *_, **__: Pose(np.eye(4), np.zeros(3)))
    done = windmark("detect", picture, "-o", picture.with_suffix(".csv"))
    assert done.code == 3
    assert "(ValueError: Pose: expected rotation (..., 3, 3)" in done.err


@pytest.mark.parametrize("as_json", [(), ("--json",)])
def test_a_fault_keeps_its_traceback_and_has_an_exit_code_of_its_own(windmark, picture, monkeypatch, as_json):
    monkeypatch.setattr(detection, "find_markers", broken)
    done = windmark("detect", picture, "-o", picture.with_suffix(".csv"), *as_json)
    assert done.code == 3
    assert "Traceback" in done.err
    assert 'test_faults.py", line' in done.err
    assert "a fault of windmark" in done.err
    assert "not of your data (ValueError: operands could not be broadcast" in done.err
    assert "please report it, with the lines above" in done.err
    assert not as_json or "a fault of windmark" in done.json["error"]


def test_a_fault_in_one_image_is_not_dressed_as_bad_data(windmark, picture, monkeypatch):
    (picture.parent / "m.csv").write_text("name,x,y,z\nA,0,0,0\nB,1,0,0\nC,0,1,0\nD,1,1,1\n")
    io.write_camera(picture.parent / "c.json", Camera((50, 40), 60.0))
    monkeypatch.setattr(detection, "find_markers", broken)
    done = windmark("register", picture, "-m", picture.parent / "m.csv", "-c", picture.parent / "c.json",
                    "--unit", "mm", "-o", picture.parent / "out")  # fmt: skip
    assert done.code == 3
    assert not (picture.parent / "out").exists()
    aligned = windmark("align", picture, picture, "-o", picture.parent / "out")
    assert aligned.code == 2  # twice the same name: wrong usage is still said


def test_wrong_usage_and_bad_files_are_no_faults(windmark, picture):
    done = windmark("detect", picture, "--roi", "1,2", "-o", picture.with_suffix(".csv"))
    assert (done.code, "Traceback" in done.err) == (2, False)
    picture.write_bytes(b"\x89PNG\r\n\x1a\nnothing")
    done = windmark("detect", picture, "-o", picture.with_suffix(".csv"))
    assert (done.code, "Traceback" in done.err) == (2, False)


def test_a_law_that_exits_is_named_with_its_line(windmark, tmp_path):
    (tmp_path / "own.py").write_text("import sys\n\ndef wing(xyz, tip):\n    sys.exit(0)\n")
    done = windmark("laws", tmp_path / "own.py")
    assert done.code == 2
    assert "own.py:4: calls sys.exit(0); a law must return a result, not end windmark" in done.err
    (tmp_path / "own.py").write_text("raise SystemExit\n")
    assert "own.py:1: calls sys.exit()" in windmark("laws", tmp_path / "own.py").err


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["ok", "CON"], "Windows keeps 'CON' for a device"),
        (["aux.tif"], "Windows keeps 'aux.tif' for a device"),
        (["com1"], "Windows keeps"),
        (["report.html"], "the name of a file of the results themselves"),
        (["Manifest.json"], "the name of a file of the results themselves"),
        (["a", "A"], "'a' and 'A' are one name on many disks"),
        (["\u00e9", "e\u0301"], "are one name on many disks"),
        (["end."], "this one cannot: 'end.'"),
        (["a/b"], "this one cannot: 'a/b'"),
        (["tab\t"], "signs that do not print"),
        (["x" * 201], "too long"),
    ],
)
def test_names_that_some_system_cannot_hold(names, words):
    assert words in unusable_name(names)


def test_names_that_every_system_can_hold():
    assert unusable_name(["a", "wind-on 3", "Flügel", "connect", "com10", "翼"]) is None


def test_image_names_in_projects_and_alignment(windmark, picture):
    folder = picture.parent
    for name in ("CON", "report.html"):
        io.write_image(folder / f"{name}.png", np.full((40, 50), 99, np.uint8))
        done = windmark("align", picture, folder / f"{name}.png", "-o", folder / "out")
        assert done.code == 2
        assert name in done.err
    (folder / "p.toml").write_text(
        'title = "t"\nlength_unit = "mm"\n[[camera]]\nfile = "c.json"\npose = "known"\n[[image]]\nfile = "a.png"\n'
        'name = "a"\n[[image]]\nfile = "a.png"\nname = "A"\n'
    )
    io.write_camera(folder / "c.json", Camera((50, 40), 60.0))
    done = windmark("run", folder / "p.toml")
    assert done.code == 2
    assert "image names become file names, and 'a' and 'A' are one name on many disks" in done.err


@pytest.mark.slow
@pytest.mark.parametrize("as_json", [False, True])
def test_names_that_the_output_cannot_print_are_no_bad_files(tmp_path, as_json):
    file = tmp_path / "翼-Ω.png"
    io.write_image(file, np.full((40, 50), 99, np.uint8))
    environment = {**os.environ, "PYTHONIOENCODING": "cp1252"}
    call = [
        sys.executable,
        "-c",
        "from windmark.app.cli import main; main()",
        "detect",
        str(file),
        "-r",
        "3",
        "-o",
        str(tmp_path / "d.csv"),
    ]
    done = subprocess.run([*call, *(["--json"] if as_json else [])], env=environment, capture_output=True, check=False)
    assert done.returncode == 1, done.stderr  # there is no spot
    assert b"codec" not in done.stderr
    if as_json:
        assert list(json.loads(done.stdout)["images"]) == [file.name]
    else:
        assert b"\\u7ffc" in done.stdout
