"""Outputs appear whole or not at all, whatever interrupts the writing."""

from __future__ import annotations

import errno
import os
import pickle
import signal
import stat
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from windmark.io import (
    FileError,
    atomic,
    atomic_folder,
    atomic_path,
    atomic_paths,
    atomic_write,
    try_paths,
    write_image,
    write_images,
    write_json,
    write_table,
)
from windmark.io.errors import reading

OLD = "the old content\n"


@pytest.fixture
def target(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text(OLD)
    return path


def names(folder):
    return sorted(p.name for p in folder.iterdir())


def full_disk(*_args, **_kwargs):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def write(path, text, then=lambda: None):
    with atomic_write(path) as stream:
        stream.write(text)
        stream.flush()
        then()


def fill(folder, names, then=lambda: None):
    with atomic_folder(folder) as new:
        for name in names:
            (new / name).write_text("new")
        then()


def throw(error):
    raise error


def test_writes_and_keeps_line_ends(tmp_path):
    path = tmp_path / "new.txt"
    with atomic_write(path) as stream:
        stream.write("a\r\nb\nµ")
        assert not path.exists()
    assert path.read_bytes() == "a\r\nb\nµ".encode()
    assert names(tmp_path) == ["new.txt"]


def test_replaces_old_file_only_at_the_end(target):
    with atomic_write(target, "wb") as stream:
        stream.write(b"new")
        stream.flush()
        assert target.read_text() == OLD
    assert target.read_bytes() == b"new"


def test_temporary_name_has_the_extension(tmp_path):
    with atomic_path(tmp_path / "picture.png") as temporary:
        assert temporary.suffix == ".png"
        assert temporary.parent == tmp_path
        temporary.write_bytes(b"x")
    assert names(tmp_path) == ["picture.png"]


@pytest.mark.parametrize("interruption", [KeyboardInterrupt, SystemExit, RuntimeError, GeneratorExit])
def test_any_exception_leaves_the_old_file(target, interruption):
    with pytest.raises(interruption):
        write(target, "half a li", then=lambda: throw(interruption))
    assert target.read_text() == OLD
    assert names(target.parent) == ["table.csv"]


def test_disk_full_while_writing(target):
    with pytest.raises(FileError, match=r"table\.csv: cannot be written: the disk is full") as caught:
        write(target, "half", then=full_disk)
    assert caught.value.path == target
    assert target.read_text() == OLD
    assert names(target.parent) == ["table.csv"]


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="the system has no /dev/full")
def test_disk_really_full():
    with pytest.raises(FileError, match="/dev/full: cannot be written: the disk is full"):
        write("/dev/full", "x" * 100_000)
    assert stat.S_ISCHR(os.stat("/dev/full").st_mode)


@pytest.mark.skipif(not os.path.exists("/dev/null"), reason="the system has no /dev/null")
def test_a_device_is_written_to_and_never_replaced():
    write("/dev/null", "x")
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)


def test_failing_rename_leaves_the_old_file(target, monkeypatch):
    monkeypatch.setattr(atomic.os, "replace", full_disk)
    with pytest.raises(FileError, match="the disk is full"):
        write(target, "new")
    assert target.read_text() == OLD
    assert names(target.parent) == ["table.csv"]


def test_a_short_lock_is_waited_for(target, monkeypatch):
    attempts = []
    really = os.replace

    def locked_twice(source, place):
        attempts.append(place)
        if len(attempts) < 3:
            raise PermissionError(errno.EACCES, "in use", str(source))
        really(source, place)

    monkeypatch.setattr(atomic.os, "replace", locked_twice)
    monkeypatch.setattr(atomic, "_RETRY_AFTER_S", (0.0, 0.0))
    write(target, "new")
    assert target.read_text() == "new"
    assert len(attempts) == 3


def test_error_about_another_file_is_not_blamed_on_the_target(target):
    with pytest.raises(FileNotFoundError):
        write(target, "half", then=(target.parent / "missing").read_text)
    assert target.read_text() == OLD


@pytest.mark.parametrize(
    ("name", "word"),
    [("", "this is a folder"), ("no/such/x.csv", "does not exist"), ("n" * 300, "name is too long")],
)
def test_impossible_targets(tmp_path, name, word):
    with pytest.raises(FileError, match=word), atomic_write(tmp_path / name):
        pass
    assert names(tmp_path) == []


def test_write_protected_file_is_respected(target, monkeypatch):
    monkeypatch.setattr(atomic.os, "access", lambda *_: False)  # root may write anything
    with pytest.raises(FileError, match="write-protected"), atomic_write(target):
        pass
    assert target.read_text() == OLD


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such permissions, and links need rights")
def test_permissions_and_links_survive(target):
    target.chmod(0o640)
    link = target.parent / "link.csv"
    link.symlink_to(target)
    with atomic_write(link) as stream:
        stream.write("new")
    assert link.is_symlink()
    assert target.read_text() == "new"
    assert stat.S_IMODE(target.stat().st_mode) == 0o640


def test_unknown_mode(tmp_path):
    with pytest.raises(ValueError, match="mode must be 'w' or 'wb', got 'a'"), atomic_write(tmp_path / "x", "a"):
        pass


# --- folders -------------------------------------------------------------------------------


