"""What a kill leaves of a single file that was being written is found, named and removed; nothing else is."""

import errno
import os
import signal
import subprocess
import sys

import pytest
from children import ended

from windmark.io import FileError, atomic_folder, atomic_path, exchange, result_folder, try_paths
from windmark.io import making as making_module
from windmark.io.making import is_making, left_behind

pytestmark = pytest.mark.skipif(os.name == "nt", reason="there is no SIGKILL")

WRITES = """
import sys, time
from windmark.io import atomic_path
with atomic_path(sys.argv[1]) as place:
    place.write_text("half")
    print(place.name, flush=True)
    time.sleep(600)
"""


def killed(target):
    """The hidden name of a file whose writer was killed."""
    told, tells = os.pipe()

    def write():
        with atomic_path(target) as place:
            place.write_text("half")
            os.write(tells, place.name.encode())
            os.kill(os.getpid(), signal.SIGKILL)

    assert ended(write) == -signal.SIGKILL
    os.close(tells)
    with open(told, encoding="utf-8") as name:
        return name.read()


def names(folder):
    return sorted(p.name for p in folder.iterdir())


@pytest.mark.parametrize("step", ["taken", "let_go"])
def test_ctrl_c_while_the_name_is_taken_or_let_go_of_leaves_nothing(tmp_path, monkeypatch, step):
    real = getattr(making_module, step)

    def interrupted(*given):
        os.kill(os.getpid(), signal.SIGINT)
        return real(*given)

    monkeypatch.setattr(making_module, step, interrupted)
    with pytest.raises(KeyboardInterrupt), atomic_path(tmp_path / "table.csv") as place:
        place.write_text("new")
    assert names(tmp_path) == ([] if step == "taken" else ["table.csv"])


def test_the_next_write_of_the_same_file_leaves_nothing(tmp_path):
    target = tmp_path / "table.csv"
    target.write_text("old")
    name = killed(target)
    assert is_making(name)
    assert names(tmp_path) == sorted([name, f"{name.removesuffix('.csv')}.lock", "table.csv"])
    assert target.read_text() == "old"
    with atomic_path(target) as place:
        assert (place.name, place.read_text()) == (name, "")
        place.write_text("new")
    assert names(tmp_path) == ["table.csv"]
    assert target.read_text() == "new"


def test_a_run_that_writes_beside_it_names_it(tmp_path):
    name, said = killed(tmp_path / "table.csv"), []
    try_paths([tmp_path / "other.csv"], said.append)
    assert said == [f"{tmp_path / name} was left by a run that was killed; removed"]
    assert names(tmp_path) == []


@pytest.mark.parametrize("live", [False, True])
def test_a_run_into_the_folder_names_it(tmp_path, live):
    said, out = [], tmp_path / "out"
    with result_folder(out) as made:
        (made.place / "grid").mkdir()
        (made.place / "grid" / "6.vtp").write_text("1")
    (out / "grid" / "notes.txt").write_text("mine")
    name = killed(out / "grid" / "7.vtp")
    with result_folder(out, say=said.append, live=live) as made:
        (made.place / "a.csv").write_text("1")
    assert said[:1] == [f"{out / 'grid' / name} was left by a run that was killed; removed"]
    assert names(out / "grid") == ["notes.txt"]
    assert names(out) == ["a.csv", "grid", "manifest.json"]


def test_foreign_files_stay(tmp_path):
    """Names that look like ours, without a lock of ours, are somebody's."""
    kept = [".windmark-0123456789ab.csv", ".windmark-notes.txt", ".windmark-xyz.lock", "0123456789ab.lock"]
    for name in kept:
        (tmp_path / name).write_text("mine")
    assert left_behind(tmp_path) == []
    with atomic_path(tmp_path / "a.csv") as place:
        place.write_text("1")
    assert names(tmp_path) == sorted([*kept, "a.csv"])


def test_what_another_process_writes_just_now_is_left_alone(tmp_path):
    """Both write the same file; the last one wins, as ever."""
    target = tmp_path / "table.csv"
    other = subprocess.Popen([sys.executable, "-c", WRITES, str(target)], stdout=subprocess.PIPE, text=True)
    try:
        name = other.stdout.readline().strip()
        assert left_behind(tmp_path) == []
        with atomic_path(target) as place:
            assert place.name != name
            place.write_text("new")
        assert target.read_text() == "new"
        assert name in names(tmp_path)
    finally:
        other.kill()
        other.communicate()
    assert left_behind(tmp_path) == [tmp_path / name]
    assert names(tmp_path) == ["table.csv"]


def test_names_without_and_with_odd_extensions(tmp_path):
    for name in ("README", "a.lock", "b.tar.gz", ".hidden"):
        left = killed(tmp_path / name)
        assert left_behind(tmp_path) == [tmp_path / left], name
        with atomic_path(tmp_path / name) as place:
            place.write_text(name)
    assert names(tmp_path) == sorted(["README", "a.lock", "b.tar.gz", ".hidden"])


def test_a_folder_of_files_that_was_killed_is_finished_by_the_next_one(tmp_path):
    """Killed between two moves: half of the new files were there, and no list said what was missing."""

    def run(target, at):
        real, calls = exchange.replace_file, []

        def replace(source, place):
            calls.append(place)
            if len(calls) == at:
                os.kill(os.getpid(), signal.SIGKILL)
            real(source, place)

        exchange.replace_file = replace
        with atomic_folder(target) as place:
            for name in "abc":
                (place / name).write_text("2")

    old, new = {"a": "1", "b": "1", "z": "1"}, {"a": "2", "b": "2", "c": "2", "z": "1"}
    for at in range(1, 7):  # what is to be done noted, two away, three in their place
        out = tmp_path / str(at)
        out.mkdir()
        for name in "abz":
            (out / name).write_text("1")
        assert ended(lambda out=out, at=at: run(out, at)) == -signal.SIGKILL
        with pytest.raises(RuntimeError), atomic_folder(out):
            raise RuntimeError
        assert {p.name: p.read_text() for p in out.iterdir()} == (old if at == 1 else new)
    assert names(tmp_path) == [str(k) for k in range(1, 7)]


def test_a_folder_in_the_way_is_not_replaced(tmp_path):
    (tmp_path / "out" / "a").mkdir(parents=True)
    (tmp_path / "out" / "a" / "mine").write_text("1")


    def write():
        with atomic_folder(tmp_path / "out") as place:
            (place / "a").write_text("2")
            (place / "0").write_text("2")

    with pytest.raises(FileError, match="cannot be written"):
        write()
    assert names(tmp_path / "out") == ["a"]
    assert (tmp_path / "out" / "a" / "mine").read_text() == "1"


def test_a_disk_too_full_for_the_name_of_the_process_keeps_nothing_of_ours(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    target = tmp_path / "table.csv"
    target.write_text("old")
    with monkeypatch.context() as patch:
        patch.setattr(os, "write", full)
        with pytest.raises(FileError, match=r"table\.csv: cannot be written: the disk is full"), atomic_path(target):
            pass
    assert target.read_text() == "old"
    assert names(tmp_path) == ["table.csv"]
