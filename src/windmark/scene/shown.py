"""Nouns and results as tables and datasets; arguments of the wrong kind."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, is_dataclass
from typing import Any

from windmark.errors import UsageError


def pandas_table(columns: Mapping[str, Any]) -> Any:
    """A ``pandas.DataFrame`` of columns.

    Raises
    ------
    UsageError
        Where pandas is not installed; it is no part of windmark.
    """
    try:
        import pandas
    except ImportError as error:
        raise UsageError("to_pandas needs pandas: pip install pandas") from error
    return pandas.DataFrame(dict(columns))


def xarray_dataset(
    variables: Mapping[str, tuple[tuple[str, ...], Any, str]], coords: Mapping[str, Any] | None = None, **attrs: str
) -> Any:
    """An ``xarray.Dataset``; ``variables``: name -> names of its dimensions, values, unit ("" for none)."""
    import xarray

    data = {name: (dims, value, {"units": unit} if unit else {}) for name, (dims, value, unit) in variables.items()}
    return xarray.Dataset(data, coords=dict(coords or {}), attrs=attrs)


@dataclass(frozen=True)
class Kind:
    """What an argument must be where no class says it.

    Parameters
    ----------
    name : in words, for the message
    holds : whether a value is of the kind; looks at no array's content
    """

    name: str
    holds: Callable[[object], bool]


def _numbers(value: object) -> bool:
    """Not a noun, result, path or nothing: whatever NumPy may make an array of is left to the verb."""
    noun = is_dataclass(value) and not hasattr(value, "__array__")
    return not (value is None or noun or isinstance(value, str | os.PathLike | Mapping))


ARRAY = Kind("array", _numbers)
PATH = Kind("path", lambda value: isinstance(value, str | os.PathLike))


def list_of(kind: type) -> Kind:
    """A sequence of nouns, told by its first one."""

    def holds(value: object) -> bool:
        if isinstance(value, list | tuple):
            return not value or isinstance(value[0], kind)
        return _numbers(value)

    return Kind(f"list of {kind.__name__}", holds)


def by_name(kind: type, *, single: bool = True) -> Kind:
    """A mapping of nouns by their names, or (``single``) one noun for all."""
    text = f"{kind.__name__} or dict" if single else f"dict of {kind.__name__}"
    return Kind(text, lambda value: isinstance(value, Mapping) or (single and isinstance(value, kind)))


def optional(kind: type) -> Kind:
    """A noun or None."""
    return Kind(f"{kind.__name__} or None", lambda value: value is None or isinstance(value, kind))


def check_kinds(verb: str, **given: tuple[object, type | Kind]) -> None:
    """Refuse arguments of other kinds than expected, and name those that are swapped.

    Raises
    ------
    UsageError
        ``register: detections is a MarkerSet, markers is a Detections: they are swapped; expected ...``.
    """
    wrong = {name: (value, kind) for name, (value, kind) in given.items() if not _is(value, kind)}
    if not wrong:
        return
    got = ", ".join(f"{name} is {_called(value)}" for name, (value, _) in wrong.items())
    order = ", ".join(f"{n}: {k.name if isinstance(k, Kind) else k.__name__}" for n, (_, k) in given.items())
    values = [value for value, _ in wrong.values()]
    swapped = len(wrong) > 1 and all(any(_is(v, kind) for v in values) for _, kind in wrong.values())
    raise UsageError(f"{verb}: {got}{': they are swapped' if swapped else ''}; expected {verb}({order})")


def _is(value: object, kind: type | Kind) -> bool:
    return kind.holds(value) if isinstance(kind, Kind) else isinstance(value, kind)


def _called(value: object) -> str:
    name = type(value).__name__.removeprefix("nd")  # ndarray
    if isinstance(value, list | tuple) and value:
        name += f" of {type(value[0]).__name__}"
    return "None" if value is None else f"an {name}" if name[0] in "AEIOaeio" else f"a {name}"
