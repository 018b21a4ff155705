"""Outputs appear whole or not at all: written beside the target, then renamed."""

from __future__ import annotations

import errno
import io
import os
import shutil
import time
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO, Any

from windmark.io.errors import NO_SPACE, FileError, reason, was_read
from windmark.io.interrupts import interrupts_wait
from windmark.io.making import PREFIX, Making, left_behind, making
from windmark.io.staging import Say, resolved, silent
from windmark.io.written import note_written

# A virus scanner or a viewer may hold a file on Windows for a moment; elsewhere a rename never has to wait.
_RETRY_AFTER_S: tuple[float, ...] = (0.05, 0.2, 0.5) if os.name == "nt" else ()


FULL = (*NO_SPACE, errno.EFBIG, errno.EROFS)
"""What the system says of a disk that takes no more."""


@contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a temporary file name beside ``path``; what is written there becomes ``path`` when the block ends.

    The temporary name has the extension of ``path``, so libraries that choose a format by it can
    write to it. Any exception, Ctrl-C included, removes the temporary file and leaves an older
    ``path`` as it was. Devices and pipes (``/dev/null``) are written directly. A link is followed.
    A file replaced keeps its permissions.

    Raises
    ------
    FileError
        When the operating system refuses (disk full, no such folder, read-only): names ``path`` and the reason; and
        where ``path`` is a file that the job at work has read (`witness`).
    """
    target = _checked_target(path)
    if os.path.exists(target) and not target.is_file():
        with writing(path, target):
            yield target
        return
    made: Making | None = None
    try:
        with writing(path, target, target.with_name(PREFIX)):
            with interrupts_wait():  # or a lock would be left that nobody knows of
                made = making(target)
            yield made.path
            if os.path.exists(target):
                shutil.copymode(target, made.path)
            with interrupts_wait():  # what ends the command either comes before the file is there, or knows of it
                replace_file(made.path, target)
                note_written(target)
    finally:
        if made is not None:
            with interrupts_wait():
                made.release()


@contextmanager
def atomic_write(path: str | os.PathLike[str], mode: str = "w") -> Iterator[IO[Any]]:
    """Open ``path`` for writing through `atomic_path`.

    Parameters
    ----------
    path : the file
    mode : "w" (text: UTF-8, line ends written as given) or "wb"
    """
    if mode not in ("w", "wb"):
        raise ValueError(f"atomic_write: mode must be 'w' or 'wb', got {mode!r}")
    text = {"encoding": "utf-8", "newline": ""} if mode == "w" else {}
    with atomic_path(path) as temporary, open(temporary, mode, **text) as stream:  # type: ignore[call-overload]
        yield stream


@contextmanager
def atomic_paths(paths: Iterable[Path]) -> Iterator[dict[Path, Path]]:
    """`atomic_path` for several files that belong together: none of them changes before all are written.

    Gives the temporary name of each. Raises `FileError` where two of them are one file: one would replace the other.
    """
    paths = list(paths)
    _refuse_twice(paths)
    with ExitStack() as stack:
        places = {path: stack.enter_context(atomic_path(path)) for path in paths}
        try:
            yield places
        except FileError as error:  # the user knows the file by its own name
            real = {temporary: path for path, temporary in places.items()}
            raise FileError(real.get(error.path, error.path), error.what, error.where) from error


class _Told(io.FileIO):
    """A file without a number: NumPy, handed one with a number, writes past Python and loses the system's reason."""

    def fileno(self) -> int:
        raise io.UnsupportedOperation("fileno")


def told_file(path: Path) -> IO[bytes]:
    """A new file for libraries that write arrays: a full disk is an `OSError` that says so.

    NumPy's own writing says only how many bytes it could not write.
    """
    return io.BufferedRandom(_Told(path, "w+"))


def try_paths(paths: Iterable[Path], say: Say = silent) -> None:
    """Try that these files can be written, before the work that their content takes.

    What killed processes left of files that they wrote beside them is removed, and told to ``say``.

    Raises
    ------
    FileError
        For the first one that cannot, with the reason; where two of them are one file.
    """
    paths = list(paths)
    _refuse_twice(paths)
    targets = {path: _checked_target(path) for path in paths}
    for folder in dict.fromkeys(target.parent for target in targets.values()):
        for file in left_behind(folder):
            say(f"{file} was left by a run that was killed; removed")
    for path, target in targets.items():
        if not os.path.exists(target) or target.is_file():
            with writing(path, target, target.with_name(PREFIX)):
                making(target).release()


def _refuse_twice(paths: Iterable[Path]) -> None:
    """Refuse two outputs of one name, by whatever way it is written; a device is not replaced and takes both."""
    seen: set[Path] = set()
    for path in paths:
        target = resolved(path)
        if target in seen and (target.is_file() or not os.path.exists(target)):
            raise FileError(path, "two outputs have this name, and one would replace the other; expected two names")
        seen.add(target)


def _checked_target(path: str | os.PathLike[str]) -> Path:
    target = resolved(path)
    # os.path, not Path: a name the system cannot even look up is simply not there.
    if os.path.isdir(target):
        raise FileError(path, "this is a folder; expected a file name")
    if not os.path.isdir(target.parent):
        raise FileError(path, f"cannot be written: the folder {target.parent} does not exist")
    if os.path.exists(target) and not os.access(target, os.W_OK):
        raise FileError(path, "cannot be written: the file is write-protected")
    if target.is_file() and was_read(target):
        raise FileError(path, "is an input of this run, and is not written over; choose another file for the output")
    return target


@contextmanager
def writing(path: str | os.PathLike[str], *ours: Path, only: bool = True) -> Iterator[None]:
    """`FileError` for refusals that concern our own file; an error about another file passes.

    ``only``: nothing else is done in the block, so that an error that names no file is about ours, too; otherwise it is
    only where it says that something is full or must not be written.
    """
    try:
        yield
    except OSError as error:
        named = error.filename
        if isinstance(named, str) and not named.startswith(tuple(map(str, ours))):
            raise
        if named is None and not only and error.errno not in FULL:
            raise
        raise FileError(path, f"cannot be written: {reason(error)}") from error


def replace_file(source: Path, target: Path) -> None:
    """Rename, over an older file; on Windows a file that somebody holds for a moment is waited for."""
    for delay_s in _RETRY_AFTER_S:
        try:
            os.replace(source, target)
        except PermissionError:
            time.sleep(delay_s)
        else:
            return
    os.replace(source, target)
