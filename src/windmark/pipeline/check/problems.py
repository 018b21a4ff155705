"""What is wrong with a project, and in which line."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from windmark.errors import WindmarkError
from windmark.io.errors import FileError
from windmark.pipeline.toml_lines import Key, line_of


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong.

    Parameters
    ----------
    line : of the project file; None where it is of no line
    key : the setting
    words : what is wrong, and what was expected
    """

    line: int | None
    key: str
    words: str

    def __str__(self) -> str:
        place = ([] if self.line is None else [f"line {self.line}"]) + ([self.key] if self.key else [])
        return f"{', '.join(place)}: {self.words}" if place else self.words


@dataclass
class Checked:
    """What was found.

    Parameters
    ----------
    path : the project file
    kind : the verb that carries it out; "" unknown
    problems : all, in the order of the file
    read : what was read and is sound, in words
    """

    path: Path
    kind: str = ""
    problems: list[Problem] = field(default_factory=list)
    read: list[str] = field(default_factory=list)


@contextmanager
def noting(out: Checked, lines: dict[Key, int], key: str = "") -> Iterator[None]:
    """What is refused within becomes a problem at a key."""
    try:
        yield
    except FileError as error:
        of_project = error.path.resolve() == out.path.resolve()
        where = str(error.where or key) if of_project else key
        words = error.what if of_project else str(error)
        out.problems.append(Problem(line_of(lines, keys_of(where)), where, words))
    except WindmarkError as error:
        out.problems.append(Problem(line_of(lines, keys_of(key)), key, str(error)))


def keys_of(key: str | None) -> Key:
    """``image[0].file`` as pydantic names it."""
    parts = re.findall(r"[^.\[\]]+", key or "")
    return tuple(int(p) if p.isdigit() else p for p in parts)
