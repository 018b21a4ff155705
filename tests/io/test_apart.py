"""Reading in a process of its own: what ends or stalls that one is refused, and the next file is read."""

from __future__ import annotations

import os
import signal
import sys
import threading

import numpy as np
import pytest

from windmark.io import FileError, apart


@pytest.fixture(scope="module", autouse=True)
def _fresh():
    """A helper of an earlier test may not know the folder of `helper_tasks`."""
    apart._drop()


@pytest.fixture
def file(tmp_path):
    (tmp_path / "a.bin").write_bytes(b"content")
    return tmp_path / "a.bin"


@pytest.fixture
def hasty(monkeypatch):
    monkeypatch.setattr(apart, "_TIME_S", 0.5)


def content(file):
    return apart.read_apart("helper_tasks:content", file, scale=2.0)


@pytest.mark.slow
def test_content_comes_back_as_it_is(file, capfd):
    got = content(file)
    np.testing.assert_array_equal(got["a"], np.arange(5) * 2.0)
    assert got["words"].tolist() == ["ä", "bc"]
    assert (got["n"], got["deep"]) == (3, {"x": [1, None]})
    assert got["process"] != os.getpid()
    assert content(file)["process"] == got["process"]  # one start for all files
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("task", "words"),
    [
        ("crash", "damaged: it ends the library that reads it"),
        ("loop", "damaged: it is not read within 1 s"),
        ("eat", "it takes over 1024 MiB of memory to read it"),
        ("refuse", "line 7: is none; expected one"),
    ],
)
def test_what_a_file_does_there_is_a_sentence_here(file, hasty, task, words):
    if task == "eat" and sys.platform != "linux":
        pytest.skip("memory is limited on Linux and Windows, and measured on Linux only")
    with pytest.raises(FileError, match=words):
        apart.read_apart(f"helper_tasks:{task}", file)
    assert content(file)["n"] == 3  # the next file is read


def test_faults_of_the_program_keep_their_traceback(file):
    with pytest.raises(RuntimeError, match="ZeroDivisionError") as error:
        apart.read_apart("helper_tasks:fail", file)
    assert "1 / 0" in str(error.value)


def test_a_missing_file_starts_nothing(tmp_path):
    with pytest.raises(FileError, match="no such file"):
        content(tmp_path / "none")


def test_a_relative_path_is_that_of_the_caller(file, monkeypatch):
    content(file)
    monkeypatch.chdir(file.parent)
    assert content(file.name)["length"] == len(str(file))
    with pytest.raises(FileError) as error:
        apart.read_apart("helper_tasks:refuse", file.name)
    assert str(error.value).startswith("a.bin: ")


@pytest.mark.skipif(sys.platform == "win32", reason="Windows tells the main thread once the helper has answered")
def test_ctrl_c_ends_the_helper_and_the_next_file_is_read(file):
    before = content(file)["process"]
    timer = threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        apart.read_apart("helper_tasks:loop", file)
    timer.join()
    assert content(file)["process"] != before


def test_a_helper_that_was_killed_is_replaced(file):
    before = content(file)["process"]
    apart._KEPT[0]._process.kill()
    apart._KEPT[0]._process.wait()
    assert content(file)["process"] != before


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
def test_a_forked_process_has_a_helper_of_its_own(file):
    before = content(file)["process"]
    child = os.fork()
    if not child:
        own = content(file)["process"]
        apart._drop()
        os._exit(0 if own != before else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    assert content(file)["process"] == before


def test_threads_take_turns(file):
    found = []
    threads = [threading.Thread(target=lambda: found.append(content(file)["n"])) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [3] * 8


def test_a_frozen_program_reads_by_itself(file, monkeypatch):
    apart._drop()
    monkeypatch.setattr(sys, "frozen", True, raising=False)
    assert content(file)["process"] == os.getpid()


def test_windows_is_told_its_limit_in_the_layout_it_knows():
    from ctypes import sizeof

    from windmark.io._limits import JobLimits

    assert sizeof(JobLimits) == (144 if sys.maxsize > 2**32 else 112)
