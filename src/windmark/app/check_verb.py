"""The verb `windmark check`: everything that is wrong with a project, at once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from windmark.app import console
from windmark.app.progress import progress
from windmark.app.project_place import project_in
from windmark.pipeline.check import Checked, check_project
from windmark.pipeline.kinds import KINDS
from windmark.pipeline.typed import typed


def check(path: Path, as_json: bool) -> None:
    """Check and list; exit code 2 where something is wrong."""
    path = project_in(path)
    with progress() as show:
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
                f"next: {typed('windmark', found.kind, found.path)}"]  # fmt: skip
    count = len(found.problems)
    what = f"{found.path}: {count} thing{'s' if count > 1 else ''} to correct"
    return [*said, what, *(f"  {p}" for p in found.problems)]
