"""Lines on a terminal: broken between words, paths from here, nothing broken that is to be copied."""

import io
import os

import pytest

from windmark.app.console import laid

LONG = "wind-off: 29 of 35 spots are markers; weak along the viewing direction: 0.013 mm, together with a rotation"


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture(autouse=True)
def narrow(monkeypatch):
    monkeypatch.setattr("shutil.get_terminal_size", lambda: os.terminal_size((60, 24)))


def test_lines_end_between_words_and_go_on_indented():
    first, *rest = laid("  " + LONG, Terminal()).split("\n")
    assert rest
    assert first.startswith("  wind-off")
    assert all(line.startswith("    ") for line in rest)
    assert max(map(len, (first, *rest))) <= 60
    assert " ".join(line.strip() for line in (first, *rest)) == LONG


def test_a_pipe_has_one_line():
    assert laid(LONG, io.StringIO()) == LONG


@pytest.mark.parametrize("line", ["next: windmark calibrate 'a b'/*.tif " + "-c camera.json " * 5,
                                  "report: /somewhere/" + "with a space/" * 6 + "report.html"])  # fmt: skip
def test_what_is_to_be_copied_stays_whole(line):
    assert laid(line, Terminal()) == line


def test_paths_are_told_from_here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    said = f"{tmp_path / 'a' / 'model.grid'}: says no unit, as {tmp_path / 'markers.csv'} says"
    assert laid(said, io.StringIO()) == f"{os.path.join('a', 'model.grid')}: says no unit, as markers.csv says"
