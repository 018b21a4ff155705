"""Lists of places that a project names."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

LISTS, SINGLE = ("points", "place"), (("taps", "file"), ("temperature", "thermocouples"))
"""Tables of which a project may have several, with their ``file``; and those of which it has one, with the key."""


def place_lists(path: Path, data: Mapping[str, Any]) -> Iterator[tuple[str, Path, list[str] | None]]:
    """Key, file and roles of each list that the settings ``data`` of a project at ``path`` name.

    Files that are missing are not its matter.
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
            roles = entry.get("roles")
            yield where, path.parent / value, roles if isinstance(roles, list) and roles else None
