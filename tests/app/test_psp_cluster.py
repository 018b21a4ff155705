"""`windmark psp --scheduler`: the same bytes as here, a worker that is killed, a run that is stopped and goes on."""

import contextlib
import csv
import json
import os
import shutil
import subprocess
import sys
import threading
import time

import pytest

from windmark.pipeline.resume import measured
from windmark.pipeline.simulate_taps import tap_table
from windmark.synth import psp_test

# A scheduler and workers in processes of their own.
pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("all_undrawn")]

pytest.importorskip("distributed", reason="the extra `cluster` is not installed (pip install windmark[cluster])")

START_S = 90


@pytest.fixture(scope="module")
def polar(one_camera, tmp_path_factory):
    """Three points of the pictures of one, one of each kind by one camera, and one point whose reference is missing."""
    folder = tmp_path_factory.mktemp("cluster") / "test"
    folder.mkdir()
    # What travels and what is killed is the same for more pictures.
    one_camera(folder, psp_test(12, incidences=1, size_px=(640, 400), nodes=5_000, taps=tap_table(), on_frames=1,
                                off_frames=1))  # fmt: skip
    with open(folder / "points.csv", newline="") as stream:
        (row,) = csv.DictReader(stream)
    rows = [{**row, "point": f"p{k}"} for k in range(3)] + [{**row, "point": "bad", "off": "none-{camera}.tif"}]
    with open(folder / "points.csv", "w", newline="") as stream:
        writer = csv.DictWriter(stream, row)
        writer.writeheader()
        writer.writerows(rows)
    return folder


class Cluster:
    """A scheduler and workers as a user starts them; workers without a nanny, which would start them again."""

    def __init__(self, place):
        self.place = place
        self.file = place / "scheduler.json"
        self.scheduler = self._start("dask_scheduler", "--port", "0", "--no-dashboard")
        self.workers = []
        try:
            self.address = self._address()
        except BaseException:
            self.close()
            raise

    def _address(self):
        """Waited for until it is whole: the scheduler writes its file in place."""
        end = time.monotonic() + START_S
        while time.monotonic() < end and self.scheduler.poll() is None:
            try:
                return json.loads(self.file.read_text())["address"]
            except (FileNotFoundError, json.JSONDecodeError):
                time.sleep(0.05)
        raise RuntimeError(f"the scheduler did not say its address in {START_S} s: {self.scheduler.poll()=}")

    def worker(self):
        self.workers.append(self._start("dask_worker", "--no-nanny", "--nthreads", "1", "--no-dashboard"))
        return self.workers[-1]

    def _start(self, what, *more):
        command = [sys.executable, "-m", f"distributed.cli.{what}", "--scheduler-file", self.file]
        as_a_user = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")}
        return subprocess.Popen([*command, "--host", "127.0.0.1", *more], cwd=self.place, env=as_a_user,
                                stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)  # fmt: skip

    def dismiss(self):
        """No worker any more."""
        for process in self.workers:
            process.kill()
            process.wait()
        self.workers.clear()

    def close(self):
        self.dismiss()
        self.scheduler.kill()
        self.scheduler.wait()


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory):
    made = Cluster(tmp_path_factory.mktemp("scheduler"))
    yield made
    made.close()


@pytest.fixture
def cluster(scheduler):
    """The module's scheduler, as it was before the first worker."""
    yield scheduler
    scheduler.dismiss()


def results(folder):
    return {
        str(p.relative_to(folder)): p.read_bytes()
        for p in sorted(folder.rglob("*")) if p.is_file() and p.suffix in (".csv", ".vtp", ".pvd")
    }  # fmt: skip


def kept(out):
    return max(measured(folder) for folder in (out, out.with_name(f".windmark-{out.name}") / "new"))


@contextlib.contextmanager
def killed_after_two(worker, out):
    """Meanwhile the worker is killed, as soon as two points are kept."""

    def kill():
        end = time.monotonic() + START_S
        while kept(out) < 2 and time.monotonic() < end:
            time.sleep(0.01)
        worker.kill()

    killer = threading.Thread(target=kill)
    killer.start()
    try:
        yield
    finally:
        killer.join()


