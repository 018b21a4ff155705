"""Where the keys and values of a TOML file stand; the standard library's parser does not say.

The text must be valid: `tomllib` has read it.
"""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass

from windmark.errors import UsageError

Key = tuple[str | int, ...]
_PART = re.compile(r"""[A-Za-z0-9_-]+|"(?:\\.|[^"\\\n])*"|'[^'\n]*'""")
_NO_KEY: tuple[str, ...] = ()
_BLANK = " \t\r\n"


@dataclass(frozen=True)
class Statement:
    """A table's header, or a key with its value.

    Parameters
    ----------
    key : whole, as pydantic names it: ("image", 0, "labels", "T1")
    table : the table that it stands in; of a header its own key
    start, end : where it stands in the text
    value : where its value begins; None of a header
    """

    key: Key
    table: Key
    start: int
    end: int
    value: int | None = None


@dataclass(frozen=True)
class Item:
    """Of an array or an inline table: where it stands, its key (inline tables) and where its value begins."""

    start: int
    end: int
    key: tuple[str, ...] = ()
    value: int = 0


def statements(text: str) -> list[Statement]:
    """All headers and keys in their order."""
    out: list[Statement] = []
    counts: dict[Key, int] = {}
    table: Key = ()
    at = skip(text, int(text.startswith("\ufeff")))
    while at < len(text):
        start = at
        if text[at] == "[":
            size = 2 if text.startswith("[[", at) else 1
            names, at = _key(text, at + size)
            table = entered(list(names), size == 2, counts)
            at = skip(text, at) + size
            out.append(Statement(table, table, start, at))
        else:
            names, at = _key(text, at)
            value = skip(text, at + 1)  # behind the =
            at = _value_end(text, value)
            out.append(Statement((*table, *names), table, start, at, value))
        at = skip(text, at)
    return out


def skip(text: str, at: int) -> int:
    """Behind blanks and comments."""
    while at < len(text):
        if text[at] == "#":
            at = text.find("\n", at) % (len(text) + 1)
        elif text[at] in _BLANK:
            at += 1
        else:
            break
    return at


def _key(text: str, at: int) -> tuple[tuple[str, ...], int]:
    """The parts of a key, and the place behind it: at its = or ]."""
    names: list[str] = []
    while True:
        at = skip(text, at)
        part = _PART.match(text, at)
        if part is None:
            raise UsageError(f"the key at character {at + 1} of the file cannot be told; edit the file by hand")
        names.append(str(tomllib.loads(f"k = {part[0]}")["k"]) if part[0][0] in "\"'" else part[0])
        at = skip(text, part.end())
        if not text.startswith(".", at):
            return tuple(names), at
        at += 1


def _value_end(text: str, at: int) -> int:
    """Behind a value."""
    if text[at] in "[{":
        return items(text, at)[2] + 1
    for quote in ('"""', "'''", '"', "'"):
        if text.startswith(quote, at):
            return _string_end(text, at + len(quote), quote)
    while at < len(text) and text[at] not in ",]}#\r\n":
        at += 1
    return at - (len(text[:at]) - len(text[:at].rstrip(" \t")))


def _string_end(text: str, at: int, quote: str) -> int:
    while not text.startswith(quote, at):
        at += 2 if text[at] == "\\" and quote[0] == '"' else 1
    at += len(quote)
    while len(quote) == 3 and text.startswith(quote[0], at):  # up to two quotes may stand before the closing three
        at += 1
    return at


def items(text: str, at: int) -> tuple[list[Item], list[int], int]:
    """Items of the array or inline table that begins at ``at``, where its commas are, and its closing bracket."""
    named, closing = text[at] == "{", "}" if text[at] == "{" else "]"
    found: list[Item] = []
    commas: list[int] = []
    at = skip(text, at + 1)
    while text[at] != closing:
        if text[at] == ",":
            commas.append(at)
            at += 1
        else:
            start, key = at, _NO_KEY
            if named:
                key, at = _key(text, at)
                at = skip(text, at + 1)
            value, at = at, _value_end(text, at)
            found.append(Item(start, at, key, value))
        at = skip(text, at)
    return found, commas, at


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
