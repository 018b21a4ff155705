"""Long and live series under attack: killed at random moments, fed with every fault that a camera's computer has.

Kills: `deform` and `deform --watch` are killed (SIGKILL, SIGTERM in turn) at random moments, what is there is opened,
and `--resume` goes on, again and again, until the run ends; its files are compared with those of an undisturbed one.
Live: 1,000 frames by a writer with pauses, files made in their full size (some stay half black), disorder, duplicates,
names that are changed in place, dates that are off by hours, files that are never finished, and a second camera that
falls behind and catches up; every frame must have one row, every file one, and no number may differ from that of the
disk.

    python benchmarks/series_faults.py [--kills 30] [--frames 1000] [--only kills fed "live kills"]
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

import numpy as np

from _same import differences, table

MADE = 12
"""Frames that are rendered; longer sequences go through them to and fro."""


ATTACKS = ("kills", "fed", "live kills")
BEHIND = 12
"""Frames by which the second camera falls behind at most."""


def main(
    quick: bool = False, kills: int | None = None, frames: int | None = None, only: Collection[str] = ATTACKS
) -> dict[str, Any]:
    """The attacks; figures."""
    from windmark.pipeline.simulate_deforming import simulate_deforming

    kills, frames = kills or (4 if quick else 30), frames or (100 if quick else 1000)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "made").mkdir()
        simulate_deforming(folder / "made", 3, MADE, (640, 400))
        figures: dict[str, Any] = {}
        for key, attack in (("kills", lambda: killed(folder, kills, False)), ("fed", lambda: fed(folder, frames)),
                            ("live kills", lambda: killed(folder, kills, True))):  # fmt: skip
            if key in only:
                figures[key] = attack()
                print(f"{key}: {figures[key]}", flush=True)
    return figures


# --- parts -------------------------------------------------------------------------------------
def project(folder: Path, name: str, frames: int) -> Path:
    """A project of so many frames, pictures of the rendered ones to and fro, without the grid and its values."""
    place = folder / name
    shutil.copytree(folder / "made", place, ignore=shutil.ignore_patterns("images", "truth", "deformation*"))
    (place / "images").mkdir()
    for k in range(frames):
        for camera in ("cam1", "cam2"):
            source = folder / "made" / "images" / f"{camera}-{shown(k):04d}.tif"
            os.link(source, place / "images" / f"{camera}-{k:04d}.tif")
    text = (place / "deform.toml").read_text()
    values, points = '[values]\ncameras = ["cam1"]\nblack = 64\n', '[[points]]\nfile = "taps.csv"\n'
    for part in ('grid = ["vtk"]\n', "every = 1\n", values, points, 'frames = "frames.csv"\n'):
        assert part in text, part
        text = text.replace(part, "")
    (place / "deform.toml").write_text(text)
    return place / "deform.toml"


def shown(k: int) -> int:
    """Which of the rendered frames frame k shows."""
    turn = k % (2 * MADE - 2)
    return turn if turn < MADE else 2 * MADE - 2 - turn


def verb(*arguments: object) -> int:
    """Run the command line in this process."""
    from typer.testing import CliRunner

    from windmark.app.cli import app

    done = CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)
    if done.exit_code not in (0, 1):
        print(done.output[-500:], flush=True)
    return done.exit_code


def child(call: Callable[[], object]) -> int:
    """Run it in a process of its own; everything is imported and compiled there already."""
    pid = os.fork()
    if pid == 0:
        code = 99
        try:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            code = int(call() or 0)  # type: ignore[call-overload]
        finally:
            os._exit(code)
    return pid


def killed(folder: Path, kills: int, live: bool) -> dict[str, int]:
    """Kill a run, look at what it left, resume it; until so many kills are done."""
    import xarray

    from windmark.pipeline.resume import JOURNAL, measured

    rng = np.random.default_rng(5)
    path = project(folder, f"kill-{live}", 60)
    watched = ("--watch", path.parent / "images", "--idle", 0.5) if live else ()
    assert verb("deform", path, "-o", folder / f"whole-{live}", *watched) == 0
    start = time.monotonic()
    assert verb("deform", path, "-o", folder / f"whole-{live}", *watched) == 0
    usual_s, counts, n = time.monotonic() - start, Counter[str](), 0
    while counts["kills"] < kills:
        n += 1
        out = folder / f"out-{live}-{n}"
        work = out if live else out.with_name(f".windmark-{out.name}") / "new"
        going = False
        while True:
            more = ("--resume",) if going else ()
            pid = child(lambda out=out, more=more: verb("deform", path, "-o", out, *watched, *more))
            time.sleep(rng.uniform(0, 0.7 * usual_s))
            os.kill(pid, signal.SIGTERM if counts["kills"] % 2 else signal.SIGKILL)
            _, status = os.waitpid(pid, 0)
            if os.WIFEXITED(status):  # it was faster
                counts["failed"] += os.WEXITSTATUS(status) != 0
                break
            counts["kills"] += 1
            count = measured(work)
            if (work / "deformation.csv").exists() and count:
                counts["readable"] += len(table(work / "deformation.csv")) >= count
                with xarray.open_dataset(work / "deformation.nc") as series:
                    counts["series"] += 0 <= series.sizes["frame"] <= count
                counts["with frames"] += 1
            going = (work / JOURNAL).exists()
            if counts["kills"] >= kills:
                more = ("--resume",) if going else ()
                counts["failed"] += verb("deform", path, "-o", out, *watched, *more) != 0
                break
        counts["runs"] += 1
        counts["same"] += not differences(folder / f"whole-{live}", out)
    counts["left"] = sum(p.name.startswith(".") for p in folder.iterdir())
    return dict(counts)


def fed(folder: Path, frames: int) -> dict[str, Any]:
    """A live run whose writer does everything wrong."""
    path = project(folder, "live", frames)
    incoming = folder / "incoming"
    incoming.mkdir()
    assert verb("deform", path, "-o", folder / "disk") == 0
    writer = child(lambda: write(path.parent / "images", incoming, frames))
    code = verb("deform", path, "-o", folder / "live-out", "--watch", incoming, "--idle", 4)
    os.waitpid(writer, 0)
    rows, files = table(folder / "live-out" / "deformation.csv"), table(folder / "live-out" / "arrivals.csv")
    names = [p.name for p in incoming.iterdir()]
    disk = {r["frame"]: r for r in table(folder / "disk" / "deformation.csv")}
    good = [r for r in rows if r["status"] in ("cold", "tracked")]
    both = [r for r in good if not r["reason"]]
    off = [abs(float(r["wing.twist_2"]) - float(disk[r["frame"]]["wing.twist_2"])) / float(r["sigma_wing.twist_2"])
           for r in both]  # fmt: skip
    fewer = sum(int(r["spots"]) < 0.9 * int(disk[r["frame"]]["spots"]) for r in both)
    return {
        "exit code": code, "frames written": frames, "rows": len(rows), "frames with one row":
        sum(count == 1 for count in Counter(r["frame"] for r in rows).values()),
        "status": dict(Counter(r["status"] for r in rows)), "files": len(names), "files with one row":
        sum(Counter(r["file"] for r in files)[n] == 1 for n in names), "fates": dict(Counter(r["fate"] for r in files)),
        "largest difference of the twist from the disk, sigma": max(off), "good frames with fewer spots, unsaid": fewer,
    }  # fmt: skip


def write(images: Path, incoming: Path, frames: int) -> None:
    """Deliver the pictures with faults, about 25 frames a second."""
    rng = np.random.default_rng(9)
    late: list[tuple[int, Path, Path]] = []
    kinds = {"moved": 0.67, "pause": 0.1, "made full": 0.05, "half black": 0.003, "cut": 0.007, "late": 0.04,
             "twice": 0.03, "dated": 0.05, "renamed": 0.05}  # fmt: skip
    begun = 0
    for k in range(frames + BEHIND):
        behind = round(BEHIND * min(1.0, 4 * abs((k / frames) % 0.5 - 0.25)))  # of the second camera: to and fro
        turns = [("cam1", k)] if k < frames else []
        turns += [("cam2", j) for j in range(begun, min(max(begun, k + 1 - behind), frames))]
        begun = max([begun, *(j + 1 for camera, j in turns if camera == "cam2")])
        for camera, j in turns:
            source, target = images / f"{camera}-{j:04d}.tif", incoming / f"{camera}-{j:04d}.tif"
            how = rng.choice(list(kinds), p=list(kinds.values()))
            if how == "late":
                late.append((k + int(rng.integers(1, 12)), source, target))
            else:
                deliver(source.read_bytes(), target, how, rng)
        for item in [i for i in late if i[0] <= k]:
            late.remove(item)
            deliver(item[1].read_bytes(), item[2], "moved", rng)
        time.sleep(0.04)
    for j in range(begun, frames):
        deliver((images / f"cam2-{j:04d}.tif").read_bytes(), incoming / f"cam2-{j:04d}.tif", "moved", rng)
    for _, source, target in late:
        deliver(source.read_bytes(), target, "moved", rng)


def deliver(data: bytes, target: Path, how: str, rng: np.random.Generator) -> None:
    """One file, in one of several ways."""
    part = int(len(data) * rng.uniform(0.05, 0.95))
    if how in ("pause", "cut", "made full", "half black"):
        with open(target, "wb", buffering=0) as stream:
            stream.write(data[:part])
            if how in ("made full", "half black"):
                stream.write(bytes(len(data) - part))
                stream.seek(part)
            if how not in ("cut", "half black"):
                time.sleep(rng.choice([0.03, 0.06, 0.12]))
                stream.write(data[part:])
        return
    temporary = target.with_name(f"{target.name}.part" if how == "renamed" else f".{target.name}")
    temporary.write_bytes(data)
    if how == "renamed":
        time.sleep(rng.choice([0.0, 0.02]))
    if how == "dated":
        os.utime(temporary, (time.time() + 3600 * rng.choice([-5, 5]),) * 2)
    temporary.rename(target)
    if how == "twice":
        shutil.copy(target, target.with_name(target.name.replace("-", "-00")))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--kills", type=int, default=30)
    parser.add_argument("--frames", type=int, default=1000)
    parser.add_argument("--only", nargs="*", choices=ATTACKS, default=ATTACKS)
    options = parser.parse_args()
    sys.exit(main(False, options.kills, options.frames, options.only) is None)
