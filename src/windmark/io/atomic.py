"""Outputs appear whole or not at all: written beside the target, then renamed."""

from __future__ import annotations

import errno
import io
import os
import secrets
import shutil
import time
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from windmark.io.errors import NO_SPACE, FileError, reason
from windmark.io.staging import resolved, stage

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
        When the operating system refuses (disk full, no such folder, read-only): names ``path`` and the reason.
    """
    target = _checked_target(path)
    if os.path.exists(target) and not target.is_file():
        with writing(path, target):
            yield target
        return
    temporary = target.with_name(f".windmark-{secrets.token_hex(6)}{target.suffix}")
    try:
        with writing(path, target, temporary):
            temporary.touch(exist_ok=False)  # says early that the folder cannot be written to
            yield temporary
            if os.path.exists(target):
                shutil.copymode(target, temporary)
            replace_file(temporary, target)
    finally:
        with suppress(OSError):  # gone already when all went well
            temporary.unlink(missing_ok=True)


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

    Gives the temporary name of each.
    """
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


def try_paths(paths: Iterable[Path]) -> None:
    """Try that these files can be written, before the work that their content takes.

    Raises
    ------
    FileError
        For the first one that cannot, with the reason.
    """
    for path in paths:
        target = _checked_target(path)
        if not os.path.exists(target) or target.is_file():
            temporary = target.with_name(f".windmark-{secrets.token_hex(6)}{target.suffix}")
            with writing(path, target, temporary):
                temporary.touch(exist_ok=False)
                temporary.unlink()


@contextmanager
def atomic_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a temporary folder; the files written there move into ``path`` together when the block ends.

    ``path`` is created when missing (its parent must exist). Files of the same name are replaced,
    other files in ``path`` stay. Any exception leaves ``path`` as it was. For the result of a job: `result_folder`.

    Raises
    ------
    FileError
        When the operating system refuses (before anything is written, if it can be known then), or another process
        writes there: names ``path`` and the reason.
    """
    staging = stage(path, parents=False)
    try:
        with writing(path, staging.target, staging.hidden):
            staging.clear()
            staging.new.mkdir()
            yield staging.new
            _move_all(staging.new, staging.target, staging.old)
    finally:
        staging.release()


def _move_all(new: Path, target: Path, old: Path) -> None:
    """Move every file of ``new`` to ``target``; on any failure put everything back."""
    created = not target.exists()
    done: list[tuple[Path, Path, bool]] = []
    try:
        for source in sorted(p for p in new.rglob("*") if p.is_file()):
            name = source.relative_to(new)
            place, backup = target / name, old / name
            place.parent.mkdir(parents=True, exist_ok=True)
            backup.parent.mkdir(parents=True, exist_ok=True)
            replaced = place.exists()
            done.append((place, backup, replaced))
            if replaced:
                replace_file(place, backup)
            replace_file(source, place)
        target.mkdir(exist_ok=True)
    except BaseException:
        for place, backup, replaced in reversed(done):
            with suppress(OSError):
                if not replaced:
                    place.unlink(missing_ok=True)
                elif backup.exists():
                    os.replace(backup, place)
        if created:
            shutil.rmtree(target, ignore_errors=True)
        raise


def _checked_target(path: str | os.PathLike[str]) -> Path:
    target = resolved(path)
    # os.path, not Path: a name the system cannot even look up is simply not there.
    if os.path.isdir(target):
        raise FileError(path, "this is a folder; expected a file name")
    if not os.path.isdir(target.parent):
        raise FileError(path, f"cannot be written: the folder {target.parent} does not exist")
    if os.path.exists(target) and not os.access(target, os.W_OK):
        raise FileError(path, "cannot be written: the file is write-protected")
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
