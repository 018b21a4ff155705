"""Files: images, markers, cameras, grids and results. The only place where conventions are converted."""

from windmark.io.atomic import atomic_folder, atomic_path, atomic_write
from windmark.io.errors import FileError

__all__ = [
    "FileError", "atomic_folder", "atomic_path", "atomic_write",
]  # fmt: skip
