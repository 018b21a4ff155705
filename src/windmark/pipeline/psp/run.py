"""A whole paint test: points in parallel, each written whole; what is stopped can go on."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

from windmark.errors import WindmarkError
from windmark.pipeline import same_run
from windmark.pipeline.deform.resume import inputs as deform_inputs
from windmark.pipeline.psp.load import PspTest
from windmark.pipeline.psp.outputs import write_all, write_point
from windmark.pipeline.psp.point import run_point
from windmark.pipeline.psp.project import PspProject
from windmark.pipeline.psp.record import REDUCED, PointRecord, failed, record_of
from windmark.pipeline.psp.sensors import pictures_named
from windmark.pipeline.psp.table import PointRow
from windmark.pipeline.resume import CHUNK, SeriesJournal, read_stopped


def run_psp(
    test: PspTest,
    folder: Path,
    *,
    threads: int = 1,
    say: Callable[[PointRecord], None] = lambda _: None,
    resume: bool = False,
    finish: bool = False,
) -> list[PointRecord]:
    """Reduce all points and write their results.

    Points do not depend on each other: the same results, whatever ``threads`` is. A point that cannot be reduced has a
    record with the reason. Beside the results stands a journal, with which a run that was stopped goes on.

    Parameters
    ----------
    test : see `load_psp`
    folder : existing, that the results go to
    threads : points at a time
    say : called with the record of every point, in the table's order
    resume : go on with the run that was stopped in ``folder``
    finish : only bring that run's results to their end

    Raises
    ------
    FileError
        Where results cannot be written; where there is no run to go on with, or what it was made with has changed.
    """
    made = made_with(test)
    stopped = None
    if resume or finish:
        same_run.check_begun(folder, made)
        stopped = read_stopped(folder, {}, to_go_on=not finish)
    records: list[PointRecord] = [] if stopped is None else list(stopped.frames)
    if stopped is not None:
        now = [(row.name, pictures_of(test, row)) for row in test.rows[: len(records)]]
        same_run.check_pictures(folder, records, now)
    left = [] if finish else test.rows[len(records) :]
    journal = SeriesJournal(folder, {}, stopped)
    try:
        if stopped is None:
            journal.begin(made, {})
        for record in _each(test, folder, left, threads):
            journal.add(record, {"done": len(records) + 1})
            records.append(record)
            if len(records) % CHUNK == 0:
                journal.sync()
            say(record)
    finally:
        journal.close()
    write_all(folder, test, records)
    return records


def _each(test: PspTest, folder: Path, rows: Sequence[PointRow], threads: int) -> Iterator[PointRecord]:
    """The records of points in their order; at most two for each thread are under way or waiting to be taken."""
    with ThreadPoolExecutor(max_workers=threads) as pool:
        waiting: list[Future[PointRecord]] = []
        todo = iter(rows)
        try:
            for row in todo:
                waiting.append(pool.submit(one_point, test, folder, row))
                if len(waiting) >= 2 * threads:
                    yield waiting.pop(0).result()
            while waiting:
                yield waiting.pop(0).result()
        finally:
            for job in waiting:
                job.cancel()


def one_point(test: PspTest, folder: Path, row: PointRow) -> PointRecord:
    """Reduce a point and write its folder; whatever is wrong with its data becomes its record's reason."""
    pictures = pictures_of(test, row)
    try:
        done = run_point(test, row)
    except WindmarkError as error:
        return failed(row, pictures, str(error))
    record = record_of(row, pictures, done)
    write_point(folder, test, done, record)
    return record


def pictures_of(test: PspTest, row: PointRow) -> dict[str, str]:
    """Kind and camera -> `same_run.picture_print` of a point's pictures."""
    out = {}
    for kind, pattern in (("wind-on", row.on), ("wind-off", row.off)):
        for camera in test.project.camera:
            files = pictures_named(test.project, pattern, camera.name) if pattern else []
            out[f"{kind} {camera.name}"] = " ".join(same_run.picture_print(f) for f in files)
    return out


def made_with(test: PspTest) -> dict[str, Any]:
    """See `same_run.made_with`; where the results go is left out."""
    project = test.project
    options = json.loads(project.model_dump_json(exclude={"path": True, "output": {"folder"}}))
    return same_run.made_with("psp", {f"[{k}] of the project": v for k, v in options.items()}, inputs(test))


def inputs(test: PspTest) -> list[tuple[str, Path]]:
    """The files besides the points' pictures that a project names, each with its key."""
    project: PspProject = test.project
    out = [("points.table", project.points.table)]
    paint = (("paint.cell", project.paint.cell), ("paint.calibration", project.paint.calibration))
    out += [(key, path) for key, path in paint if path is not None]
    out += deform_inputs(test.deforming.project)
    taps, warm = project.taps, project.temperature
    if taps is not None:
        out += [("taps.file", taps.file), ("taps.pressures", taps.pressures)]
    if warm.thermocouples is not None and warm.readings is not None:
        out += [("temperature.thermocouples", warm.thermocouples), ("temperature.readings", warm.readings)]
    for key in ("dark", "flat"):
        pattern = getattr(project.radiometry, key)
        if pattern is not None:
            for camera in project.camera:
                files = pictures_named(project, pattern, camera.name)
                out += [(f"radiometry.{key} {f.name}", f) for f in files if isinstance(f, Path)]
    return out


def reduced(records: Sequence[PointRecord]) -> list[PointRecord]:
    """The points that came to a result."""
    return [r for r in records if r.status == REDUCED]
