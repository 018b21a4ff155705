"""Numba, with a cache that follows the sources: every kernel file takes ``nb`` from here.

Numba keys a cached kernel on the content of its own file only. A kernel that inlines another file's
function would go on with the old machine code after an upgrade or an edit of that other file. So the
cache beside the sources is dropped, once, whenever any kernel source has changed.
"""

from __future__ import annotations

import hashlib
from contextlib import suppress
from pathlib import Path

import numba as nb

__all__ = ["nb"]

_PACKAGE = Path(__file__).resolve().parents[1]


def fingerprint(package: Path) -> str:
    """Hash over the sources of all private modules and folders (all kernels are private) and numba's version.

    ``__init__.py`` holds no kernel: one more public name must not cost every user two minutes of compiling.
    """
    digest = hashlib.sha256(nb.__version__.encode())
    for path in sorted([*package.rglob("_[!_]*.py"), *package.rglob("_[!_]*/[!_]*.py")]):
        digest.update(path.relative_to(package).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


def drop_stale_cache(package: Path) -> bool:
    """Remove numba's files beside the sources if they were made from other sources; True if they were.

    Where the package cannot be written to, numba caches elsewhere and nothing is done.
    """
    mark = package / "__pycache__" / "kernels.sha256"
    now = fingerprint(package)
    with suppress(OSError):
        if mark.is_file() and mark.read_text() == now:
            return False
    with suppress(OSError):
        for path in package.rglob("__pycache__/*.nb[ic]"):
            path.unlink(missing_ok=True)
        mark.parent.mkdir(exist_ok=True)
        mark.write_text(now)
        return True
    return False


drop_stale_cache(_PACKAGE)
