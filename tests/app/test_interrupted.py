"""What a command says that is ended: what is in its place already, or that nothing is."""

import os
import signal

import pytest
import typer

from windmark import io
from windmark.app import console
from windmark.io import staging


def said_when(work, capsys) -> str:
    with pytest.raises(typer.Exit) as ended, console.errors(as_json=False):
        work()
    assert ended.value.exit_code == 130
    return capsys.readouterr().err.replace("\n", " ")


def test_ctrl_c_after_the_result_is_in_its_place_does_not_say_that_nothing_was_written(tmp_path, capsys):
    """All files had been replaced, whole and consistent: only the sentence was wrong."""

    def late():
        with io.result_folder(tmp_path / "out") as out:
            (out.place / "a.txt").write_text("new")
        raise KeyboardInterrupt

    assert f"interrupted; {tmp_path / 'out'} had been written whole before" in said_when(late, capsys)

    def early():
        with io.result_folder(tmp_path / "out") as out:
            io.write_json(out.place / "b.json", {})  # not in its place yet
            raise KeyboardInterrupt

    assert "interrupted; nothing was written" in said_when(early, capsys)
    assert (tmp_path / "out" / "a.txt").read_text() == "new"


@pytest.mark.skipif(os.name == "nt", reason="signals are sent in another way on Windows")
def test_a_signal_while_the_hidden_folder_is_taken_away_is_one_after_the_exchange(tmp_path, capsys, monkeypatch):
    release = staging.Staging.release

    def signalled(held):
        os.kill(os.getpid(), signal.SIGINT)
        release(held)

    monkeypatch.setattr(staging.Staging, "release", signalled)

    def work():
        with io.result_folder(tmp_path / "out") as out:
            (out.place / "a.txt").write_text("new")

    assert "out had been written whole before" in said_when(work, capsys)


def test_single_files_are_told_as_well(tmp_path, capsys):
    def work():
        with io.atomic_paths([tmp_path / "a.csv", tmp_path / "b.csv"]) as places:
            for place in places.values():
                place.write_text("x")
        raise KeyboardInterrupt

    said = said_when(work, capsys)
    assert "b.csv (and 1 more) had been written whole before" in said
