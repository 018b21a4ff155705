"""A whole paint test by threads and on a cluster: the same bytes? and what do more threads or workers bring?

    python benchmarks/paint_scaling.py [--points 40] [--seed 77] [--size 640 400] [--folder TEST] [--json FILE]

One test (two cameras), reduced by one thread, two threads, and two workers of a `dask.distributed` scheduler on this
machine, each in a process of its own as a user starts it; then on the cluster once more with a worker killed in the
middle (the other one goes on), and with the whole run killed in the middle and resumed. Every table and every ParaView
file must be the same, byte for byte. Times are wall times of the points alone, by the journal's own clock of each
point added up ("work") and by the run's ("wall"): on a machine that others use, only their ratios say something.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from windmark.pipeline.resume import measured
from windmark.pipeline.simulate_psp import simulate_psp

LIMIT_S = 3600.0


def prints(folder: Path) -> dict[str, str]:
    """Name -> hash of every file of a result but those that name times."""
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest()
            for p in sorted(folder.rglob("*")) if p.suffix in (".csv", ".vtp", ".pvd")}  # fmt: skip


def kept(out: Path) -> int:
    """Points in the journal of a run."""
    return max(measured(folder) for folder in (out, out.with_name(f".windmark-{out.name}") / "new"))


def psp(project: Path, out: Path, *more: str, amid: Callable[[subprocess.Popen[str]], None] | None = None) -> dict:
    """Run the verb; ``amid`` is called once a third of the points is done. Its summary, or {} if it was killed."""
    command = [sys.executable, "-m", "windmark.app.cli", "psp", str(project), "-o", str(out), "--json", *more]
    start = time.perf_counter()
    run = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    if amid is not None:
        points = len(project.with_name("points.csv").read_text().splitlines()) - 1
        while run.poll() is None and kept(out) < points // 3 and time.perf_counter() - start < LIMIT_S:
            time.sleep(0.05)
        amid(run)
    said, trouble = run.communicate(timeout=LIMIT_S)
    if run.returncode:
        print(f"ended with {run.returncode}: {trouble.strip().splitlines()[-1:]}", flush=True)
        return {}
    return {**json.loads(said), "wall": time.perf_counter() - start}


class Cluster:
    """A scheduler with workers of one thread each, on this machine."""

    def __init__(self, place: Path) -> None:
        self.file = place / "scheduler.json"
        self.processes = [self._start("dask_scheduler", "--port", "0", "--no-dashboard")]
        self.address = self._address()

    def _address(self) -> str:
        """Waited for until it is whole: the scheduler writes its file in place."""
        while self.processes[0].poll() is None:
            try:
                return str(json.loads(self.file.read_text())["address"])
            except (FileNotFoundError, json.JSONDecodeError):
                time.sleep(0.05)
        raise SystemExit("no scheduler could be started; is the extra cluster installed?")

    def worker(self) -> subprocess.Popen[bytes]:
        """One more, which nobody starts again."""
        self.processes.append(self._start("dask_worker", "--no-nanny", "--nthreads", "1", "--no-dashboard"))
        return self.processes[-1]

    def _start(self, what: str, *more: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.{what}", "--scheduler-file", str(self.file), "--host",
                   "127.0.0.1", *more]  # fmt: skip
        return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def close(self) -> None:
        """End all."""
        for process in self.processes[::-1]:
            process.kill()
            process.wait()


def main() -> None:
    """Run, print the table, write the JSON."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--points", type=int, default=40)
    parser.add_argument("--seed", type=int, default=77)
    parser.add_argument("--size", type=int, nargs=2, default=[640, 400])
    parser.add_argument("--folder", type=Path, help="A test that is there already.")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        test = options.folder or place / "test"
        if options.folder is None:
            test.mkdir()
            simulate_psp(test, options.seed, options.points, tuple(options.size))
        rows = measured_ways(test / "psp.toml", place)
    print(json.dumps(rows, indent=1))
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1) + "\n")


def measured_ways(project: Path, place: Path) -> list[dict]:
    """A row for each way."""
    cluster = Cluster(place)
    try:
        first, _ = cluster.worker(), cluster.worker()
        on = ("--scheduler", cluster.address)
        ways = (
            ("1 thread", ("--threads", "1"), None), ("2 threads", ("--threads", "2"), None), ("2 workers", on, None),
            ("2 workers, one killed", on, lambda run: first.kill()),
            ("1 worker, the run killed", on, lambda run: os.kill(run.pid, signal.SIGKILL)),
        )  # fmt: skip
        whole, rows = None, []
        for what, more, amid in ways:
            out = place / what.replace(" ", "-").replace(",", "")
            done = psp(project, out, *more, amid=amid)
            before = kept(out)
            if not done:
                done = psp(project, out, *more, "--resume")
            found = prints(out)
            whole = whole or found
            work = sum(sum(r.get("seconds", {}).values()) for r in done.get("results", []))
            rows.append({"way": what, "points": done.get("points"), "reduced": done.get("reduced"), "work_s": work,
                         "wall_s": done.get("wall"), "kept_when_killed": before, "files": len(found),
                         "same_bytes": found == whole, "load": os.getloadavg()[0]})  # fmt: skip
            print(rows[-1], flush=True)
        return rows
    finally:
        cluster.close()


if __name__ == "__main__":
    main()
