"""The verb `windmark check`: everything that is wrong with a project, at once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from windmark.app import console
from windmark.errors import UsageError
from windmark.pipeline.check import Checked, check_project
from windmark.pipeline.kinds import KINDS

NAMES = ("project.toml", "deform.toml", "psp.toml", "infrared.toml", "windmark.toml")
"""Project files that are looked for in a folder."""


def check(path: Path, as_json: bool) -> None:
    """Check and list; exit code 2 where something is wrong."""
    path = project_in(path)
    with console.progress() as show:
        found = check_project(path, show)
    record: dict[str, Any] = {
        "project": path, "kind": found.kind, "sound": not found.problems, "read": found.read,
        "problems": [vars(p) for p in found.problems],
    }  # fmt: skip
    console.answer(record, as_json, _lines(found))
    if found.problems:
        raise console.exit_with(console.WRONG_USAGE)


def _lines(found: Checked) -> list[str]:
    said = [f"  {line}" for line in found.read]
    if not found.problems:
        return [f"{found.path}: sound, the project of {KINDS[found.kind]}", *said,
                f"next: windmark {found.kind} {found.path}"]  # fmt: skip
    count = len(found.problems)
    what = f"{found.path}: {count} thing{'s' if count > 1 else ''} to correct"
    return [*said, what, *(f"  {p}" for p in found.problems)]


def project_in(path: Path) -> Path:
    """The project file itself, or the only one in a folder.

    Raises
    ------
    UsageError
        For a folder with none, or several.
    """
    if not path.is_dir():
        return path
    found = [path / name for name in NAMES if (path / name).is_file()]
    found = found or sorted(path.glob("*.toml"))
    if len(found) == 1:
        return found[0]
    if not found:
        raise UsageError(f"{path}: this folder has no project file (*.toml); windmark init {path} makes one")
    raise UsageError(f"{path}: this folder has several project files, say which: {', '.join(p.name for p in found)}")
