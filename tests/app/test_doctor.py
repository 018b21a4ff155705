"""`windmark doctor`: what it finds of the installation, and what is wrong with it."""

import pytest

import windmark as wm
from windmark.pipeline import state


def test_it_names_versions_kernels_and_folders(windmark):
    done = windmark("doctor")
    assert done.code == 0, done.out
    for words in (f"windmark                    {wm.__version__}", "numba ", "kernels", "working folder", "all sound"):
        assert words in done.out


def test_a_numba_that_is_not_as_known_is_said(windmark, monkeypatch):
    monkeypatch.setattr(state.nb, "linked_once", False)
    done = windmark("doctor")
    assert done.code == 0, done.out
    assert "is not as windmark knows it: compiling takes longer, results are the same" in " ".join(done.out.split())


def test_a_folder_of_kernels_that_cannot_be_written_is_trouble(windmark, monkeypatch):
    monkeypatch.setattr(state, "_can_write", lambda folder: False)
    done = windmark("doctor")
    assert done.code != 0
    assert "set NUMBA_CACHE_DIR to a folder that can" in " ".join(done.out.split())
    assert "all sound" not in done.out


@pytest.mark.parametrize("why", ["numba was 0.1, is now another", "sources have been changed"])
def test_kernels_that_came_and_are_of_no_use_say_why(windmark, monkeypatch, why):
    monkeypatch.setattr(state, "shipped", lambda package, hashed: (None, why))
    assert f"are of no use here: {why}" in " ".join(windmark("doctor").out.split())
