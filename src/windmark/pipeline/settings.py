"""Settings from TOML files: every key checked before any work starts, errors that name file, key and expectation."""

from __future__ import annotations

import re
import tomllib
import types
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin
from unicodedata import normalize

from pydantic import BaseModel, ConfigDict, Field, ValidationError, ValidationInfo, field_validator

from windmark.io import FrameAddress, frame_address
from windmark.io.errors import FileError, reading, reason
from windmark.options import Option
from windmark.pipeline.kinds import other_kind
from windmark.pipeline.no_toml import why_no_toml
from windmark.pipeline.plain_numbers import check_numbers
from windmark.pipeline.typed import nearest, typed

_DEEP_KEY = re.compile(r"(?<![\w-])(?:[\w-]++[ \t]*+\.[ \t]*+){100}")
"""For each part of a key the library goes through all parts before it. Looked for from where a word begins only: from
within a long word it would take the square of its length."""

_TEXTS = {"path_type": "a path, as text in quotes", "string_type": "text in quotes"}
"""Kinds of errors whose words in the library are Python's -> what was expected."""

_OF_A_TYPE = re.compile(r"\[|^constrained-|^(int|float|str|bool|path|literal)$")
"""Of alternative types pydantic puts the type into the place of an error; it is no key."""
COMMAND_LINE = "command line"
"""Name of the project file where settings come from the command line."""
OPTIONS = {"length_unit": "--unit"}
"""Keys of a project that are options of a command."""


class Strict(BaseModel):
    """A table of a settings file: unknown keys are errors, values do not change."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @field_validator("*", mode="before")
    @classmethod
    def _numbers_are_written_as_numbers(cls, value: Any, about: ValidationInfo) -> Any:
        check_numbers(cls.model_fields[str(about.field_name)].annotation, value)
        return value


def ranged(option: Option[Any]) -> Any:
    """The range of an option, for the annotation of its key."""
    return Field(gt=option.above, ge=option.least, le=option.most, description=option.sentence)


def read_toml(path: Path, root: type[BaseModel]) -> dict[str, Any]:
    """The settings of a file, not yet checked.

    Raises
    ------
    FileError
        When it cannot be read, is no TOML, has the key that holds its own path, or is surely the project of another
        verb.
    """
    data = read_settings(path)
    if "path" in data:
        raise FileError(path, f"unknown key; expected {known_keys(root)}", "path")
    if (other := other_kind(data, root.__name__)) is not None:
        raise FileError(path, f"{other} {typed(path)}")
    return data


def read_settings(path: Path) -> dict[str, Any]:
    """The content of a TOML file, whatever it is for; `FileError` where it cannot be read or is no TOML."""
    content = b""
    try:
        with reading(path):
            content = path.read_bytes()
        text = content.decode("utf-8-sig")
        if _DEEP_KEY.search(text):
            raise FileError(path, "a key has over 100 parts; expected a windmark project file")
        return tomllib.loads(text)
    except FileError:
        raise
    except ValueError as error:  # also numbers too long for Python
        raise FileError(path, why_no_toml(path, content, error)) from None
    except RecursionError:
        raise FileError(path, "is nested too deeply; expected a windmark project file") from None


def explained(path: Path, error: ValidationError, root: type[BaseModel]) -> FileError:
    """The first thing that is wrong, in words: key, what came, what was expected."""
    key, words = explanation(error.errors()[0], root)
    return _fault(path, words, key)


def _fault(path: Path, words: str, key: str | None) -> FileError:
    """What is wrong with a setting; of the command line by its option, for nobody has written that key."""
    if path.name == COMMAND_LINE and key is not None:
        if key in OPTIONS:
            return FileError(OPTIONS[key], words)
        key = None if key.endswith(".file") else key
    return FileError(path, words, key)


def explanation(one: Mapping[str, Any], root: type[BaseModel]) -> tuple[str | None, str]:
    """The key and the words of one of pydantic's errors of ``root``; a key that is not known has the nearest one."""
    parts = key_parts(one["loc"])
    keys = [str(k) for k in parts]
    key = "".join(f"[{k}]" if isinstance(k, int) else f".{k}" for k in parts).lstrip(".") or None
    if one["type"] == "extra_forbidden":
        model = _model_at(root, keys[:-1])
        return key, f"unknown key{nearest(keys[-1], _keys_of(model))}; expected {known_keys(model)}"
    if one["type"] == "missing":
        return key, f"is missing{_choices(_model_at(root, keys[:-1]), keys[-1])}"
    if one["type"] == "value_error":
        return key, str(one["ctx"]["error"])
    if "words" in one.get("ctx", {}):  # of `faults`
        return key, str(one["ctx"]["words"])
    return key, f"{_expected(one)}, got {_as_written(one['input'])}{_meant(one)}"


def _expected(one: Mapping[str, Any]) -> str:
    """What the library says, in our words."""
    if one["type"] in _TEXTS:
        return f"expected {_TEXTS[one['type']]}"
    return re.sub("^Input should be", "expected", one["msg"])


def _as_written(value: Any) -> str:
    """A value as the file has it, so far as Python writes it in another way."""
    return str(value).lower() if isinstance(value, bool) else repr(value)


