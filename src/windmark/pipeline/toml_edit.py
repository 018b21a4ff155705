"""Change single values in the text of a TOML file: all else, comments and order, stays as it was written.

The standard library reads TOML and does not write it. The text must be valid (`tomllib` has read it); where each key
and value stands is found here, and whoever edits reads the new text again and compares.
"""

from __future__ import annotations

import json
import re

from windmark.errors import UsageError
from windmark.pipeline.toml_statements import Key, Statement, items, statements

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def with_entry(text: str, table: Key, name: str, value: str) -> str:
    """``name = value`` in a table, such as ("image", 0, "labels"), which is made where it is not there.

    Raises
    ------
    UsageError
        Where the table that it belongs to is written in a way that has no place for it (within an inline array).
    """
    known = statements(text)
    key = _written(name)
    for s in known:
        if s.key == (*table, name) and s.value is not None:
            return text[: s.value] + value + text[s.end :]
        if s.key == table and s.value is not None:
            return _in_inline(text, s.value, name, f"{key} = {value}")
    inside = [s for s in known if s.table == table]
    if inside:
        return _line_after(text, inside[-1], f"{key} = {value}")
    dotted = [s for s in known if s.key[:-1] == table and s.value is not None]
    if dotted:
        return _line_after(text, dotted[-1], f"{_written(str(table[-1]))}.{key} = {value}")
    return _line_after(text, _parent(known, table), f"{_written(str(table[-1]))} = {{ {key} = {value} }}")


def without_entry(text: str, table: Key, name: str) -> str:
    """A table without one of its keys."""
    for s in statements(text):
        if s.key == (*table, name) and s.value is not None:
            return _without_lines(text, s)
        if s.key == table and s.value is not None:
            inside = items(text, s.value)[0]
            return _without_item(text, s, next(k for k, item in enumerate(inside) if item.key == (name,)))
    raise UsageError(f"{_told(table)}.{name} is written where it cannot be found; remove it by hand")


def with_item(text: str, array: Key, value: str) -> str:
    """One more item at the end of an array, which is made where it is not there; errors as `with_entry`."""
    known = statements(text)
    for s in known:
        if s.key == array and s.value is not None:
            return _appended(text, s.value, value)
    return _line_after(text, _parent(known, array), f"{_written(str(array[-1]))} = [{value}]")


def without_item(text: str, array: Key, number: int) -> str:
    """An array without one of its items."""
    for s in statements(text):
        if s.key == array and s.value is not None:
            return _without_item(text, s, number)
    raise UsageError(f"{_told(array)} is written where it cannot be found; remove item {number + 1} by hand")


def block_of(text: str, table: Key) -> tuple[int, int]:
    """Where a table ``[[image]]`` with the tables in it stands: from its header to the end of its last line."""
    inside = [s for s in statements(text) if s.key[: len(table)] == table]
    if not inside or inside[0].value is not None:
        raise UsageError(f"{_told(table)} has no header of its own; expected [[{table[0]}]]")
    return inside[0].start, _line_end(text, inside[-1].end)


def _parent(known: list[Statement], key: Key) -> Statement:
    """Behind what a new key of a table goes: its last key, or its header."""
    inside = [s for s in known if s.table == key[:-1]]
    if not inside:
        raise UsageError(f"{_told(key[:-1])} is not written as a table of its own; add {key[-1]} by hand")
    return inside[-1]


def _told(key: Key) -> str:
    return "".join(f"[{k}]" if isinstance(k, int) else f".{k}" for k in key).lstrip(".")


def _written(name: str) -> str:
    """A key as TOML writes it."""
    return name if _BARE.fullmatch(name) else json.dumps(name, ensure_ascii=False)


def _in_inline(text: str, at: int, name: str, written: str) -> str:
    for item in items(text, at)[0]:
        if item.key == (name,):
            return text[: item.start] + written + text[item.end :]
    return _appended(text, at, written)


def _appended(text: str, at: int, written: str) -> str:
    found, commas, _ = items(text, at)
    if not found:
        inner = f" {written} " if text[at] == "{" else written
        return text[: at + 1] + inner + text[at + 1 :]
    last = found[-1].end
    if commas and commas[-1] >= last:  # a trailing comma
        return text[: commas[-1] + 1] + f" {written}," + text[commas[-1] + 1 :]
    return text[:last] + f", {written}" + text[last:]


def _without_item(text: str, statement: Statement, number: int) -> str:
    assert statement.value is not None
    found, commas, _ = items(text, statement.value)
    gone = found[number]
    if len(found) == 1 and "#" not in text[statement.start : _line_end(text, statement.end)]:
        return _without_lines(text, statement)
    behind = [c for c in commas if c >= gone.end]
    comma = behind[0] if behind else next((c for c in reversed(commas) if c < gone.start), None)
    out = text[: gone.start] + text[gone.end :]
    if comma is None:
        return out
    if comma > gone.start:
        comma -= gone.end - gone.start
    rest = out[comma + 1 :]
    return out[:comma] + rest[len(rest) - len(rest.lstrip(" ")) :]


def _line_end(text: str, at: int) -> int:
    """The end of a line, before its line break."""
    end = text.find("\n", at)
    end = len(text) if end < 0 else end
    return end - 1 if end > at and text[end - 1] == "\r" else end


def _line_after(text: str, statement: Statement, written: str) -> str:
    """A line of its own behind a statement, as far indented."""
    begin = text.rfind("\n", 0, statement.start) + 1
    indent = text[begin : statement.start].lstrip("\ufeff")
    end = _line_end(text, statement.end)
    return text[:end] + ("\r\n" if "\r\n" in text else "\n") + indent + written + text[end:]


def _without_lines(text: str, statement: Statement) -> str:
    begin = text.rfind("\n", 0, statement.start) + 1
    end = text.find("\n", statement.end)
    return text[:begin] + ("" if end < 0 else text[end + 1 :])
