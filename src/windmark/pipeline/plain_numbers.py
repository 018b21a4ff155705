"""Numbers of settings files as they are written: the library takes true for 1, "4.0" for 4, and inf."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel

from windmark.errors import UsageError

_NUMBERS, _TEXTS = {int, float}, {str, Path}


def check_numbers(annotation: Any, value: Any) -> None:
    """Refuse what stands in a number's place and is none.

    Parameters
    ----------
    annotation : the type of the setting; one that may be something else than numbers may be written like that
    value : what the file has; lists are looked through, tables check themselves

    Raises
    ------
    UsageError
        For a truth value, a text, or a number that is not finite, where the type has numbers and none of these.
    """
    kinds = set(_kinds(annotation))
    if not kinds & _NUMBERS or Any in kinds:
        return
    for leaf in _leaves(value):
        if isinstance(leaf, bool) and bool not in kinds:
            raise UsageError(f"expected a number, got {str(leaf).lower()}")
        if isinstance(leaf, str) and not kinds & _TEXTS:
            raise UsageError(f"expected a number, without quotes, got {leaf!r}")
        if isinstance(leaf, float) and not math.isfinite(leaf):
            raise UsageError(f"expected a finite number, got {leaf}")


def _kinds(annotation: Any) -> Iterator[Any]:
    """The plain types within a type."""
    if get_origin(annotation) is Literal:
        yield from map(type, get_args(annotation))
        return
    inner = getattr(annotation, "__metadata__", None)
    args = get_args(annotation)[:1] if inner is not None else get_args(annotation)
    if not args:
        yield annotation
    for arg in args:
        yield from _kinds(arg)


def _leaves(value: Any) -> Iterator[Any]:
    """What lists hold, and theirs; a table or its model says itself what it expects."""
    if isinstance(value, list | tuple):
        for one in value:
            yield from _leaves(one)
    elif not isinstance(value, dict | BaseModel):
        yield value
