"""Files that are added to a folder together, for formats of several files; for the result of a job see `results`."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from windmark.io.atomic import writing
from windmark.io.exchange import add
from windmark.io.interrupts import interrupts_wait
from windmark.io.leftovers import put_right
from windmark.io.staging import silent, staged
from windmark.io.written import note_written


@contextmanager
def atomic_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a temporary folder; the files written there move into ``path`` together when the block ends.

    ``path`` is created when missing (its parent must exist). Files of the same name are replaced, other files in
    ``path`` stay. Any exception leaves ``path`` as it was; what a kill breaks off, the next one finishes. For the
    result of a job: `result_folder`.

    Raises
    ------
    FileError
        When the operating system refuses (before anything is written, if it can be known then), or another process
        writes there: names ``path`` and the reason.
    """
    with staged(path, parents=False) as staging, writing(path, staging.target, staging.hidden):
        put_right(path, staging, silent)
        staging.new.mkdir()
        yield staging.new
        with interrupts_wait(f"{staging.target} had been written whole before"):
            add(staging)
            note_written(staging.target)