def _meant(one: Mapping[str, Any]) -> str:
    """One of the words that a key can have, where the given one looks like it."""
    words = re.findall("'([^']+)'", str(one.get("ctx", {}).get("expected", "")))
    return nearest(str(one["input"]), words)


def key_parts(place: Sequence[str | int]) -> list[str | int]:
    """The keys of a place as pydantic gives it, which holds names of types besides."""
    return [k for k in place if isinstance(k, int) or not _OF_A_TYPE.search(k)]


def existing(settings: Path, key: str, relative: Path) -> Path:
    """A file that a settings file names, as an absolute path.

    Raises
    ------
    FileError
        When it does not exist, naming both.
    """
    with naming(settings, key):
        full = (settings.parent / relative).resolve()
        is_there = full.is_file()
    if not is_there:
        raise _fault(settings, _no_file(settings, full), key)
    return full


def _no_file(settings: Path, full: Path) -> str:
    """Why a setting names no file; an empty one stands for the folder itself."""
    if full == settings.parent.resolve():
        return f"is empty, or the project's own folder {full}; expected the path of an existing file"
    if full.is_dir():
        return f"{full} is a folder; expected an existing file"
    return f"there is no file {full}; expected an existing file"


@contextmanager
def naming(settings: Path, key: str, expected: str = "the path of an existing file") -> Iterator[None]:
    """What the system says against a path itself: too long, a zero byte, links in a circle."""
    try:
        yield
    except FileError:
        raise
    except (OSError, ValueError, RuntimeError) as error:
        why = reason(error) if isinstance(error, OSError) else str(error)
        raise _fault(settings, f"{why}; expected {expected}", key) from error


def existing_picture(settings: Path, key: str, relative: Path) -> Path:
    """A picture that a settings file names: a file, or the address of a frame (``run.cine[120]``); absolute.

    Raises
    ------
    FileError
        When there is no such file or folder, naming both.
    """
    with naming(settings, key):
        address = frame_address(settings.parent / relative)
        full = address.file.resolve()
        is_there = full.is_file() or (full.is_dir() and address.number is not None)
    if not is_there:
        raise _fault(settings, _no_file(settings, full), key)
    return Path(FrameAddress(full, address.dataset, address.number).text)


def unusable_name(names: Sequence[str]) -> str | None:
    """Why some of these names cannot stand side by side as names of files and folders on every system; None: they can.

    Results are copied from one system to another, so what Windows and macOS cannot hold is refused everywhere.
    """
    same: dict[str, str] = {}
    for name in names:
        if not name or name.startswith(".") or name.endswith((".", " ")) or any(ch in _NEVER for ch in name):
            return f"this one cannot: {name!r}"
        if not name.isprintable() or len(name.encode()) > _LONGEST:
            return f"this one cannot, it is too long or has signs that do not print: {name[:40]!r}"
        if name.split(".")[0].rstrip().upper() in _DEVICES:
            return f"Windows keeps {name!r} for a device"
        if name.casefold() in _OWN:
            return f"{name!r} is the name of a file of the results themselves"
        other = same.setdefault(normalize("NFC", name).casefold(), name)
        if other != name:
            return f"{other!r} and {name!r} are one name on many disks"
    return None


_NEVER = '/\\:*?"<>|'
_LONGEST = 200
"""Bytes, with room for what is put before and behind."""
_DEVICES = {"CON", "PRN", "AUX", "NUL", *(f"{port}{k}" for port in ("COM", "LPT") for k in "0123456789¹²³")}
_OWN = {"report.html", "summary.json", "manifest.json"}


def _keys_of(model: type[BaseModel]) -> list[str]:
    return [f.alias or n for n, f in model.model_fields.items() if n != "path"]


def known_keys(model: type[BaseModel]) -> str:
    """The keys of a table, in words."""
    return f"one of {', '.join(_keys_of(model))}"


def _choices(model: type[BaseModel], name: str) -> str:
    """"; expected in, ft, mm, cm or m" of a setting that is one of a few words; "" of others."""
    field = next((f for n, f in model.model_fields.items() if name in (n, f.alias)), None)
    if field is None or get_origin(field.annotation) is not Literal:
        return ""
    *words, last = map(str, get_args(field.annotation))
    return f"; expected {', '.join(words)} or {last}" if words else ""


def _model_at(root: type[BaseModel], keys: list[str]) -> type[BaseModel]:
    """The part of the settings that a key path leads to; indices of lists are skipped."""
    model = root
    for key in keys:
        field = next((f for n, f in model.model_fields.items() if key in (n, f.alias)), None)
        found = None if field is None else model_in(field.annotation)
        model = found or model
    return model


def has_path(annotation: Any) -> bool:
    """Whether a setting may be a path."""
    return annotation is Path or any(has_path(part) for part in get_args(annotation))


def model_in(annotation: Any) -> type[BaseModel] | None:
    """The table inside a list, an optional or an annotated type."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    if get_origin(annotation) in (Union, types.UnionType, Annotated, tuple, list, dict):
        return next((m for part in get_args(annotation) if (m := model_in(part)) is not None), None)
    return None
