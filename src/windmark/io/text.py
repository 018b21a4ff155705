"""Text and JSON files: strict reading with the place of every fault, whole and exact writing."""

from __future__ import annotations

import codecs
import dataclasses
import json
import math
import os
from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np

from windmark.io.atomic import atomic_write
from windmark.io.errors import FileError, reading

Pathlike = str | os.PathLike[str]

UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


def read_text(path: Pathlike) -> str:
    """The whole of a UTF-8 text file; a byte order mark is dropped, line ends are kept. UTF-16 that begins with such a
    mark, as spreadsheets write it, is read too.

    Raises
    ------
    FileError
        When the file is missing, empty, binary or in another encoding (names the line).
    """
    with reading(path), open(path, "rb") as stream:
        head = stream.read(4096)
        wide = head.startswith(UTF_16)
        if b"\0" in head and not wide:
            raise FileError(path, "this is not a text file; expected UTF-8 text")
        data = head + stream.read()
    if not data.strip():
        raise FileError(path, "the file is empty")
    try:
        return data.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError as error:
        if wide:
            raise FileError(path, f"begins as UTF-16 and is not: {error.reason}; expected UTF-8 text") from error
        line = data.count(b"\n", 0, error.start) + 1
        what = f"byte 0x{data[error.start]:02x} is not UTF-8; expected UTF-8 text"
        raise FileError(path, what, line) from error


def read_json(path: Pathlike) -> Any:
    """A JSON file as dictionaries and lists.

    Raises
    ------
    FileError
        When it is no JSON (names the line), has a key twice in one object, or has NaN or Infinity, which JSON lacks.
    """
    return parse_json(path, read_text(path))


def parse_json(path: Pathlike, text: str) -> Any:
    """As `read_json`, of text already read from ``path``."""

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        content = dict(pairs)
        if len(content) < len(pairs):
            times = Counter(key for key, _ in pairs)
            first = min(key for key in content if times[key] > 1)
            raise FileError(path, "the key is there more than once", f"key {first!r}")
        return content

    def refuse(constant: str) -> None:
        raise FileError(path, f"{constant} is not JSON; expected a number or null")

    try:
        return json.loads(text, object_pairs_hook=unique, parse_constant=refuse)
    except json.JSONDecodeError as error:
        raise FileError(path, f"not JSON: {error.msg}", error.lineno) from error
    except FileError:
        raise
    except (RecursionError, ValueError) as error:  # Python's own limits of depth and of digits
        raise FileError(path, "not usable JSON: nested too deep or a number too long") from error


def write_json(path: Pathlike, value: Mapping[str, Any]) -> None:
    """Write a dictionary as JSON, whole or not at all.

    Numpy arrays and scalars, dataclasses, paths and tuples are understood; floats keep every digit;
    NaN and infinity become null, because JSON has no word for them. Rows of numbers stay on one line.

    Raises
    ------
    ValueError
        For a value that JSON cannot hold (names its key).
    FileError
        When the file cannot be written.
    """
    text = to_json(value)
    with atomic_write(path) as stream:
        stream.write(text + "\n")


def to_json(value: Mapping[str, Any]) -> str:
    """The text that `write_json` writes, for printing."""
    return _layout(_plain(value, ""), "")


def _plain(value: Any, key: str) -> Any:
    """The value in Python's own types."""
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if value is None or isinstance(value, bool | int):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, str | os.PathLike):
        return os.fspath(value)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(k): _plain(v, f"{key}.{k}" if key else str(k)) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v, f"{key}[{i}]") for i, v in enumerate(value)]
    raise ValueError(f"write_json: {key or 'value'} is a {type(value).__name__}, which JSON cannot hold")


def _layout(value: Any, indent: str) -> str:
    deeper = indent + "  "
    if isinstance(value, dict) and value:
        items = [f"{json.dumps(k, ensure_ascii=False)}: {_layout(v, deeper)}" for k, v in value.items()]
        return "{\n" + ",\n".join(deeper + item for item in items) + f"\n{indent}}}"
    if isinstance(value, list) and any(isinstance(v, dict | list) for v in value):
        return "[\n" + ",\n".join(deeper + _layout(v, deeper) for v in value) + f"\n{indent}]"
    return json.dumps(value, ensure_ascii=False, allow_nan=False)
