"""Single files in the making: a hidden name beside the target, held by a lock, so that what a kill leaves is known.

``.windmark-<12 hexadecimal digits>`` with the target's extension is the file, with ``.lock`` its lock. A name is ours,
and left behind, only where its lock is there and no process holds it; anything else in a folder is somebody's.
"""

from __future__ import annotations

import hashlib
import os
import re
import secrets
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from windmark.io.lock import is_file, let_go, locked, taken, unlocked

PREFIX = ".windmark-"
_LOCK = re.compile(rf"{re.escape(PREFIX)}[0-9a-f]{{12}}\.lock")
_MAKING = re.compile(rf"{re.escape(PREFIX)}[0-9a-f]{{12}}(\..*)?")


@dataclass(frozen=True)
class Making:
    """A file that this process makes; ``path`` is there and empty."""

    path: Path
    lock: Path
    descriptor: int

    def release(self) -> None:
        """Remove what is left of it and let go of the lock."""
        with suppress(OSError):  # gone already when all went well
            self.path.unlink(missing_ok=True)
        let_go(self.descriptor, self.lock)


def making(target: Path) -> Making:
    """Hold a hidden name for a file; what a kill left of the same one is written over.

    Raises
    ------
    OSError
        Where nothing can be made there.
    """
    # Two processes may write the same file, and the last one wins: the second takes another name.
    names = (hashlib.sha256(os.fsencode(target.name)).hexdigest()[:12], secrets.token_hex(6))
    for name in names:
        path, lock = (target.with_name(f"{PREFIX}{name}{suffix}") for suffix in (target.suffix, ".lock"))
        if path == lock:  # the target's own extension is .lock
            path = path.with_suffix(".making")
        if (descriptor := taken(lock)) is None:
            continue
        made = Making(path, lock, descriptor)
        try:
            open(path, "wb").close()  # says early that it cannot be written; what a kill left there is no start
        except BaseException:
            made.release()
            raise
        return made
    raise OSError("others write this file again and again")


def is_making(name: str) -> bool:
    """Whether a file is in the making, or was left while it was, by its name."""
    return _MAKING.fullmatch(name) is not None


def left_behind(folder: Path) -> list[Path]:
    """Remove what killed processes left of files that they made in a folder; what that was, the locks not told."""
    try:
        names = os.listdir(folder)
    except OSError:  # not there, or closed to us
        return []
    out: list[Path] = []
    for name in sorted(n for n in names if _LOCK.fullmatch(n)):
        lock = folder / name
        try:
            descriptor = os.open(lock, os.O_RDWR)
        except OSError:  # its process has just ended
            continue
        try:
            dead = locked(descriptor) and is_file(descriptor, lock)
        except (NotImplementedError, OSError):
            dead = False
        if not dead:
            unlocked(descriptor)
            continue
        files = [folder / n for n in names if is_making(n) and n != name and Path(n).stem == lock.stem]
        for file in files:
            with suppress(OSError):
                file.unlink()
                out.append(file)
        let_go(descriptor, lock)
    return out


def left_below(folder: Path) -> list[Path]:
    """`left_behind` in a folder of ours and all below it; hidden folders left out."""
    out = []
    for place, inside, _ in os.walk(folder):
        inside[:] = sorted(d for d in inside if not d.startswith(".windmark"))
        out += left_behind(Path(place))
    return out
