"""Stage times and progress: measured once, shown on a terminal, written into every result."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import count

from windmark.compiling import working_time

Progress = Callable[[str], None]
"""Called with one line of text whenever a stage starts."""


class Counted(str):
    """A line of a progress that knows how many parts of a stage have ended, and how many there are."""

    __slots__ = ("done", "of")
    done: int
    of: int

    def __new__(cls, text: str, done: int, of: int) -> Counted:
        """A line with its count."""
        made = super().__new__(cls, text)
        made.done, made.of = done, of
        return made


def silent(_: str) -> None:
    """A progress that shows nothing."""


def counting(progress: Progress, stage: str, of: int) -> Progress:
    """A function to be called with the name of each part of a stage that has ended, by any thread."""
    done = count(1)
    progress(Counted(stage, 0, of))
    return lambda name: progress(Counted(f"{stage} {name}", next(done), of))


@dataclass
class Clock:
    """Seconds of wall time per stage, in the order in which the stages ran."""

    progress: Progress = silent
    label: str = ""
    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Time a stage; a stage that is entered again adds up."""
        self.progress(f"{self.label}: {stage}" if self.label else stage)
        start = working_time()
        try:
            yield
        finally:
            self.seconds[stage] = self.seconds.get(stage, 0.0) + working_time() - start

    @property
    def total(self) -> float:
        """Sum over the stages, seconds."""
        return sum(self.seconds.values())
