"""No verb writes over a file that it has read: pictures of a test in a tunnel are not taken twice."""

import os
import shutil

import pytest

from windmark import io


@pytest.fixture
def pictures(tmp_path, sheet_image):
    for name in ("a.png", "b.png"):
        io.write_image(tmp_path / name, sheet_image)
    return tmp_path


@pytest.mark.parametrize("option", ["-o", "--explain"])
def test_a_picture_is_not_replaced_by_what_was_found_in_it(windmark, pictures, option):
    before = {path.name: path.read_bytes() for path in pictures.iterdir()}
    table = () if option == "-o" else ("-o", pictures / "spots.csv")
    done = windmark("detect", pictures / "a.png", pictures / "b.png", "-r", 4, option, pictures / "b.png", *table)
    assert done.code == 2
    assert "b.png: is an input of this run, and is not written over; choose another file" in done.err
    assert {path.name: path.read_bytes() for path in pictures.iterdir()} == before


@pytest.mark.skipif(os.name == "nt", reason="links need rights on Windows")
def test_not_by_another_name_either(windmark, pictures):
    before = (pictures / "a.png").read_bytes()
    (pictures / "in.png").symlink_to(pictures / "a.png")
    (pictures / "out.csv").symlink_to(pictures / "a.png")
    for given, output in (("in.png", "a.png"), ("a.png", "out.csv")):
        done = windmark("detect", pictures / given, "-r", 4, "-o", pictures / output)
        assert done.code == 2
        assert "is an input of this run" in done.err
    assert (pictures / "a.png").read_bytes() == before


def test_what_an_earlier_run_wrote_is_written_over(windmark, pictures):
    shutil.copy(pictures / "a.png", pictures / "spots.csv")
    for _ in range(2):
        assert windmark("detect", pictures / "a.png", "-r", 4, "-o", pictures / "spots.csv").code == 0
    assert len(io.read_detections(pictures / "spots.csv")["a.png"]) == 42