def test_folder_is_created_whole(tmp_path):
    with atomic_folder(tmp_path / "out") as new:
        (new / "a.txt").write_text("a")
        (new / "sub").mkdir()
        (new / "sub" / "b.txt").write_text("b")
        assert not (tmp_path / "out").exists()
    assert (tmp_path / "out" / "sub" / "b.txt").read_text() == "b"
    assert names(tmp_path) == ["out"]


def test_folder_keeps_other_files(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "mine.txt").write_text("mine")
    (out / "a.txt").write_text("old")
    with atomic_folder(out) as new:
        (new / "a.txt").write_text("new")
    assert (out / "a.txt").read_text() == "new"
    assert (out / "mine.txt").read_text() == "mine"
    assert names(tmp_path) == ["out"]


@pytest.mark.parametrize("exists", [True, False])
@pytest.mark.parametrize("fails_at", [0, 1, 2, 3])
def test_folder_is_rolled_back(tmp_path, monkeypatch, exists, fails_at):
    out = tmp_path / "out"
    if exists:
        out.mkdir()
        for name in "ab":
            (out / name).write_text("old")
    really, calls = os.replace, []

    def fails_once(source, place):
        if place.name == ".windmark-probe":  # the trial before the work
            return really(source, place)
        calls.append(place)
        if len(calls) - 1 == fails_at:
            full_disk()
        return really(source, place)

    monkeypatch.setattr(atomic.os, "replace", fails_once)
    with pytest.raises(FileError, match="out: cannot be written"):
        fill(out, "abcd")
    assert names(tmp_path) == (["out"] if exists else [])
    if exists:
        assert {name: (out / name).read_text() for name in names(out)} == {"a": "old", "b": "old"}


def test_folder_interrupted(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        fill(tmp_path / "out", "a", then=lambda: throw(KeyboardInterrupt))
    assert names(tmp_path) == []


def test_folder_that_cannot_be(target):
    with pytest.raises(FileError, match="this is a file; expected a folder"), atomic_folder(target):
        pass
    with pytest.raises(FileError, match="does not exist"), atomic_folder(target.parent / "no" / "out"):
        pass


# --- the error -----------------------------------------------------------------------------


def test_message_place_and_pickle():
    error = FileError("a/b.csv", "x is 'abc'; expected a number", 7)
    assert str(error) == "a/b.csv: line 7: x is 'abc'; expected a number"
    again = pickle.loads(pickle.dumps(error))
    assert (str(again), again.path, again.where) == (str(error), error.path, "line 7")
    assert FileError("f", "bad", "key 'K'").where == "key 'K'"
    assert str(FileError("f", "bad")) == "f: bad"


def test_reading_names_the_reason(tmp_path):
    with pytest.raises(FileError, match="no such file"), reading(tmp_path / "x"):
        (tmp_path / "x").read_text()
    with pytest.raises(FileError, match="this is a folder"), reading(tmp_path):
        tmp_path.read_text()


# --- a disk that is really too small ---------------------------------------------------------


@pytest.mark.skipif(os.name == "nt", reason="Windows has no limit on the size of files")
@pytest.mark.parametrize("name", ["t.csv", "v.json", "g.png", "g.tif", "g.jpg", "s.tif"])
def test_every_writer_survives_a_full_disk(tmp_path, name):
    import resource  # not there on Windows

    noise = np.random.default_rng(0).integers(0, 256, (200, 200), dtype=np.uint8)
    writers = {
        "t.csv": lambda path: write_table(path, {"x": noise.ravel() / 7}),
        "v.json": lambda path: write_json(path, {"x": noise}),
        "s.tif": lambda path: write_images(path, [noise] * 3),
    }
    path = tmp_path / name
    path.write_text(OLD)
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, limit[1]))
    try:
        with pytest.raises(FileError, match=rf"{name}: cannot be written: ") as caught:
            writers.get(name, lambda path: write_image(path, noise))(path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    assert caught.value.path == path
    assert path.read_text() == OLD
    assert names(tmp_path) == [name]


@pytest.mark.skipif(os.name == "nt", reason="Ctrl-C is sent in another way on Windows")
def test_ctrl_c_in_the_middle_of_a_long_table(tmp_path):
    code = (
        "import numpy as np, pathlib, sys, windmark.io as io\n"
        "print('ready', flush=True)\n"
        "io.write_table(sys.argv[1], {'x': np.random.default_rng(0).random(3_000_000)})\n"
    )
    path = tmp_path / "t.csv"
    path.write_text(OLD)
    process = subprocess.Popen([sys.executable, "-c", code, str(path)], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    process.stdout.readline()
    while process.poll() is None and len(names(tmp_path)) < 2:
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert b"KeyboardInterrupt" in errors
    assert path.read_text() == OLD
    assert names(tmp_path) == ["t.csv"]


def test_two_outputs_of_one_name_are_refused(tmp_path):
    one, same = tmp_path / "d.csv", tmp_path / "sub" / ".." / "d.csv"
    (tmp_path / "sub").mkdir()
    for paths in ([one, one], [one, same]):
        with pytest.raises(FileError, match="two outputs have this name"):
            try_paths(paths)
        with pytest.raises(FileError, match="two outputs have this name"), atomic_paths(paths):
            pass
    assert not one.exists()
    try_paths([one, tmp_path / "e.csv"])


@pytest.mark.skipif(os.name == "nt", reason="there is no such device")
def test_a_device_takes_two_outputs():
    try_paths([Path(os.devnull), Path(os.devnull)])
