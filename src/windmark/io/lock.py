"""Locks of files: the operating system lets go of them when their process ends, however it ends."""

from __future__ import annotations

import errno
import os
import socket
import time
from contextlib import suppress
from pathlib import Path

TRIES = 20
"""Rounds in which the lock of a run that just ended may vanish under our hands."""
_SIGNED = 200
"""Bytes of the text in a lock file: always the same, as Windows may refuse to cut a file of which a part is locked."""
_DELETED_S = 0.05
_FAR = 1 << 30
"""Where Windows locks a byte: far behind the text, which others may read then; a file need not reach so far."""


def taken(file: Path) -> int | None:
    """Descriptor of a lock file, made if it is not there and locked by us; None where another process holds it.

    On a disk without locks it is made and nothing more.

    Raises
    ------
    OSError
        Where it cannot be made.
    """
    for k in range(TRIES):
        try:
            lock = os.open(file, os.O_RDWR | os.O_CREAT, 0o666)
        except PermissionError:
            being_removed(k)
            continue
        try:
            free = locked(lock)
        except NotImplementedError:
            return lock
        except BaseException:
            os.close(lock)
            raise
        if not free:
            os.close(lock)
            return None
        if claimed(lock, file):
            return lock
    return None


def claimed(lock: int, file: Path) -> bool:
    """Sign a lock file that we have just locked; False, and closed, where it is no longer the one of this name.

    Raises
    ------
    OSError
        Where the disk is too full for it; nothing of ours stays there.
    """
    if not is_file(lock, file):
        unlocked(lock)
        return False
    try:
        sign(lock)
    except BaseException:
        let_go(lock, file)
        raise
    return True


def being_removed(k: int) -> None:
    """For a name that the system just denied, in round ``k`` of `TRIES`: give it time, or raise that error again.

    Windows denies access to a name while it removes what had it, until the last program that looks at it closes it.
    """
    if os.name != "nt" or k == TRIES - 1:
        raise
    time.sleep(_DELETED_S)


def locked(lock: int) -> bool:
    """Take the lock of an open file, if it is free.

    Raises
    ------
    NotImplementedError
        On a disk without locks.
    """
    return _locked_on_windows(lock) if os.name == "nt" else _locked_on_posix(lock)


def unlocked(lock: int) -> None:
    """Close the file; its lock is free at once. (Windows frees the locks of a closed file only when it finds time.)"""
    if os.name == "nt":
        import msvcrt

        with suppress(OSError):
            os.lseek(lock, _FAR, os.SEEK_SET)
            msvcrt.locking(lock, msvcrt.LK_UNLCK, 1)  # type: ignore[attr-defined]
    os.close(lock)


def let_go(lock: int, file: Path) -> None:
    """Remove a lock file that we hold."""
    # It is removed while it is locked: who waits for it sees that it is gone and begins anew.
    if os.name == "nt":  # an open file cannot be removed there
        unlocked(lock)
    with suppress(OSError):
        file.unlink(missing_ok=True)
    if os.name != "nt":
        os.close(lock)


def sign(lock: int) -> None:
    """Write into a lock file whose it is.

    Raises
    ------
    OSError
        Where the disk is full.
    """
    os.lseek(lock, 0, os.SEEK_SET)
    os.write(lock, f"process {os.getpid()} on {socket.gethostname()}".encode()[:_SIGNED].ljust(_SIGNED))


def holder(lock: int) -> str:
    """The process, in words, that has signed a lock file."""
    with suppress(OSError, UnicodeDecodeError):
        os.lseek(lock, 0, os.SEEK_SET)
        return os.read(lock, _SIGNED).decode().strip() or "it has just begun"
    return "its process is not known"


def is_file(lock: int, file: Path) -> bool:
    """Whether the open file is the one of this name: it may have been removed meanwhile."""
    with suppress(OSError):
        return os.path.samestat(os.fstat(lock), os.stat(file))
    return False


def _locked_on_windows(lock: int) -> bool:
    import msvcrt

    os.lseek(lock, _FAR, os.SEEK_SET)
    try:
        msvcrt.locking(lock, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
    except OSError as error:
        if error.errno in (errno.EACCES, errno.EDEADLK):  # the two that its documentation names for a taken one
            return False
        raise NotImplementedError from error  # a share that has none says EINVAL
    finally:
        os.lseek(lock, 0, os.SEEK_SET)
    return True


def _locked_on_posix(lock: int) -> bool:
    import fcntl

    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError as error:
        if error.errno in (errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS):
            raise NotImplementedError from error
        raise
    return True