@pytest.fixture(scope="module")
def whole(windmark, polar, tmp_path_factory):
    out = tmp_path_factory.mktemp("whole") / "out"
    assert windmark("psp", polar / "psp.toml", "-o", out).code == 0
    return results(out)


@pytest.mark.filterwarnings("ignore")  # of the library
def test_two_workers_one_of_them_killed_give_the_same_bytes(windmark, polar, cluster, whole, tmp_path):
    out = tmp_path / "out"
    first, _ = cluster.worker(), cluster.worker()
    with killed_after_two(first, out):
        done = windmark("psp", polar / "psp.toml", "-o", out, "--scheduler", cluster.address, "--json")
    assert done.code == 0, done.err
    assert first.poll() is not None
    assert (done.json["reduced"], done.json["failed"]) == (3, 1)
    assert results(out) == whole
    inputs = (out / "manifest.json").read_text()
    assert "on-cam1-0.tif" in inputs  # pictures that only workers reduced are inputs of the result


@pytest.mark.filterwarnings("ignore")
def test_a_run_on_the_cluster_that_was_stopped_goes_on_anywhere(windmark, polar, cluster, whole, tmp_path):
    out = tmp_path / "out"
    with killed_after_two(cluster.worker(), out):  # the only one: the run ends by itself, with what there is
        ended = windmark("psp", polar / "psp.toml", "-o", out, "--scheduler", cluster.address)
    assert ended.code == 2
    assert "has no worker left" in ended.err
    assert "points are kept: --resume goes on" in ended.err
    before = kept(out)
    assert before >= 2
    again = windmark("psp", polar / "psp.toml", "-o", out, "--resume", "--threads", 2, "--json")
    assert again.code == 0, again.err
    assert results(out) == whole


def test_what_is_wrong_with_a_cluster_is_said(windmark, polar, cluster, tmp_path, monkeypatch):
    from windmark.pipeline.psp import cluster as job

    monkeypatch.setattr(job, "ANSWER_S", 0.5)
    monkeypatch.setattr(job, "WORKERS_S", 0.5)
    out = tmp_path / "out"
    both = windmark("psp", polar / "psp.toml", "--scheduler", cluster.address, "--threads", 2)
    assert both.code == 2
    assert "--threads is of this machine" in both.err
    for address, words in (("tcp://127.0.0.1:9", "no scheduler answers at tcp://127.0.0.1:9"),
                           (cluster.address, "has no worker")):  # fmt: skip
        done = windmark("psp", polar / "psp.toml", "-o", out, "--scheduler", address)
        assert done.code == 2
        assert words in done.err
    assert not out.exists()


def test_a_worker_with_another_project_is_refused(polar, tmp_path):
    """What a worker does, here: the project differs from that of the run, or the folder is not there."""
    import json

    from windmark.io import FileError
    from windmark.pipeline.psp import load_psp, made_with, read_psp_project
    from windmark.pipeline.psp.cluster import point_there

    copied = shutil.copytree(polar, tmp_path / "test")
    made = made_with(load_psp(read_psp_project(copied / "psp.toml")))
    made["files"]["points.table"] = "another"
    with pytest.raises(FileError, match=r"psp\.toml: on the worker .*: is not that of the run: points.table has"):
        point_there(str(copied / "psp.toml"), json.dumps(made), str(tmp_path), "p0")
    made = made_with(load_psp(read_psp_project(copied / "psp.toml")))
    with pytest.raises(FileError, match="expected a disk that all machines share"):
        point_there(str(copied / "psp.toml"), json.dumps(made), str(tmp_path / "none"), "p0")
    (copied / "taps.csv").unlink()
    with pytest.raises(FileError, match="on the worker"):
        point_there(str(copied / "psp.toml"), "{}", str(tmp_path), "p0")
