"""The project file that is meant: itself, or that of a folder."""

from __future__ import annotations

from pathlib import Path

from windmark.errors import UsageError, WindmarkError
from windmark.pipeline.kinds import KINDS, kind_of
from windmark.pipeline.settings import read_settings
from windmark.pipeline.typed import typed

NAMES = ("project.toml", "deform.toml", "psp.toml", "infrared.toml", "windmark.toml")
"""Project files that are looked for in a folder; of other names only where there is none of these."""


def project_in(path: Path, verb: str = "") -> Path:
    """The project file itself, or the only one in a folder; ``verb``: the only one that is its own.

    Raises
    ------
    UsageError
        For a folder with none, or several.
    """
    if not path.is_dir():
        return path
    there = [path / name for name in NAMES if (path / name).is_file()]
    there = there or sorted(path.glob("*.toml"))
    found = [p for p in there if verb in ("", _kind(p))]
    if len(found) == 1:
        return found[0]
    if not there:
        make = typed("windmark", "init", path)
        raise UsageError(f"{path}: this folder has no project file (*.toml); {make} makes one")
    if not found:
        others = ", ".join(f"{p.name} ({typed('windmark', kind, p)})" if (kind := _kind(p)) else p.name for p in there)
        raise UsageError(f"{path}: this folder has no project of {KINDS[verb]}; it has {others}")
    names = ", ".join(p.name for p in found)
    raise UsageError(f"{path}: this folder has several project files, say which: {names}")


def _kind(path: Path) -> str | None:
    try:
        return kind_of(read_settings(path))
    except WindmarkError:
        return None
