"""What is to be said of many things, said once."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence

NUMBER = re.compile(r"(?<![\w.-])[-+]?[0-9][0-9.]*(e[-+]?[0-9]+)?(?![\w-])")
"""A number that stands alone: not one in the name of a picture, a tap, a section."""
NAMED = 5
"""Names that are listed; of more, how many more there are."""
REASONS = 4
"""Different reasons that are told."""


def alike(said: Iterable[tuple[str, str]]) -> dict[str, list[str]]:
    """(Name, words) -> words and the names that they are said of; numbers that differ are those of the first."""
    first: dict[str, str] = {}
    of: dict[str, list[str]] = {}
    for name, words in said:
        of.setdefault(first.setdefault(NUMBER.sub("#", words), words), []).append(name)
    return {words: list(dict.fromkeys(names)) for words, names in of.items()}


def left_out(dropped: Mapping[str, str], reason: str) -> list[str]:
    """What could not take part and why, in one sentence; none where nothing was left out. What the ``reason`` of the
    whole says already is not said again.
    """
    groups = alike(dropped.items())
    shown = [
        f"{_few(names)} ({'for this reason' if why in reason else why})"
        for why, names in [*groups.items()][:REASONS]
    ]
    rest = sum(len(names) for names in [*groups.values()][REASONS:])
    return [f"Could not take part: {'; '.join(shown)}{f'; and {rest} more' if rest else ''}"] if shown else []


def listed(what: str, names: Sequence[str]) -> str:
    """``point p01``, or ``points p01, p02 and 3 more``."""
    return f"{what}{'s' if len(names) > 1 else ''} {_few(names)}"


def _few(names: Sequence[str]) -> str:
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return f"{', '.join(names[:NAMED])}{more}"
