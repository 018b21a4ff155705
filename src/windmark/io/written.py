"""What a command has put in its place already: one that is ended after that has written it."""

from __future__ import annotations

from pathlib import Path

from windmark.io.making import PREFIX

_there: list[Path] = []
"""Targets of the command at work, in the order in which they came; a list takes one in one step, from any thread."""


def begin_command() -> None:
    """What was written before is another command's."""
    _there.clear()


def note_written(target: Path) -> None:
    """A file or folder is in its place, whole; what is below a hidden name is not there yet."""
    if not any(part.startswith(PREFIX) for part in target.parts):
        _there.append(target)


def written_before() -> str:
    """What the command at work has written, in words for one that is ended now; "" for nothing."""
    if not _there:
        return ""
    more = f" (and {len(_there) - 1} more)" if len(_there) > 1 else ""
    return f"{_there[0]}{more} had been written whole before"
