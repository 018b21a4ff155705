"""A whole paint test: points in parallel, each written whole; what is stopped can go on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from windmark.pipeline import same_run
from windmark.pipeline.psp.cluster import on_cluster
from windmark.pipeline.psp.each import in_threads, pictures_of
from windmark.pipeline.psp.load import PspTest
from windmark.pipeline.psp.made import made_with
from windmark.pipeline.psp.outputs import write_all
from windmark.pipeline.psp.record import REDUCED, PointRecord
from windmark.pipeline.resume import CHUNK, SeriesJournal, read_stopped


def run_psp(
    test: PspTest,
    folder: Path,
    *,
    threads: int = 1,
    scheduler: str | None = None,
    say: Callable[[PointRecord], None] = lambda _: None,
    resume: bool = False,
    finish: bool = False,
) -> list[PointRecord]:
    """Reduce all points and write their results.

    Points do not depend on each other: the same results, whatever reduces them. A point that cannot be reduced has a
    record with the reason. Beside the results stands a journal of the points that are done, with which a run that was
    stopped goes on, in whatever order they came.

    Parameters
    ----------
    test : see `load_psp`
    folder : existing, that the results go to
    threads : points at a time
    scheduler : address of a `dask.distributed` scheduler whose workers do it; None: threads of this process
    say : called with the record of every point, as they come
    resume : go on with the run that was stopped in ``folder``
    finish : only bring that run's results to their end

    Raises
    ------
    OSError, UsageError
        Where a cluster is not there, see `on_cluster`.
    FileError
        Where results cannot be written; where there is no run to go on with, or what it was made with has changed.
    """
    made = made_with(test)
    stopped = None
    if resume or finish:
        same_run.check_begun(folder, made)
        stopped = read_stopped(folder, {}, to_go_on=not finish)
    records: list[PointRecord] = [] if stopped is None else list(stopped.frames)
    kept = {record.key for record in records}
    if stopped is not None:
        of = {row.name: row for row in test.rows}
        now = [(key, pictures_of(test, of[key])) for key in (r.key for r in records) if key in of]
        same_run.check_pictures(folder, records, now, of="point")
    left = [] if finish else [row for row in test.rows if row.name not in kept]
    journal = SeriesJournal(folder, {}, stopped)
    try:
        if stopped is None:
            journal.begin(made, {})
        for record in (
            in_threads(test, folder, left, threads) if scheduler is None else on_cluster(test, folder, left, scheduler)
        ):
            journal.add(record, {"done": len(records) + 1})
            records.append(record)
            if len(records) % CHUNK == 0:
                journal.sync()
            say(record)
    finally:
        journal.close()
    order = {row.name: k for k, row in enumerate(test.rows)}
    records.sort(key=lambda record: order[record.key])
    write_all(folder, test, records)
    return records


def reduced(records: Sequence[PointRecord]) -> list[PointRecord]:
    """The points that came to a result."""
    return [r for r in records if r.status == REDUCED]
