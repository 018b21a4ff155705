"""Stage times and progress: measured once, shown on a terminal, written into every result."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from windmark.compiling import working_time

Progress = Callable[[str], None]
"""Called with one line of text whenever a stage starts."""


def silent(_: str) -> None:
    """A progress that shows nothing."""


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
