"""Lists of places that a project names, read as its run reads them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from windmark import io

LISTS, SINGLE = ("points", "place"), (("taps", "file"), ("temperature", "thermocouples"))
"""Tables of which a project may have several, with their ``file``; and those of which it has one, with the key."""


def places_tables(path: Path, data: Mapping[str, Any]) -> Iterator[tuple[str, Callable[[], str]]]:
    """Key and reader of each list of places that the settings ``data`` of a project at ``path`` name.

    A reader says in words what is sound, and raises `WindmarkError` for what is not. Files that are missing are not
    its matter.
    """
    named = []
    for name in LISTS:
        entries = data.get(name)
        several = entries if isinstance(entries, list) else []
        named += [(f"{name}[{n}].file", "file", of) for n, of in enumerate(several)]
    named += [(f"{name}.{key}", key, data.get(name)) for name, key in SINGLE]
    for where, key, entry in named:
        value = entry.get(key) if isinstance(entry, Mapping) else None
        if isinstance(value, str) and (path.parent / value).is_file():
            yield where, partial(_places, path.parent / value, entry.get("roles"))


def _places(file: Path, roles: Any) -> str:
    found = io.read_points(file, roles=roles if isinstance(roles, list) and roles else None)
    return f"{len(found.name)} places of {file.name}"
