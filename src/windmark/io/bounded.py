"""Files for libraries that believe what a damaged header says."""

from __future__ import annotations

import io
import os
from typing import Any

from windmark.io.errors import reading
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
