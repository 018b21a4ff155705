"""Points one by one: each is written whole, and one that cannot be reduced stops no other. In threads here."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from pathlib import Path

from windmark.errors import WindmarkError
from windmark.pipeline import same_run
from windmark.pipeline.psp.load import PspTest
from windmark.pipeline.psp.outputs import write_point
from windmark.pipeline.psp.point import run_point
from windmark.pipeline.psp.record import PointRecord, failed, record_of
from windmark.pipeline.psp.sensors import pictures_named
from windmark.pipeline.psp.table import PointRow


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
    for kind, pattern in row.patterns.items():
        for camera in test.project.camera:
            files = pictures_named(test.project, pattern, camera.name) if pattern else []
            out[f"{kind} {camera.name}"] = " ".join(same_run.picture_print(f) for f in files)
    return out


def in_threads(test: PspTest, folder: Path, rows: Sequence[PointRow], threads: int) -> Iterator[PointRecord]:
    """The records of points as they come; at most two for each thread are under way or waiting to be taken."""
    with ThreadPoolExecutor(max_workers=threads) as pool:
        under_way: set[Future[PointRecord]] = set()
        try:
            for row in rows:
                under_way.add(pool.submit(one_point, test, folder, row))
                if len(under_way) >= 2 * threads:
                    done, under_way = wait(under_way, return_when=FIRST_COMPLETED)
                    yield from _records(done)
            while under_way:
                done, under_way = wait(under_way, return_when=FIRST_COMPLETED)
                yield from _records(done)
        finally:
            for job in under_way:
                job.cancel()


def _records(done: set[Future[PointRecord]]) -> Iterator[PointRecord]:
    """The records of jobs that ended; what stopped one of them comes last, so that no point that is done is lost."""
    for job in sorted(done, key=lambda job: job.exception() is not None):
        yield job.result()
