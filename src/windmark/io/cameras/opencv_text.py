"""OpenCV's FileStorage texts (YAML, XML, JSON) as dictionaries and lists.

Only the part of YAML that OpenCV and ROS write for calibrations: nested blocks, ``- `` sequences, flow
lists and maps over several lines, quoted texts, tags (skipped).
"""

from __future__ import annotations

import json
import math
import re
from typing import Any, NoReturn

from windmark.io.errors import FileError
from windmark.io.text import Pathlike

_KEY = re.compile(r"""("[^"]*"|'[^']*'|[^\s:"'\[\]{},#-][^:\[\]{},]*?)\s*:(?:\s+|$)(.*)""")
_TOKEN = re.compile(r"""\s*(?:([\[\]{},])|("(?:[^"\\]|\\.)*"|'[^']*')|([^\[\]{},"']+))""")
_CONSTANTS = {
    ".inf": math.inf, "+.inf": math.inf, "-.inf": -math.inf, ".nan": math.nan,
    "true": True, "false": False, "null": None, "~": None, "": None,
}  # fmt: skip


def parse_yaml(path: Pathlike, text: str) -> dict[str, Any]:
    """The mapping of an OpenCV YAML file.

    Raises
    ------
    FileError
        Names the line that does not fit.
    """
    reader = _YamlReader(path, text)
    content = reader.block(0)
    if not reader.at_end():
        reader.fail("the indentation does not fit")
    if not isinstance(content, dict):
        raise FileError(path, "not a camera file; expected keys and values (JSON, OpenCV YAML or XML)")
    return content


class _YamlReader:
    """Logical lines (flow lists joined) of a YAML text, read block by block."""

    def __init__(self, path: Pathlike, text: str) -> None:
        self.path = path
        self.lines: list[tuple[int, int, str]] = []  # number, indentation, content
        self.position = 0
        open_brackets = 0
        for number, raw in enumerate(text.splitlines(), start=1):
            line = _without_comment(raw.replace("\t", "    "))
            if not line.strip() or line.startswith(("%", "---", "...")):
                continue
            if open_brackets:
                first, indent, so_far = self.lines[-1]
                self.lines[-1] = (first, indent, f"{so_far} {line.strip()}")
            else:
                self.lines.append((number, len(line) - len(line.lstrip()), line.strip()))
            bare = re.sub(r'"[^"]*"', "", line)
            open_brackets = max(0, open_brackets + sum(map(bare.count, "[{")) - sum(map(bare.count, "]}")))

    def at_end(self) -> bool:
        return self.position >= len(self.lines)

    def fail(self, what: str) -> NoReturn:
        number = self.lines[min(self.position, len(self.lines) - 1)][0] if self.lines else None
        raise FileError(self.path, f"not OpenCV YAML: {what}", number)

    def block(self, depth: int) -> Any:
        """The mapping or sequence that starts at the current line."""
        if depth > 50:
            self.fail("nested too deep")
        if self.at_end():
            return None
        _, indent, text = self.lines[self.position]
        return self._sequence(indent, depth) if _is_item(text) else self._mapping(indent, depth)

    def _mapping(self, indent: int, depth: int) -> dict[str, Any]:
        content: dict[str, Any] = {}
        while not self.at_end() and self.lines[self.position][1] == indent:
            found = _KEY.fullmatch(self.lines[self.position][2])
            if found is None or _is_item(self.lines[self.position][2]):
                self.fail("expected 'key: value'")
            key = found[1].strip("\"'")
            if key in content:
                self.fail(f"the key {key!r} is there more than once")
            content[key] = self._value(found[2], indent, depth, same_level_items=True)
        return content

    def _sequence(self, indent: int, depth: int) -> list[Any]:
        items: list[Any] = []
        while not self.at_end() and self.lines[self.position][1] == indent:
            number, _, text = self.lines[self.position]
            if not _is_item(text):
                break
            rest = text[1:].lstrip()
            if _is_item(rest) or _KEY.fullmatch(rest):  # "- key: value", "- - 1": a block on the item's own line
                self.lines[self.position] = (number, indent + len(text) - len(rest), rest)
                items.append(self.block(depth + 1))
            else:
                items.append(self._value(rest, indent, depth))
        return items

    def _value(self, text: str, indent: int, depth: int, *, same_level_items: bool = False) -> Any:
        text = re.sub(r"^!\S*\s*", "", text)  # a tag says what the keys say again
        if text.startswith("|"):
            self.fail("packed (base64) data are not supported; expected numbers")
        if text:
            value = self._flow(text)
            self.position += 1
            return value
        self.position += 1
        if self.at_end():
            return None
        _, next_indent, next_text = self.lines[self.position]
        if next_indent > indent or (same_level_items and next_indent == indent and _is_item(next_text)):
            return self.block(depth + 1)
        return None

    # --- flow: [1, 2], {a: 1}, plain values ------------------------------------------------
    def _flow(self, text: str) -> Any:
        if text[0] not in "[{":
            return scalar(text)
        tokens = [(m[1], m[2] or m[3]) for m in _TOKEN.finditer(text)]
        if "".join(mark or word for mark, word in tokens).replace(" ", "") != text.replace(" ", ""):
            self.fail("a list or map is not closed")
        stack: list[_Open] = []
        for k, (mark, word) in enumerate(tokens, start=1):
            if mark and mark in "[{":
                stack.append(_Open(mark))
            elif mark and mark in "]}":
                if not stack or stack[-1].mark + mark not in ("[]", "{}"):
                    self.fail(f"a stray {mark!r}")
                done = stack.pop().close(self)
                if not stack and k == len(tokens):
                    return done
                if not stack:
                    self.fail("something follows the closed list or map")
                stack[-1].value = done
            elif mark == ",":
                stack[-1].finish(self)
            else:
                stack[-1].take(word)
        return self.fail("a list or map is not closed")


