"""Options of laws as a project file gives them: numbers, lists and words, checked one by one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from windmark.deformation.law import LawError

REQUIRED: Any = object()
"""Default of an option that must be given."""


def number(value: Any) -> float:
    """A finite number; TypeError otherwise, as in all readers here."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not np.isfinite(value):
        raise TypeError
    return float(value)


def whole(value: Any) -> int:
    """A whole number >= 0."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 0:
        raise TypeError
    return int(value)


def word(value: Any) -> str:
    """A text."""
    if not isinstance(value, str):
        raise TypeError
    return value


def several(read: Callable[[Any], Any], count: int | None = None) -> Callable[[Any], tuple[Any, ...]]:
    """A list of such values, of that length if one is given."""

    def read_list(value: Any) -> tuple[Any, ...]:
        if isinstance(value, str) or not isinstance(value, Sequence | np.ndarray):
            raise TypeError
        out = tuple(read(v) for v in value)
        if count is not None and len(out) != count:
            raise TypeError
        return out

    return read_list


def one_or_three(value: Any) -> float | tuple[float, ...]:
    """A number, or one for each axis."""
    return several(number, 3)(value) if isinstance(value, Sequence | np.ndarray) else number(value)


@dataclass(frozen=True)
class Option:
    """One option of a law.

    Parameters
    ----------
    name : its key
    expected : what it takes, in words
    read : turns what a file gives into what the law takes; TypeError where that cannot be
    meaning : what it is
    default : its value where it is not given; `REQUIRED` where it must be
    """

    name: str
    expected: str
    read: Callable[[Any], Any]
    meaning: str
    default: Any = REQUIRED

    @property
    def required(self) -> bool:
        """Whether it must be given."""
        return self.default is REQUIRED


def read_options(label: str, options: Sequence[Option], given: Mapping[str, Any]) -> dict[str, Any]:
    """All options of a law, defaults filled in.

    Parameters
    ----------
    label : the law, for messages
    options : those it has
    given : those that a file sets

    Raises
    ------
    LawError
        For an option that is unknown, missing or of another type.
    """
    known = [o.name for o in options]
    unknown = [name for name in given if name not in known]
    if unknown:
        raise LawError(f"{label}: has no option {unknown[0]}; it has {', '.join(known)}")
    out = {}
    for option in options:
        if option.name not in given:
            if option.required:
                raise LawError(f"{label}: option {option.name} is missing: {option.meaning}; expected "
                               f"{option.expected}")  # fmt: skip
            out[option.name] = option.default
            continue
        try:
            out[option.name] = option.read(given[option.name])
        except (TypeError, ValueError):
            raise LawError(
                f"{label}: option {option.name}: expected {option.expected}, got {given[option.name]!r}"
            ) from None
    return out
