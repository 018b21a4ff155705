"""Files for libraries that believe what a damaged header says."""

from __future__ import annotations

import io
import os
from typing import Any

from windmark.errors import g3
from windmark.io.errors import FileError, reading
from windmark.io.text import Pathlike


class _Raw(io.RawIOBase):
    """A file that is no `io.FileIO`: NumPy, handed such a one, reads past `BoundedFile.read`."""

    mode = "rb"

    def __init__(self, path: Pathlike) -> None:
        super().__init__()
        self._file = io.FileIO(path, "rb")
        self.name = os.fspath(path)

    def readinto(self, buffer: Any) -> int | None:
        return self._file.readinto(buffer)

    def seek(self, offset: int, whence: int = 0) -> int:
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        return self._file.tell()

    def fileno(self) -> int:
        return self._file.fileno()

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def close(self) -> None:
        if not self.closed:
            self._file.close()
        super().close()


MOST_UNPACKED, MOST_TIMES = 512 * 2**20, 100


def check_unpacked(path: Pathlike, needed: int, stored: int, where: str | None = None) -> None:
    """Refuse contents that a damaged, or malicious, file blows up: over 512 MiB and 100 times what is stored.

    Deflate can reach 1032 : 1 on nothing but zeros. Pictures of cameras stay below 10 : 1, and masks of 500 megapixels
    are within the first part; what is really larger can be stored uncompressed.

    Parameters
    ----------
    path, where : the file and the place in it, for the error
    needed : bytes of what is to be unpacked at once
    stored : bytes that there are for it
    """
    if needed > MOST_UNPACKED + MOST_TIMES * stored:
        what = f"damaged, or packed beyond belief: {needed / 2**20:.0f} MiB are to come from {g3(stored / 2**20)} MiB"
        raise FileError(path, f"{what}; expected at most 100 times as much (store it uncompressed)", where)


class BoundedFile(io.BufferedReader):
    """An open file of which never more is asked than is left: a header may claim any size."""

    def __init__(self, path: Pathlike) -> None:
        with reading(path):
            super().__init__(_Raw(path))
        self._size = os.fstat(self.fileno()).st_size

    def read(self, size: int | None = -1, /) -> bytes:
        """At most ``size`` bytes."""
        left = max(self._size - self.tell(), 0)
        return super().read(left if size is None or size < 0 else min(size, left))
