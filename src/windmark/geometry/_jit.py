"""Numba, with a cache that follows the sources: every kernel file takes ``nb`` from here.

Numba keys a cached kernel on the content of its own file only. A kernel that inlines another file's
function would go on with the old machine code after an upgrade or an edit of that other file. So the
cached kernels beside the sources are dropped, once, whenever their file or one that it imports has changed.
"""

from __future__ import annotations

import ast
import hashlib
import json
from contextlib import suppress
from pathlib import Path

import numba as nb

__all__ = ["nb"]

_PACKAGE = Path(__file__).resolve().parents[1]


def kernel_sources(package: Path) -> dict[str, str]:
    """Hashes of all private modules and of those in private folders, by their paths: all kernels are in private ones.

    ``__init__.py`` holds no kernel: one more public name must not cost every user two minutes of compiling.
    """
    paths = [*package.rglob("_[!_]*.py"), *package.rglob("_[!_]*/[!_]*.py")]
    return {path.relative_to(package).as_posix(): _hash(path.read_bytes()) for path in sorted(set(paths))}


def drop_stale_cache(package: Path) -> list[str]:
    """Remove numba's files beside the sources where they were made from other sources; the paths of these.

    Where the package cannot be written to, numba caches elsewhere and nothing is done.
    """
    mark = package / "__pycache__" / "kernels.json"
    before, now = _read(mark), {"numba": nb.__version__, **kernel_sources(package)}
    if before == now:
        return []
    stale = _importers(package, {name for name in {*before, *now} if before.get(name) != now.get(name)})
    every = "numba" in stale
    dropped = []
    with suppress(OSError):
        for path in package.rglob("__pycache__/*.nb[ic]"):
            source = (path.parent.parent / path.name.split(".")[0]).relative_to(package).as_posix() + ".py"
            if every or source in stale or source not in now:
                path.unlink(missing_ok=True)
                dropped.append(source)
        mark.parent.mkdir(exist_ok=True)
        mark.write_text(json.dumps(now))
    return sorted(set(dropped))


def _importers(package: Path, changed: set[str]) -> set[str]:
    """The changed modules and all private ones that import one of them, directly or not."""
    imports = {name: _imported(package, name) for name in kernel_sources(package)}
    grown = set(changed)
    while more := {name for name, of in imports.items() if name not in grown and of & grown}:
        grown |= more
    return grown


def _imported(package: Path, name: str) -> set[str]:
    """Paths of the modules of the package that one of its modules imports."""
    found: set[str] = set()
    tree = ast.Module([], [])
    with suppress(SyntaxError):  # half edited: whoever imports it will say so, and its own text has changed
        tree = ast.parse((package / name).read_bytes())
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    inside = (dotted.removeprefix(package.name + ".") for dotted in found if dotted.startswith(package.name + "."))
    return {dotted.replace(".", "/") + ".py" for dotted in inside}


def _read(mark: Path) -> dict[str, str]:
    with suppress(OSError, ValueError):
        found = json.loads(mark.read_text())
        if isinstance(found, dict):
            return found
    return {}


def _hash(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


drop_stale_cache(_PACKAGE)
