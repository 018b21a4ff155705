"""Numba, with a cache that follows the sources: every kernel file takes ``nb`` from here.

Numba keys a cached kernel on the content of its own file only. A kernel that inlines another file's
function would go on with the old machine code after an upgrade or an edit of that other file. So the
cached kernels are dropped, once, whenever their file or one that it imports has changed.

They are beside the sources; where these cannot be written to, in the user's folder for caches, or else in a temporary
one, which is said when it is made. ``NUMBA_CACHE_DIR`` is respected. What came with the package (``_shipped``) is taken
from there.
"""

from __future__ import annotations

import ast
import hashlib
import json
import os
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numba

from windmark.geometry._link import Kernel, install
from windmark.geometry._shipped import Shipped, shipped

__all__ = ["nb"]

# As numba itself finds it: links are not followed, for the names of its folders are hashes of the paths.
_PACKAGE = Path(os.path.abspath(__file__)).parents[1]


def cache_root(package: Path) -> Path | None:
    """The folder for compiled kernels where they cannot be beside their sources; None where they can.

    Raises
    ------
    OSError
        When nothing can be written anywhere.
    """
    if numba.config.CACHE_DIR:
        return Path(numba.config.CACHE_DIR)
    folders = {(package / name).parent for name in kernel_sources(package)}
    if all(_writable(folder / "__pycache__") for folder in folders):
        return None
    user = _user_caches()
    if user is not None and _writable(user / "windmark"):
        return user / "windmark"
    return _temporary_root()


def _writable(folder: Path) -> bool:
    """Whether files can be made in a folder, which is made if need be."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


def _user_caches() -> Path | None:
    """The user's folder for caches, by the custom of the system; None without a home."""
    own = os.environ.get("LOCALAPPDATA" if os.name == "nt" else "XDG_CACHE_HOME", "")
    if os.path.isabs(own):
        return Path(own)
    with suppress(RuntimeError):
        return Path.home() / ("Library/Caches" if sys.platform == "darwin" else ".cache")
    return None


def _temporary_root() -> Path:
    """A folder that is nobody else's: what lies in it is run as machine code."""
    user = os.getuid() if hasattr(os, "getuid") else ""
    root = Path(tempfile.gettempdir()) / f"windmark-kernels-{user}"
    with suppress(FileExistsError):
        root.mkdir(mode=0o700)
        _say(f"neither the program's folder nor a home can be written to; compiled kernels are kept in {root}")
    found = root.lstat()
    foreign = hasattr(os, "getuid") and (found.st_uid != os.getuid() or stat.S_IMODE(found.st_mode) & 0o077)
    if not stat.S_ISDIR(found.st_mode) or foreign or not _writable(root):
        raise PermissionError(f"{root} is not ours alone")
    return root


def _say(text: str) -> None:
    print(f"windmark: {text}", file=sys.stderr)  # noqa: T201 (at import there is no other way)


def kernel_sources(package: Path) -> dict[str, str]:
    """Hashes of all private modules and of those in private folders, by their paths: all kernels are in private ones.

    ``__init__.py`` holds no kernel: one more public name must not cost every user two minutes of compiling.
    """
    paths = [*package.rglob("_[!_]*.py"), *package.rglob("_[!_]*/[!_]*.py")]
    return {path.relative_to(package).as_posix(): _hash(path.read_bytes()) for path in sorted(set(paths))}


def drop_stale_cache(package: Path, root: Path | None = None) -> list[str]:
    """Remove numba's files where they were made from other sources; the paths of these sources.

    ``root``: numba's folder where the files are not beside the sources. Where it cannot be written to, nothing is done.
    """
    mark = package / "__pycache__" / "kernels.json" if root is None else root / f"kernels-{_hash_of(package)}.json"
    before, now = _read(mark), {"numba": numba.__version__, **kernel_sources(package)}
    if before == now:
        return []
    stale = _importers(package, {name for name in {*before, *now} if before.get(name) != now.get(name)})
    every = "numba" in stale
    dropped = []
    with suppress(OSError):
        for path, source in _cached(package, root, {*before, *now} - {"numba"}):
            if every or source in stale or source not in now:
                path.unlink(missing_ok=True)
                dropped.append(source)
        mark.parent.mkdir(exist_ok=True)
        mark.write_text(json.dumps(now))
    return sorted(set(dropped))


def _cached(package: Path, root: Path | None, names: set[str]) -> Iterator[tuple[Path, str]]:
    """Numba's files, and of which source each is."""
    if root is None:
        for path in package.rglob("__pycache__/*.nb[ic]"):
            yield path, (path.parent.parent / path.name.split(".")[0]).relative_to(package).as_posix() + ".py"
        return
    for folder in {(package / name).parent for name in names}:
        for path in (root / f"{folder.name}_{_hash_of(folder)}").glob("*.nb[ic]"):
            yield path, (folder / path.name.split(".")[0]).relative_to(package).as_posix() + ".py"


def _hash_of(folder: Path) -> str:
    """Of a path, as numba names the folders below its own."""
    return hashlib.sha1(str(folder).encode()).hexdigest()


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


class _Numba:
    """Numba whose functions are linked once (see ``_link``), with or without a cache on a disk.

    ``brought``: kernels that came with the package; ``linked_once``: False where numba is not as ``_link`` knows it.
    """

    def __init__(self, *, cached: bool, brought: Shipped | None = None, linked_once: bool = True) -> None:
        self._cached, self._brought, self.linked_once = cached, brought, linked_once

    def __getattr__(self, name: str) -> Any:
        return getattr(numba, name)

    def njit(self, *, cache: bool = False, **options: Any) -> Callable[[Callable[..., Any]], Any]:
        """As numba's, of whose options those are taken that a function has."""
        if numba.config.DISABLE_JIT:
            return lambda function: function

        def kernel(function: Callable[..., Any]) -> Kernel:
            made = Kernel(function, targetoptions={"nopython": True, "boundscheck": None, **options})
            if cache and self._cached:
                made.enable_caching(self._brought)
            return made

        return kernel


def _ready(package: Path) -> Any:
    """Numba with its cache in order."""
    as_known = install()  # else what is on the disk is not as numba reads it
    try:
        root = cache_root(package)
    except OSError as error:
        _say(f"kernels are compiled anew every time, which takes minutes: nothing can be written ({error})")
        return _Numba(cached=False, linked_once=as_known)
    if root is not None:
        numba.config.CACHE_DIR = str(root)
    drop_stale_cache(package, root)
    brought = shipped(package, kernel_sources)[0] if as_known else None
    return _Numba(cached=True, brought=brought, linked_once=as_known)


nb = _ready(_PACKAGE)