_NOTHING = object()


class _Open:
    """A flow list or map that is not closed yet."""

    def __init__(self, mark: str) -> None:
        self.mark = mark
        self.items: list[Any] = []
        self.keys: list[str] = []
        self.word = ""
        self.value: Any = _NOTHING

    def take(self, word: str) -> None:
        self.word += word

    def finish(self, reader: _YamlReader) -> None:
        """End the entry at a comma or at the closing bracket."""
        word = self.word.strip()
        if self.mark == "{":
            key, colon, rest = word.partition(":")
            if not colon:
                reader.fail("expected 'key: value' in a map")
            self.keys.append(key.strip().strip("\"'"))
            word = rest.strip()
        if self.value is not _NOTHING and word:
            reader.fail("a comma is missing")
        self.items.append(scalar(word) if self.value is _NOTHING else self.value)
        self.word, self.value = "", _NOTHING

    def close(self, reader: _YamlReader) -> Any:
        if self.word.strip() or self.value is not _NOTHING:
            self.finish(reader)
        return dict(zip(self.keys, self.items, strict=True)) if self.mark == "{" else self.items


def scalar(text: str) -> Any:
    """A plain or quoted value: number, text, constant."""
    word = text.strip()
    if len(word) > 1 and word[0] == word[-1] == '"':
        try:
            return json.loads(word)
        except ValueError:
            return word[1:-1]
    if len(word) > 1 and word[0] == word[-1] == "'":
        return word[1:-1]
    if word.lower() in _CONSTANTS:
        return _CONSTANTS[word.lower()]
    for kind in (int, float):
        try:
            return kind(word)
        except ValueError:
            continue
    return word


def _is_item(text: str) -> bool:
    return text == "-" or text.startswith("- ")


def _without_comment(line: str) -> str:
    if "#" not in line:
        return line
    found = re.match(r"""(?:"(?:[^"\\]|\\.)*"|'[^']*'|(?<!\s)#|[^#])*""", " " + line)
    return found[0][1:] if found else line


def parse_xml(path: Pathlike, text: str) -> Any:
    """The root element of an XML text.

    Raises
    ------
    FileError
        Names the line that is no XML.
    """
    from xml.etree import ElementTree

    try:
        return ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise FileError(path, f"not XML: {error.msg}", error.position[0]) from error


def xml_content(path: Pathlike, root: Any) -> dict[str, Any]:
    """The mapping of an OpenCV XML file (``<opencv_storage>``).

    Raises
    ------
    FileError
        For an element that is there twice.
    """
    content = _xml_value(path, root)
    return content if isinstance(content, dict) else {}


def refuse_doubles(path: Pathlike, element: Any) -> None:
    """An element whose children are named must not have two of one name: which of them counts is not known."""
    tags = [child.tag for child in element]
    if twice := sorted({tag for tag in tags if tags.count(tag) > 1}):
        raise FileError(path, f"<{twice[0]}> is there {tags.count(twice[0])} times in <{element.tag}>; expected once")


def _xml_value(path: Pathlike, element: Any) -> Any:
    children = list(element)
    if children and all(child.tag == "_" for child in children):
        return [_xml_value(path, child) for child in children]
    if children:
        refuse_doubles(path, element)
        return {child.tag: _xml_value(path, child) for child in children}
    text = (element.text or "").strip()
    if text.startswith('"') or element.tag == "dt":
        return scalar(text)
    words = [scalar(word) for word in text.split()]
    return words[0] if len(words) == 1 and element.tag not in ("data", "sizes") else words
