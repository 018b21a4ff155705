"""In which line of a TOML file a key stands; the standard library's parser does not say."""

from __future__ import annotations

from windmark.pipeline.toml_statements import Key, items, statements

__all__ = ["Key", "line_of", "toml_lines"]


def toml_lines(text: str) -> dict[Key, int]:
    """Line numbers (from 1) of tables and keys, as pydantic names them: ("image", 0, "file"); those of lists, too.

    The text must be valid (`tomllib` has read it).
    """
    out: dict[Key, int] = {}
    for s in statements(text):
        out.setdefault(s.key, _line(text, s.start))
        if s.value is not None:
            _inside(text, s.key, s.value, out)
    return out


def line_of(lines: dict[Key, int], key: Key) -> int | None:
    """The line of a key, or of what it is in."""
    for size in range(len(key), 0, -1):
        if key[:size] in lines:
            return lines[key[:size]]
    return None


def _inside(text: str, key: Key, at: int, out: dict[Key, int]) -> None:
    """The lines of what an array or an inline table holds."""
    if text[at] not in "[{":
        return
    for number, item in enumerate(items(text, at)[0]):
        own = (*key, *(item.key or (number,)))
        out.setdefault(own, _line(text, item.start))
        _inside(text, own, item.value, out)


def _line(text: str, at: int) -> int:
    return text.count("\n", 0, at) + 1
