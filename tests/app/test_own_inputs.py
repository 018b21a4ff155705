"""No verb writes over a file that it has read: pictures of a test in a tunnel are not taken twice."""

import os
import shutil

import pytest

from windmark import io
from windmark.io.errors import reading

pytestmark = pytest.mark.usefixtures("all_undrawn")


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


@pytest.mark.slow
def test_a_result_is_not_replaced_by_one_that_is_made_of_it(windmark, tmp_path, simulated):
    """A synthetic test is a result as well: its pictures and its project are files of ours that a new one would take
    away.
    """
    test = shutil.copytree(simulated("--seed", 3), tmp_path / "test")
    before = {path: path.read_bytes() for path in test.rglob("*") if path.is_file()}
    job = ("-c", test / "camera.json", "-m", test / "markers.csv", "-r", 4, "--unit", "mm")
    done = windmark("register", test / "wind-off.tif", *job, "-o", test)
    assert done.code == 2
    assert "holds the result of windmark simulate, and this run reads camera.json of it" in done.err
    done = windmark("run", test / "project.toml", "-o", test)
    assert done.code == 2
    assert "--output" in done.err
    assert "is the folder of the project itself" in done.err
    assert {path: path.read_bytes() for path in test.rglob("*") if path.is_file()} == before


def test_a_result_of_another_verb_is_kept(windmark, tmp_path, simulated):
    """The pictures of a synthetic test stand in its manifest as results: another job in their place took them away."""
    first = simulated("--seed", 3)
    test = shutil.copytree(first, tmp_path / "test")
    before = {p.relative_to(test): p.read_bytes() for p in test.rglob("*") if p.is_file()}
    job = ("-c", first / "camera.json", "-m", first / "markers.csv", "-r", 4, "--unit", "mm", "-o", test)
    done = windmark("register", first / "wind-off.tif", *job)
    assert done.code == 0
    assert "made by windmark simulate; kept in" in done.err
    kept = tmp_path / "test.kept-1"
    assert {p.relative_to(kept): p.read_bytes() for p in kept.rglob("*") if p.is_file()} == before
    assert windmark("register", first / "wind-off.tif", *job).code == 0  # the same verb again replaces its own
    assert not (tmp_path / "test.kept-2").exists()


def test_a_result_that_turns_out_to_be_read_is_kept(tmp_path):
    """What is read only in the course of the work is not known when the folder is taken."""
    target, place = tmp_path / "a", tmp_path / "a.kept-1"
    with io.result_folder(target) as out:
        (out.place / "table.csv").write_text("1")
    said = []
    with io.result_folder(target, say=said.append) as out:
        with reading(target / "table.csv"):
            table = (target / "table.csv").read_text()
        (out.place / "table.csv").write_text(table + "2")
    assert (target / "table.csv").read_text() == "12"
    assert (place / "table.csv").read_text() == "1"
    assert any("of an earlier run that this one reads; kept in" in text for text in said)
