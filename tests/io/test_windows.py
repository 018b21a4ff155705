"""What Windows does otherwise: the branches that windmark has for it are run here, on a system that acts like it."""

from __future__ import annotations

import ctypes
import errno
import os
import sys
import types
from pathlib import Path

import pytest

from windmark.io import FileError, _limits, atomic, lock, making, reason, result_folder, staging


class Windows:
    """The module `os` as it is, but for its name, and for files that Windows does not remove while they are open."""

    name = "nt"

    def __init__(self):
        self.open_files = {}

    def __getattr__(self, name):
        return getattr(os, name)

    def open(self, path, *rest):
        number = os.open(path, *rest)
        self.open_files[number] = os.path.abspath(path)
        return number

    def close(self, number):
        self.open_files.pop(number, None)
        os.close(number)


class Locks:
    """`msvcrt.locking` as documented: one byte, for one handle, until it is unlocked by that."""

    LK_NBLCK, LK_UNLCK = 2, 0

    def __init__(self):
        self.held = {}
        self.refuse = None

    def locking(self, number, mode, count):
        assert count == 1
        stat, at = os.fstat(number), os.lseek(number, 0, os.SEEK_CUR)
        assert at > 1000, "the text in front must stay readable"
        key = (stat.st_dev, stat.st_ino, at)
        if mode == self.LK_UNLCK:
            if self.held.get(key) != number:
                raise OSError(errno.EACCES, "Permission denied")
            del self.held[key]
            return
        if self.refuse is not None:
            raise OSError(self.refuse, "Invalid argument")
        if key in self.held:
            raise OSError(errno.EACCES, "Permission denied")
        self.held[key] = number


@pytest.fixture
def windows(monkeypatch):
    """Windows and its locks."""
    system, locks = Windows(), Locks()
    for module in (lock, making, staging):
        monkeypatch.setattr(module, "os", system)
    monkeypatch.setitem(sys.modules, "msvcrt", locks)
    real = Path.unlink

    def unlink(self, missing_ok=False):
        if os.path.abspath(self) in system.open_files.values():
            raise PermissionError(errno.EACCES, "it is open", str(self))
        real(self, missing_ok)

    monkeypatch.setattr(Path, "unlink", unlink)
    return types.SimpleNamespace(os=system, locks=locks)


def names(folder):
    return sorted(p.name for p in folder.rglob("*"))


def test_a_folder_is_held_by_one_run_and_free_after_it(windows, tmp_path):
    out = tmp_path / "out"
    with result_folder(out) as first:
        (first.place / "a").write_text("1")
        held = pytest.raises(FileError, match=rf"another run .*\(process {os.getpid()} on .*\); wait")
        with held, result_folder(out):
            pass
        assert staging.in_use(tmp_path / ".windmark-out").startswith(f"process {os.getpid()} on ")
    assert not windows.locks.held  # let go of by hand: a close alone frees it when Windows finds time
    assert not windows.os.open_files
    assert names(tmp_path) == ["a", "manifest.json", "out"]
    with result_folder(out) as second:
        (second.place / "b").write_text("2")
    assert names(tmp_path) == ["b", "manifest.json", "out"]


def test_asking_whether_a_folder_is_held_does_not_hold_it(windows, tmp_path):
    (tmp_path / "hidden").mkdir()
    (tmp_path / "hidden" / "lock").write_bytes(b"process 1 on somewhere")
    assert staging.in_use(tmp_path / "hidden") == ""
    assert not windows.locks.held


def test_a_share_without_locks_is_said_and_used(windows, tmp_path):
    """It was taken for a folder that another run holds: no result could be put there."""
    windows.locks.refuse, said = errno.EINVAL, []
    with result_folder(tmp_path / "out", say=said.append) as out:
        (out.place / "a").write_text("1")
    assert said == ["this disk has no locks: a second run into the same folder would not be noticed"]
    assert names(tmp_path) == ["a", "manifest.json", "out"]


