"""What does not fit together in a whole project: all of it is found at once, each at its key."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NoReturn

from pydantic import ValidationError
from pydantic_core import InitErrorDetails, PydanticCustomError

from windmark.errors import WindmarkError
from windmark.pipeline.settings import unusable_name
from windmark.pipeline.typed import nearest

INCONSISTENT = "inconsistent"
"""Type of these among pydantic's errors."""


class Faults:
    """Collected by a project's own check, which ends with `refuse`.

    A check that stopped at the first would hide the others, and could not say in which line each is.
    """

    def __init__(self) -> None:
        self._found: list[InitErrorDetails] = []

    def add(self, words: str, *loc: str | int, certain: bool = False) -> None:
        """Something that is wrong at a key, as ``"image", 0, "camera"``.

        ``certain``: it stays so whatever else the project lacks.
        """
        kind = PydanticCustomError(INCONSISTENT, "{words}", {"words": words, "certain": certain})
        self._found.append(InitErrorDetails(type=kind, loc=loc, input=None))

    @contextmanager
    def at(self, *loc: str | int) -> Iterator[None]:
        """What is refused within is a fault at this key."""
        try:
            yield
        except WindmarkError as error:
            self.add(str(error).removeprefix(f"{loc[0]}: "), *loc)

    def names(self, table: str, names: Sequence[str], key: str = "name") -> None:
        """Names of the entries of a list of tables: each only once, each such that a file can be called so."""
        bad = -1  # thousands of pictures have names: where the first is that cannot stand is looked for only if one is
        if unusable_name(names) is not None:
            bad = bisect_left(range(len(names)), True, key=lambda k: unusable_name(names[: k + 1]) is not None)
        seen: set[str] = set()
        for k, name in enumerate(names):
            if name in seen:
                self.add(f"{table} names must be unique, more than once: {name}", table, k, key, certain=True)
            elif k == bad:
                why = unusable_name(names[: k + 1])
                self.add(f"{table} names become file names, and {why}", table, k, key, certain=True)
            seen.add(name)

    def files(self, cameras: Sequence[Any]) -> None:
        """Files of cameras that stand somewhere: each is of one, whose place it says."""
        for k, camera in enumerate(cameras):
            other = next((c for c in cameras[:k] if c.file == camera.file), None)
            if other is not None:
                words = f"cameras {other.name} and {camera.name} have the same file; each has its own, with its place"
                self.add(words, "camera", k, "file", certain=True)

    def known(self, name: str, every: Collection[str], what: str, *loc: str | int) -> None:
        """A name must be one of these; ``what`` says what they are names of."""
        if name not in every:
            self.add(f"{name!r} is not the name of {what}{nearest(name, every)}; expected one of "
                     f"{', '.join(every) or '(there are none)'}", *loc, certain=True)  # fmt: skip

    def refuse(self, title: str) -> None:
        """Raise what was found, if anything was."""
        if self._found:
            self._raise(title)

    def _raise(self, title: str) -> NoReturn:
        raise ValidationError.from_exception_data(title, self._found)
