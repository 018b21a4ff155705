"""Disks in memory that fill up: mounted by root, or by anybody where the system lends name spaces."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

BALLAST = "ballast"


@contextmanager
def mounted(place: Path, options: str = "size=64m") -> Iterator[Path]:
    """A file system in memory."""
    place.mkdir(exist_ok=True)
    subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(place)], check=True, capture_output=True)
    try:
        yield place
    finally:
        subprocess.run(["umount", "-l", str(place)], check=True, capture_output=True)


def can_mount(place: Path) -> bool:
    """Whether this process may mount something."""
    try:
        with mounted(place):
            return True
    except (subprocess.CalledProcessError, FileNotFoundError):
        return False


def used(disk: Path) -> int:
    """Bytes that are taken."""
    stat = os.statvfs(disk)
    return (stat.f_blocks - stat.f_bfree) * stat.f_frsize


def fill(disk: Path, leave: int) -> None:
    """Somebody else's file takes everything but so many bytes."""
    with suppress(OSError), open(disk / BALLAST, "ab", buffering=0) as stream:
        for _ in range(10):  # others write meanwhile
            stat = os.statvfs(disk)
            left = stat.f_bavail * stat.f_frsize - leave
            if left <= 0:
                return
            with suppress(OSError):
                os.posix_fallocate(stream.fileno(), os.fstat(stream.fileno()).st_size, left)


def empty(disk: Path) -> None:
    """Somebody else's file is gone."""
    (disk / BALLAST).unlink(missing_ok=True)
