"""The one error for files that cannot be read or written."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

from windmark.errors import WindmarkError

LARGEST = 1e18
"""A number of a file beyond it is a mistake (no length, angle, time or grey level in any unit), and what is reckoned
with it would overflow: products of six pairs of them, as in the determinant of a covariance, stay finite."""
LONGEST_NAME = 256
"""Characters of a name: as an array it takes for every row or triangle as much memory as the longest of them."""


class FileError(WindmarkError):
    """A file that is missing, damaged, not what was expected, or cannot be written.

    The message is ``PATH: WHERE: what is wrong; expected ...``, on one line of bounded length, whatever the file holds.

    Parameters
    ----------
    path : the file
    what : what is wrong and what was expected
    where : the place in the file: a line number (1-based), or a key in words; None for the whole file

    Examples
    --------
    >>> import windmark as wm
    >>> try:
    ...     wm.read_markers("no_such_table.csv")
    ... except wm.FileError as error:
    ...     print(error)
    no_such_table.csv: no such file
    """

    def __init__(self, path: str | os.PathLike[str], what: str, where: int | str | None = None) -> None:
        place = f"line {where}" if isinstance(where, int) else None if where is None else _one_line(where, 200)
        what = _one_line(what, 800)
        super().__init__(": ".join(str(part) for part in (os.fspath(path), place, what) if part))
        self.path = Path(path)
        self.what = what
        self.where = place

    def __reduce__(self) -> tuple[type[FileError], tuple[str, str, str | None]]:
        # The default rebuilds from the message alone, and errors must cross process borders.
        return type(self), (os.fspath(self.path), self.what, self.where)


def _one_line(text: str, most: int) -> str:
    """Words of a file inside a message, without its line ends; the middle of what is too long is left out."""
    line = " ".join(text.splitlines()) if len(text.splitlines()) > 1 else text
    return line if len(line) <= most else f"{line[: most // 2]} ... {line[-most // 2 :]}"


_REASONS = {
    errno.ENOENT: "no such file",
    errno.EISDIR: "this is a folder; expected a file",
    errno.EACCES: "permission denied",
    errno.EPERM: "permission denied",
    errno.ENOSPC: "the disk is full",
    getattr(errno, "EDQUOT", -1): "the disk quota is used up",
    errno.EFBIG: "the file is larger than is allowed",
    errno.EROFS: "the disk is read-only",
    errno.ENAMETOOLONG: "the name is too long",
    errno.ENOTDIR: "a part of its path is a file; expected a folder",
    errno.ELOOP: "its links lead in a circle",
    errno.EXDEV: "it lies on another disk",
    errno.EIO: "the disk has a fault",
}


NO_SPACE = (errno.ENOSPC, getattr(errno, "EDQUOT", -1))
"""What the system says of a disk, or a share of it, that is full."""


_REASONS_ON_WINDOWS = {
    19: _REASONS[errno.EROFS],
    32: "another program has it open",
    33: "another program has it open",
    39: _REASONS[errno.ENOSPC],
    112: _REASONS[errno.ENOSPC],
    123: "the name has a sign that Windows does not take",
    206: _REASONS[errno.ENAMETOOLONG],
    1295: _REASONS[errno.EDQUOT] if hasattr(errno, "EDQUOT") else _REASONS[errno.ENOSPC],
}
"""By Windows' own numbers (winerror.h): POSIX' are "permission denied" or "no such file" for some."""
_LONGEST_ON_WINDOWS = 247
"""Signs of a path (MAX_PATH less a name of DOS) up to which Windows makes folders unless long paths are switched on."""


def reason(error: OSError) -> str:
    """The operating system's error in words, without its path."""
    on_windows = getattr(error, "winerror", None)
    if on_windows in _REASONS_ON_WINDOWS:
        return _REASONS_ON_WINDOWS[on_windows]
    path = error.filename2 or error.filename
    if on_windows in (2, 3) and isinstance(path, str) and len(os.path.abspath(path)) > _LONGEST_ON_WINDOWS:
        return "its path is longer than Windows takes unless long paths are switched on"
    return _REASONS.get(error.errno or 0) or error.strerror or str(error) or type(error).__name__


