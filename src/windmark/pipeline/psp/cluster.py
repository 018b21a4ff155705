"""Points on the workers of a `dask.distributed` cluster: machines that see the same files under the same paths.

A worker gets a point's name, not its data: it reads the project itself, once, and writes the point's folder. What it
sends back is the point's record, as a thread's is. The library computes anew what a lost worker had stored
(distributed, issue 8182); so a record is taken as soon as it is there, and the journal is what a run goes on from.
"""

from __future__ import annotations

import errno
import json
import socket
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from windmark import io
from windmark.errors import UsageError
from windmark.pipeline import same_run
from windmark.pipeline.psp.each import one_point, pictures_of
from windmark.pipeline.psp.load import PspTest, load_psp
from windmark.pipeline.psp.made import made_with
from windmark.pipeline.psp.project import read_psp_project
from windmark.pipeline.psp.record import PointRecord, failed
from windmark.pipeline.psp.table import PointRow

ANSWER_S, WORKERS_S, LOOK_S = 10.0, 60.0, 5.0
"""Waiting for the scheduler, for a first worker, and between looks whether there is one left."""


def on_cluster(test: PspTest, folder: Path, rows: Sequence[PointRow], scheduler: str) -> Iterator[PointRecord]:
    """The records of points as they come.

    Parameters
    ----------
    folder : that the results go to, on a disk that all workers share
    scheduler : address, such as ``tcp://10.0.0.7:8786``

    Raises
    ------
    UsageError
        Where `distributed` is not installed.
    OSError
        Where no scheduler answers, or it has no worker (any more): what is done is in the journal.
    FileError
        Where a worker sees another project, or other pictures.
    """
    client = _client(scheduler)
    try:
        made, place = json.dumps(made_with(test)), str(folder.resolve())
        jobs = {
            client.submit(point_there, str(test.project.path), made, place, row.name, pure=False): row for row in rows
        }
        try:
            while jobs:
                for job in _finished(client, scheduler, list(jobs)):
                    row = jobs.pop(job)
                    yield _checked(test, row, _record(test, row, job))
        finally:
            client.cancel(list(jobs))
    finally:
        client.close()


def _client(scheduler: str) -> Any:
    try:
        from distributed import Client
    except ImportError:
        raise UsageError("--scheduler needs the package distributed: pip install windmark[cluster]") from None
    try:
        client = Client(scheduler, timeout=ANSWER_S)
    except (OSError, ValueError):  # the latter for what is no address
        said = f"no scheduler answers at {scheduler}; expected the address of one that runs, such as tcp://HOST:8786"
        raise OSError(errno.ECONNREFUSED, said) from None
    try:
        client.wait_for_workers(1, timeout=WORKERS_S)
    except TimeoutError:
        client.close()
        raise OSError(errno.EHOSTDOWN, f"the scheduler at {scheduler} has no worker") from None
    return client


def _finished(client: Any, scheduler: str, jobs: list[Any]) -> Iterator[Any]:
    """Jobs that have come to an end, at least one."""
    from concurrent.futures import CancelledError

    from distributed import wait

    while True:
        try:
            done = wait(jobs, timeout=LOOK_S, return_when="FIRST_COMPLETED").done
            # What stopped one of them comes last, so that no point that is done is lost.
            yield from sorted(done, key=lambda job: job.status == "error")
            return
        except TimeoutError:
            if not client.scheduler_info()["workers"]:
                raise OSError(errno.EHOSTDOWN, f"the cluster at {scheduler} has no worker left") from None
        except CancelledError:
            raise OSError(errno.EHOSTDOWN, f"the scheduler at {scheduler} was lost") from None


def _record(test: PspTest, row: PointRow, job: Any) -> PointRecord:
    from distributed import KilledWorker

    try:
        record: PointRecord = job.result()
    except KilledWorker:
        return failed(row, pictures_of(test, row), "every worker that had it died: too little memory?")
    return record


def _checked(test: PspTest, row: PointRow, record: PointRecord) -> PointRecord:
    """The record, if it is of the pictures that are seen here; reading them makes them the result's inputs, too."""
    if dict(record.pictures) != pictures_of(test, row):
        raise io.FileError(test.project.path, f"a worker sees other pictures of point {row.name} than this machine")
    return record


_LOADED: dict[tuple[str, str], PspTest] = {}
_LOADING = threading.Lock()


def point_there(project: str, made: str, folder: str, name: str) -> PointRecord:
    """Reduce a point; runs on a worker.

    Raises
    ------
    FileError
        Naming this machine, where the project, what it names or this windmark is not that of the run, or the folder of
        the results is not there.
    """
    here = f"on the worker {socket.gethostname()}"
    try:
        with _LOADING:
            if (project, made) not in _LOADED:
                _LOADED.clear()
                _LOADED[project, made] = _the_same(Path(project), json.loads(made))
            test = _LOADED[project, made]
    except io.FileError as error:
        raise io.FileError(error.path, f"{here}: {error.what}", error.where) from None
    if not Path(folder).is_dir():
        raise io.FileError(folder, f"{here}: there is no such folder; expected a disk that all machines share")
    return one_point(test, Path(folder), next(row for row in test.rows if row.name == name))


def _the_same(project: Path, made: dict[str, Any]) -> PspTest:
    import scipy.linalg  # noqa: F401  it brings a BLAS of its own, which is to be told, too
    from threadpoolctl import threadpool_limits

    # As the command line has it: sums over another number of threads differ in their last digits, and with them every
    # file. For good, not for a block: a worker's threads share the library's settings.
    threadpool_limits(limits=1, user_api="blas")
    test = load_psp(read_psp_project(project))
    if (why := same_run.changed(made, made_with(test))) is not None:
        raise io.FileError(project, f"is not that of the run: {why}")
    return test
