"""In which line of a TOML file a key stands; the standard library's parser does not say."""

from __future__ import annotations

import re

Key = tuple[str | int, ...]
_HEADER = re.compile(r"^\s*(\[\[?)\s*([^\]]+?)\s*\]\]?\s*(#.*)?$")
_ASSIGNED = re.compile(r"""^\s*((?:[\w-]+|"[^"]*"|'[^']*')(?:\s*\.\s*(?:[\w-]+|"[^"]*"|'[^']*'))*)\s*=""")


def toml_lines(text: str) -> dict[Key, int]:
    """Line numbers (from 1) of tables and of keys that begin a line, as pydantic names them: ("image", 0, "file")."""
    out: dict[Key, int] = {}
    counts: dict[Key, int] = {}
    table: Key = ()
    quote = ""
    for number, line in enumerate(text.splitlines(), start=1):
        if quote:  # within a string of several lines
            quote = "" if quote in line else quote
            continue
        if header := _HEADER.match(line):
            table = entered(_parts(header[2]), header[1] == "[[", counts)
            out.setdefault(table, number)
        elif assigned := _ASSIGNED.match(line):
            out.setdefault((*table, *_parts(assigned[1])), number)
        for mark in ('"""', "'''"):
            if line.count(mark) % 2:
                quote = mark
    return out


def line_of(lines: dict[Key, int], key: Key) -> int | None:
    """The line of a key, or of what it is in."""
    for size in range(len(key), 0, -1):
        if key[:size] in lines:
            return lines[key[:size]]
    return None


def _parts(text: str) -> list[str]:
    return [part.strip().strip("\"'") for part in re.findall(r"""[\w-]+|"[^"]*"|'[^']*'""", text)]


def entered(names: list[str], is_list: bool, counts: dict[Key, int]) -> Key:
    """The key of a table that is entered; those of lists have the number of their item."""
    out: Key = ()
    for depth, name in enumerate(names):
        plain = (*out, name)
        last = depth == len(names) - 1
        if last and is_list:
            counts[plain] = counts.get(plain, -1) + 1
        out = (*plain, counts[plain]) if plain in counts else plain
    return out