def refusal(error: FileError) -> OSError | None:
    """What the operating system said, where that is behind an error."""
    cause: BaseException | None = error
    while cause is not None and not isinstance(cause, OSError):
        cause = cause.__cause__
    return cause


def space_on(path: Path) -> str:
    """The disk on which ``path`` is or would be, and what is free of it, in words; "" where that is not known."""
    for place in (path, *path.parents):
        with suppress(OSError):
            usage, real = shutil.disk_usage(place), Path(os.path.realpath(place))
            top = next(p for p in (real, *real.parents) if os.path.ismount(p) or p == p.parent)
            return f"disk {top} has {usage.free / 1e6:.1f} of {usage.total / 1e6:.1f} MB free"
    return ""


FileState = tuple[int, int] | None
"""Size and date (ns) of a file; None where it has none."""
_WITNESSES: list[dict[str, FileState]] = []
"""Of jobs that want to know which files were read: the outermost first."""


@contextmanager
def witness() -> Iterator[dict[str, FileState]]:
    """The paths of all files that are read in this block, by any thread, with their state as they were read last; an
    outer block's, where there is one.
    """
    if _WITNESSES:
        yield _WITNESSES[0]
        return
    seen: dict[str, FileState] = {}
    _WITNESSES.append(seen)
    try:
        yield seen
    finally:
        del _WITNESSES[next(k for k, other in enumerate(_WITNESSES) if other is seen)]


_NOTED: ContextVar[tuple[set[str], ...]] = ContextVar("noted", default=())


@contextmanager
def noted() -> Iterator[set[str]]:
    """The paths of all files that this thread reads in this block, also those of a block within it; see `witness` for
    those of a whole job. A run that goes on must find them as they were.
    """
    seen: set[str] = set()
    before = _NOTED.set((*_NOTED.get(), seen))
    try:
        yield seen
    finally:
        _NOTED.reset(before)


def file_state(path: str | os.PathLike[str]) -> FileState:
    """What tells whether a file was changed."""
    try:
        stat = os.stat(path)
    except (OSError, ValueError):
        return None
    return stat.st_size, stat.st_mtime_ns


def was_read(path: Path) -> bool:
    """Whether a file is one that the job at work has read: its own input, by whatever name."""
    return any(os.path.realpath(name) == os.path.realpath(path) for seen in _WITNESSES for name in tuple(seen))


def note_read(path: str | os.PathLike[str]) -> None:
    """Note that a file is read, as `reading` does; for files that others read: a library, a process apart, Python."""
    for seen in _WITNESSES:
        seen[os.path.abspath(path)] = file_state(path)
    for noted_here in _NOTED.get():
        noted_here.add(os.path.abspath(path))


@contextmanager
def reading(path: str | os.PathLike[str]) -> Iterator[None]:
    """Turn what the operating system says against reading ``path`` into `FileError`."""
    note_read(path)
    try:
        yield
    except OSError as error:
        # Windows calls opening a folder "permission denied".
        what = _REASONS[errno.EISDIR] if os.path.isdir(path) else reason(error)
        raise FileError(path, what) from error


def was_read_before(path: str | os.PathLike[str], state: FileState) -> None:
    """Note that a file was read, in this state, by the run that this one goes on with."""
    for seen in _WITNESSES:
        seen[os.path.abspath(path)] = state


@contextmanager
def decoding(path: str | os.PathLike[str]) -> Iterator[None]:
    """Whatever a decoder raises on a damaged file becomes `FileError`."""
    with reading(path):
        try:
            yield
        except FileError:
            raise
        except MemoryError as error:
            raise FileError(path, "damaged, or too large for the memory") from error
        except Exception as error:  # decoders raise nearly anything
            if isinstance(error, OSError) and error.errno not in (None, errno.EINVAL):
                raise  # the operating system's own refusal; EINVAL is a place before the file's start
            said = " ".join(str(error).split())[:300]
            raise FileError(path, f"damaged or cut off: {said or type(error).__name__}") from error
