"""What a terminal shows while a verb works: stages, and of many pictures their count; nothing for anybody else."""

import io as streams
from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

from windmark import io
from windmark.app import progress as progress_room
from windmark.app.progress import counted, progress
from windmark.geometry import Camera
from windmark.pipeline.calibrate.read import read_pictures
from windmark.pipeline.clock import Counted, counting
from windmark.pipeline.job import _in_parallel


class Terminal(streams.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def line(monkeypatch):
    """``line()``: what stands on the terminal now, drawn when it is asked for and not ten times a second."""
    made, bars = [], progress_room._bars

    @contextmanager
    def kept():
        with bars() as bar:
            made.append(bar)
            yield bar

    def drawn():
        page = Console(file=streams.StringIO(), width=120)
        page.print(made[-1].get_renderable())
        return page.file.getvalue()

    monkeypatch.setattr(progress_room, "_bars", kept)
    monkeypatch.setattr(progress_room, "_unseen", lambda: False)
    return drawn


def counts(told):
    return [(t.done, t.of) for t in told if isinstance(t, Counted)]


def test_a_stage_with_parts_has_their_count_while_it_lasts(line):
    with progress() as show:
        show("read the markers")
        assert "read the markers" in line()
        assert "/" not in line()
        ended = counting(show, "detect", 3)
        ended("P01.tif")
        assert "detect P01.tif" in line()
        assert "1/3" in line()
        show("P03: register")  # of a picture at work: the count stays
        assert "P03: register" in line()
        assert "1/3" in line()
        ended("P02.tif")
        ended("P03.tif")
        assert "3/3" in line()
        show("draw the report")
        assert "draw the report" in line()
        assert "/" not in line()


def test_one_picture_is_not_counted(line):
    with progress() as show:
        counting(show, "detect", 1)("P01.tif")
        assert "P01.tif" in line()
        assert "/1" not in line()


def test_nobody_else_sees_it(monkeypatch):
    stages = progress, lambda: progress(5)
    for stream, params, seen in ((Terminal(), {}, True), (Terminal(), {"as_json": True}, False),
                                 (streams.StringIO(), {}, False)):  # fmt: skip
        monkeypatch.setattr("sys.stderr", stream)
        monkeypatch.setattr(progress_room, "get_current_context", lambda silent, p=params: SimpleNamespace(params=p))
        for bar in stages:
            with bar() as show:
                show("detect")
        with counted("compile") as step:
            step("kernel", 1, 2)
        assert bool(stream.getvalue()) == seen, params


@pytest.mark.slow
def test_jobs_count_their_pictures(tmp_path, sheet_image, windmark, monkeypatch):
    told = []
    _in_parallel(lambda name: SimpleNamespace(name=name), ["a", "b"], 2, told.append, "map")
    assert counts(told) == [(0, 2), (1, 2), (2, 2)]
    for name in ("a", "b", "c"):
        io.write_image(tmp_path / f"{name}.tif", sheet_image)
    files = sorted(tmp_path.glob("*.tif"))
    io.write_camera(tmp_path / "c.json", Camera(sheet_image.shape[::-1], 500.0, k1=-0.1))

    def look(path, name, taken):
        return SimpleNamespace(name=name, camera=taken.camera, size_px=(10, 10))

    told.clear()
    read_pictures(files, {"": None}, {}, 500.0, look, told.append)
    assert counts(told)[-1] == (3, 3)

    class Heard:
        def __enter__(self):
            return told.append

        def __exit__(self, *_):
            return None

    for verb in ("detect", "undistort", "align"):
        monkeypatch.setattr(f"windmark.app.{verb}_verb.progress", Heard)
    for words in (("detect", *files, "-r", 4, "-o", tmp_path / "d.csv"),
                  ("undistort", *files, "-c", tmp_path / "c.json", "-o", tmp_path / "u"),
                  ("align", *files, "-r", 4, "--max-shift-px", 20, "-o", tmp_path / "aligned")):  # fmt: skip
        told.clear()
        assert windmark(*words).code == 0, words
        done, of = counts(told)[-1]
        assert done == of >= 2, words
        assert np.all(np.diff([d for d, _ in counts(told)]) >= 0)
