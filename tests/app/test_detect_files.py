"""What `detect` writes is one thing: tables and pictures together, and nothing over a good table without a marker."""

import numpy as np
import pytest

from windmark import io


@pytest.fixture
def empty(tmp_path):
    io.write_image(tmp_path / "empty.png", np.full((120, 160), 900, np.uint16))
    (tmp_path / "detections.csv").write_text("a good table\n")
    return tmp_path


def test_a_good_table_outlives_a_run_that_finds_nothing(windmark, empty):
    done = windmark("detect", empty / "empty.png", "-r", 4, "-o", empty / "detections.csv",
                    "--explain", empty / "why.csv")  # fmt: skip
    assert done.code == 1
    assert (empty / "detections.csv").read_text() == "a good table\n"
    assert f"written: {empty / 'why.csv'}\n" in done.out
    assert sorted(p.name for p in empty.iterdir()) == ["detections.csv", "empty.png", "why.csv"]


@pytest.mark.parametrize("option", ["-o", "--explain", "--picture"])
def test_a_bad_output_is_found_before_the_work(windmark, empty, option, monkeypatch):
    from windmark.app import detect_verb

    monkeypatch.setattr(detect_verb, "read_wished", lambda *_: pytest.fail("the work has begun"))
    options = ["-o", empty / "new.csv"] if option != "-o" else []
    for bad, words in ((empty / "empty.png" / "x.csv", "a part of its path is a file"), (empty, "this is a folder"),
                       (empty / "no" / "x.csv", "does not exist")):  # fmt: skip
        done = windmark("detect", empty / "empty.png", "-r", 4, *options, option, bad)
        assert done.code == 2
        assert words in done.err
    assert sorted(p.name for p in empty.iterdir()) == ["detections.csv", "empty.png"]


def test_tables_and_pictures_come_together(windmark, empty, monkeypatch):
    from windmark.app import detect_verb

    rows, columns = np.mgrid[:120, :160]
    spots = [(40, 40), (100, 50), (60, 90)]
    dark = sum(np.clip(5.0 - np.hypot(columns - x, rows - y), 0, 1) for x, y in spots)
    io.write_image(empty / "empty.png", (2000 - 1500 * dark).astype(np.uint16))

    def full(path, _):
        raise io.FileError(path, "cannot be written: the disk is full")

    monkeypatch.setattr(detect_verb.io, "write_table", full)
    done = windmark("detect", empty / "empty.png", "-r", 4.5, "-o", empty / "detections.csv",
                    "--explain", empty / "why.csv")  # fmt: skip
    assert done.code == 2
    assert f"{empty / 'why.csv'}: cannot be written: the disk is full" in done.err
    assert (empty / "detections.csv").read_text() == "a good table\n"
    assert sorted(p.name for p in empty.iterdir()) == ["detections.csv", "empty.png"]
