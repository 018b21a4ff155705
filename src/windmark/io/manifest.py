"""What a result was made of: ``manifest.json`` names the files read and written by their hashes, and the options."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import os
import platform
from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress
from pathlib import Path, PurePosixPath
from typing import Any

from windmark.io.errors import FileState, file_state
from windmark.io.making import is_making
from windmark.io.text import write_json

MANIFEST = "manifest.json"
CHANGED = "changed_since_read"
_PACKAGES = ("windmark", "numpy", "scipy", "numba", "h5py", "tifffile", "matplotlib")

Record = dict[str, Any]
Hashes = dict[Path, tuple[FileState, str]]


def file_hash(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal."""
    with open(path, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def files_below(folder: Path) -> Iterable[str]:
    """All files below a folder, links not followed, as relative paths with ``/``; hidden ones of ours left out."""
    for place, inside, names in os.walk(folder):
        inside[:] = sorted(d for d in inside if not d.startswith(".windmark"))
        links = [d for d in inside if os.path.islink(os.path.join(place, d))]
        for name in (*(n for n in sorted(names) if not is_making(n)), *links):
            yield (Path(place) / name).relative_to(folder).as_posix()


def write_manifest(
    place: Path,
    target: Path,
    inputs: Mapping[str, FileState],
    about: Mapping[str, Any],
    there: Mapping[str, int] | None = None,
    hashes: Hashes | None = None,
) -> Record:
    """Write the manifest of the result in ``place``, which is for ``target``; the same result gives the same bytes.

    Parameters
    ----------
    place, target : where the files are now, where they will be (the same for a live run)
    inputs : files that were read, and their state then; those that are no files (any more) and those of the result are
        left out, those that were changed since have ``changed_since_read``: what the hash is of was not read
    about : goes in as it is: verb, options, whether the data said no
    there : files of ``place`` that are not of the result as long as their times (ns) are these
    hashes : of inputs that were hashed before, see `sources`
    """
    old = there or {}
    names = [n for n in files_below(place) if n != MANIFEST and os.lstat(place / n).st_mtime_ns != old.get(n)]
    record = {
        **about,
        **sources(place, target, inputs, hashes, names),
        "outputs": {name: file_hash(place / name) for name in names},
    }
    write_json(place / MANIFEST, record)
    return record


def sources(
    place: Path,
    target: Path,
    inputs: Mapping[str, FileState],
    hashes: Hashes | None = None,
    outputs: Collection[str] = (),
) -> Record:
    """The manifest's part on what a result is made of: ``versions``, and ``inputs`` with their hashes.

    ``hashes`` are those of files as they were in a state, and are added to: a file is hashed once. The others as in
    `write_manifest`.
    """
    return {
        "versions": {"python": platform.python_version(), **_versions()},
        "inputs": _inputs(place, target, inputs, outputs, {} if hashes is None else hashes),
    }


def _versions() -> dict[str, str]:
    out = {}
    for name in _PACKAGES:
        with suppress(importlib.metadata.PackageNotFoundError):
            out[name] = importlib.metadata.version(name)
    return out


def _inputs(
    place: Path, target: Path, inputs: Mapping[str, FileState], outputs: Collection[str], hashes: Hashes
) -> list[Record]:
    """Paths from the result's folder on, so that a test that is moved as a whole keeps a manifest that is true."""
    real = {Path(os.path.realpath(path)): state for path, state in inputs.items()}
    out: list[Record] = []
    for path in sorted(p for p in real if p.is_file() and not _is_ours(p, place, target, outputs)):
        with suppress(OSError):  # gone or closed to us since it was read
            now = file_state(path)
            if path not in hashes or hashes[path][0] != now:
                hashes[path] = now, file_hash(path)
            out.append({"file": relative(path, target), "bytes": path.stat().st_size, "sha256": hashes[path][1]})
            if file_state(path) != real[path]:
                out[-1][CHANGED] = True
    return out


def _is_ours(path: Path, place: Path, target: Path, outputs: Collection[str]) -> bool:
    """Whether a file that was read is a part of the result, or what a run that goes on has kept to do so.

    Live, pictures may arrive in the very folder of the results; they are inputs.
    """
    if not path.is_relative_to(place):
        return False
    inside = path.relative_to(place)
    return place != target or inside.as_posix() in outputs or any(p.startswith(".windmark") for p in inside.parts)


def relative(path: Path, folder: Path) -> str:
    """A path as it is seen from a folder."""
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:  # another drive of Windows
        return path.as_posix()


def read_manifest(folder: Path) -> Record | None:
    """The manifest of a result; None where there is none that can be read."""
    with suppress(OSError, ValueError, RecursionError):
        found = json.loads((folder / MANIFEST).read_bytes())
        if isinstance(found, dict) and isinstance(found.get("outputs"), dict):
            return found
    return None


def unchanged(folder: Path, manifest: Record) -> tuple[set[str], set[str]]:
    """Files that the manifest names and that are there: as they were written, and changed since then."""
    same: set[str] = set()
    changed: set[str] = set()
    for name, digest in manifest["outputs"].items():
        path, parts = folder / str(name), PurePosixPath(str(name))
        if parts.is_absolute() or ".." in parts.parts or not path.is_file():
            continue
        (same if not path.is_symlink() and file_hash(path) == digest else changed).add(parts.as_posix())
    return same, changed
