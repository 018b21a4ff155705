"""An append-only file of records that is readable up to its last whole record, whenever its writer ended.

A line of text that says what it is, then for every record its length (8 bytes), the CRC-32 of its content (4 bytes),
both little-endian, and the content. What is written is in the system's hands at once, so that the end of the process,
however sudden, costs nothing; `Journal.sync` sees to it that not even a power failure does.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from windmark.io.errors import FileError, reading, reason

_HEAD = struct.Struct("<QI")


class AppendedFile:
    """A file that only grows, unbuffered; what a full disk took only a part of is taken back.

    Parameters
    ----------
    path : the file
    size : what of an existing one is kept, in bytes; None starts anew

    Raises
    ------
    FileError
        Where it cannot be opened or written, and for one that is shorter than ``size``.
    """

    def __init__(self, path: Path, size: int | None = None) -> None:
        self.path, self.size = path, size or 0
        try:
            self._file = open(path, "wb" if size is None else "r+b", buffering=0)  # noqa: SIM115 (closed by close)
            if size is not None:
                if os.fstat(self._file.fileno()).st_size < size:
                    self._file.close()
                    raise FileError(path, f"is shorter than the {size} bytes that it had; expected it as it was left")
                self._file.truncate(size)
                self._file.seek(size)
        except OSError as error:
            raise FileError(path, f"cannot be written: {reason(error)}") from error

    def append(self, content: bytes) -> None:
        """Write at the end, whole or not at all."""
        left = memoryview(content)
        try:
            while left:
                left = left[self._file.write(left) :]
        except OSError as error:
            self.take_back(self.size)
            raise FileError(self.path, f"cannot be written: {reason(error)}") from error
        self.size += len(content)

    def take_back(self, size: int) -> None:
        """Cut the file to a size that it had."""
        with suppress(OSError):
            self._file.truncate(size)
            self._file.seek(size)
        self.size = size

    def sync(self) -> None:
        """Wait until all of it is on the disk."""
        try:
            os.fsync(self._file.fileno())
        except OSError as error:
            raise FileError(self.path, f"cannot be written: {reason(error)}") from error

    def close(self) -> None:
        """End writing."""
        with suppress(OSError):
            self._file.close()


class Journal(AppendedFile):
    """Records at the end of a file.

    Parameters
    ----------
    path : the file
    title : its first line, without the line's end
    size : see `AppendedFile`
    """

    def __init__(self, path: Path, title: str, size: int | None = None) -> None:
        super().__init__(path, size)
        if size is None:
            self.append(f"{title}\n".encode())

    def add(self, content: bytes) -> None:
        """Add a record."""
        self.append(_HEAD.pack(len(content), zlib.crc32(content)) + content)


def read_journal(path: str | os.PathLike[str], title: str) -> Iterator[tuple[bytes, int]]:
    """The whole records of a journal, and where each of them ends; what follows the last whole one is left out.

    Raises
    ------
    FileError
        When there is none, or its first line is another one.
    """
    with reading(path), open(path, "rb") as stream:
        first = f"{title}\n".encode()
        head = stream.read(len(first))
        if len(head) < len(first) and first.startswith(head):
            return  # stopped before its first line was there
        if head != first:
            raise FileError(path, f"expected a file that begins with {title!r}")
        total, at = os.fstat(stream.fileno()).st_size, len(first)
        while len(head := stream.read(_HEAD.size)) == _HEAD.size:
            size, crc = _HEAD.unpack(head)
            if size > total - at - _HEAD.size or zlib.crc32(content := stream.read(size)) != crc:
                return
            at += _HEAD.size + size
            yield content, at
