"""The stage at work, shown to a person at a terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from typing import Any

try:  # typer has a click of its own since 0.26
    from typer._click.globals import get_current_context
except ImportError:
    from click import get_current_context  # type: ignore[no-redef]


@contextmanager
def progress(total: int | None = None) -> Iterator[Callable[[str], None]]:
    """A function that shows the stage at work: a spinner on a terminal, nothing in a pipe or beside JSON.

    Of ``total`` parts (frames, points) each call ends one: a bar with their count and the time that is left. Stages
    that count their parts themselves (`clock.counting`) have such a bar while they last.
    """
    if _unseen():
        yield lambda _: None
        return
    if total:
        with counted("start") as step:
            done = count(1)
            yield lambda stage: step(stage, min(next(done), total), total)
        return
    from windmark.pipeline.clock import Counted

    with _bars() as bar:
        task = bar.add_task("start", total=None)

        def show(stage: str) -> None:
            if isinstance(stage, Counted) and stage.of > 1:
                if stage.done == 0:  # the time left is that of this stage
                    bar.reset(task, total=stage.of)
                bar.update(task, description=str(stage), completed=stage.done)
                return
            if bar.tasks[0].finished:
                bar.tasks[0].total = None
            bar.update(task, description=stage)

        yield show


@contextmanager
def counted(what: str) -> Iterator[Callable[[str, int, int], None]]:
    """A function that shows the name of a step, its number and how many there are: a bar with the time that is left
    on a terminal, nothing in a pipe or beside JSON.
    """
    if _unseen():
        yield lambda name, number, count: None
        return
    with _bars() as bar:
        task = bar.add_task(what, total=None)
        yield lambda name, number, count: bar.update(task, description=name or what, completed=number, total=count)


def _unseen() -> bool:
    """Whether nobody looks at a progress: no terminal, or the answer is for a machine."""
    context = get_current_context(silent=True)
    return not sys.stderr.isatty() or (context is not None and bool(context.params.get("as_json")))


@contextmanager
def _bars() -> Iterator[Any]:
    """A line on the terminal: a spinner and, where the parts are counted, a bar, their number and the time left."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        ProgressColumn,
        SpinnerColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    class WhileCounted(ProgressColumn):
        """A column that is empty while nothing is counted."""

        def __init__(self, column: ProgressColumn) -> None:
            super().__init__()
            self._column = column

        def render(self, task: Any) -> Any:
            return "" if task.total is None else self._column(task)

    parts = [WhileCounted(c) for c in (BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())]
    columns = SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn(), *parts
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        yield bar