def test_a_name_that_is_just_being_removed_is_waited_for(windows, tmp_path, monkeypatch):
    """Windows denies access to it until the last program that has it open closes it."""
    real, tries = Path.mkdir, []

    def mkdir(self, *rest, **more):
        if self.name == ".windmark-out" and len(tries) < 3:
            tries.append(self)
            raise PermissionError(errno.EACCES, "Access is denied", str(self))
        real(self, *rest, **more)

    monkeypatch.setattr(Path, "mkdir", mkdir)
    with result_folder(tmp_path / "out") as out:
        (out.place / "a").write_text("1")
    assert len(tries) == 3
    assert names(tmp_path) == ["a", "manifest.json", "out"]


def test_a_single_file_lets_go_of_its_lock_by_hand(windows, tmp_path):
    """And what a killed run left of another one is removed, though Windows does not remove an open file."""
    (tmp_path / ".windmark-0123456789ab.csv").write_text("half")
    (tmp_path / ".windmark-0123456789ab.lock").write_bytes(b"process 1 on somewhere")
    atomic.try_paths([tmp_path / "a.csv"])
    with atomic.atomic_write(tmp_path / "a.csv") as stream:
        stream.write("1")
        assert making.left_behind(tmp_path) == []  # its process lives
    assert not windows.locks.held
    assert not windows.os.open_files
    assert names(tmp_path) == ["a.csv"]


def test_the_lock_of_a_single_file_that_is_just_being_removed_is_waited_for(windows, tmp_path, monkeypatch):
    opened, tries = windows.os.open, []

    def denied(path, *rest):
        if len(tries) < 3:
            tries.append(path)
            raise PermissionError(errno.EACCES, "Access is denied", str(path))
        return opened(path, *rest)

    monkeypatch.setattr(windows.os, "open", denied)
    with atomic.atomic_write(tmp_path / "a.csv") as stream:
        stream.write("1")
    assert len(tries) == 3
    assert names(tmp_path) == ["a.csv"]


def test_a_file_that_a_scanner_holds_for_a_moment_is_waited_for(tmp_path, monkeypatch):
    replace, tries = os.replace, []

    def held(source, target):
        tries.append(target)
        if len(tries) < 3:
            raise PermissionError(errno.EACCES, "in use", str(target))
        replace(source, target)

    monkeypatch.setattr(os, "replace", held)
    monkeypatch.setattr(atomic, "_RETRY_AFTER_S", (0.0, 0.0, 0.0))
    with atomic.atomic_write(tmp_path / "a.csv") as stream:
        stream.write("1")
    assert (tmp_path / "a.csv").read_text() == "1"
    assert len(tries) == 3


def on_windows(number, code, path="C:\\data\\a.csv"):
    """An error as Windows has them: with a number of its own beside that of POSIX."""
    error = OSError(code, "words in the language of the system", path)
    error.winerror = number
    return error


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (on_windows(32, errno.EACCES), "another program has it open"),
        (on_windows(5, errno.EACCES), "permission denied"),
        (on_windows(19, errno.EACCES), "the disk is read-only"),
        (on_windows(112, errno.ENOSPC), "the disk is full"),
        (on_windows(206, errno.ENOENT), "the name is too long"),
        (on_windows(123, errno.EINVAL), "the name has a sign that Windows does not take"),
        (on_windows(3, errno.ENOENT), "no such file"),
        (on_windows(3, errno.ENOENT, "/" + "folder/" * 40), "its path is longer than Windows takes unless long paths"
                                                            " are switched on"),
    ],
)  # fmt: skip
def test_errors_of_windows_in_words(error, words):
    assert reason(error) == words


def test_the_limits_of_a_job_have_the_layout_of_windows():
    """JOBOBJECT_EXTENDED_LIMIT_INFORMATION of winnt.h on 64 bits."""
    assert ctypes.sizeof(_limits.JobLimits) == 144
    assert _limits.JobLimits.flags.offset == 16
    assert _limits.JobLimits.process_memory.offset == 112
