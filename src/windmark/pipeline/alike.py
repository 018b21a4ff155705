"""What is to be said of many things, said once."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

NUMBER = re.compile(r"(?<![\w.-])[-+]?[0-9][0-9.]*(e[-+]?[0-9]+)?(?![\w-])")
"""A number that stands alone: not one in the name of a picture, a tap, a section."""
NAMED = 5
"""Names that are listed; of more, how many more there are."""


def alike(said: Iterable[tuple[str, str]]) -> dict[str, list[str]]:
    """(Name, words) -> words and the names that they are said of; numbers that differ are those of the first."""
    first: dict[str, str] = {}
    of: dict[str, list[str]] = {}
    for name, words in said:
        of.setdefault(first.setdefault(NUMBER.sub("#", words), words), []).append(name)
    return {words: list(dict.fromkeys(names)) for words, names in of.items()}


def listed(what: str, names: Sequence[str]) -> str:
    """``point p01``, or ``points p01, p02 and 3 more``."""
    if len(names) == 1:
        return f"{what} {names[0]}"
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return f"{what}s {', '.join(names[:NAMED])}{more}"
