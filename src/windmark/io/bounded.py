"""Files for libraries that believe what a damaged header says."""

from __future__ import annotations

import io
import os

from windmark.io.errors import reading
from windmark.io.text import Pathlike


class BoundedFile(io.BufferedReader):
    """An open file of which never more is asked than is left: a header may claim any size."""

    def __init__(self, path: Pathlike) -> None:
        with reading(path):
            super().__init__(io.FileIO(path, "rb"))
        self._size = os.fstat(self.fileno()).st_size

    def read(self, size: int | None = -1, /) -> bytes:
        """At most ``size`` bytes."""
        left = max(self._size - self.tell(), 0)
        return super().read(left if size is None or size < 0 else min(size, left))
