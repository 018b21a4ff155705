"""Damaged files: thousands of changed files per format, and what becomes of each.

Small files of every format that windmark reads are changed: bytes flipped, numbers grown, negative or NaN, the file cut
off, parts doubled or blanked, words and other encodings put in. Every changed file is read in a process whose memory is
limited, so that a crash, a hang (over 5 s) or memory that the file's bytes do not justify is counted instead of ending
the benchmark. Good answers are what the file holds, or one sentence (`FileError`).

    python benchmarks/fuzz.py --count 10000 [--only cine,vtp] [--seed 0] [--json fuzz.json]
    python benchmarks/fuzz.py --only vtp --seed 4711 --show folder    writes the changed file of that seed
"""

from __future__ import annotations

import argparse
import json
import multiprocessing as mp
import os
import re
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from _fuzz_changes import changed
from _fuzz_files import seeds

HANG_S, WAIT_S = 5.0, 120.0
"""Of the processor's time, for the machine may be busy; on the clock."""
MEMORY_BYTES = 2 * 2**30
"""What a reader may take on top of what the process needs to start: seeds are some kilobytes."""
WORDS = ("read", "refused", "stopped", "traceback", "memory", "hang", "crash")
"""``stopped`` are refusals, too: the file has ended, or held up, the process in which it was read."""
_STOPPED = ("it ends the library", "it is not read within", "MiB of memory to read it")


def reader_of(kind: str) -> Callable[[Path], Any]:
    """What reads the files of a kind, as the verbs do."""
    from windmark import io
    from windmark.pipeline.project import read_project

    readers: dict[str, Callable[[Path], Any]] = {
        "markers": lambda p: (io.read_markers(p, roles=None), io.read_marker_unit(p), io.read_points(p)),
        "detections": lambda p: (io.read_detections(p), io.read_detection_names(p)),
        "matches": io.read_matches,
        "modes": io.read_modes,
        "points": io.read_points,
        "mask": lambda p: io.read_mask(p, (20, 32)),
        "image": lambda p: (io.page_count(p), io.read_grey(p)),
        "camera": io.read_camera_file,
        "colmap": lambda p: (io.read_colmap(p.parent), io.read_camera_file(p.parent)),
        "rig": io.read_rig,
        "project": read_project,
        "function": lambda p: io.read_plot3d_function(p.with_suffix(".f")),
        "vtm": lambda p: io.read_grid_file(_with_pieces(p)),
    }  # fmt: skip
    if kind in readers:
        return readers[kind]
    grids = ("plot3d", "tecplot", "stl", "obj", "ply", "cart3d", "vtp", "vtu", "vtk", "vts", "netcdf")
    return io.read_grid_file if kind in grids else _read_frames


def _with_pieces(path: Path) -> Path:
    """The .vtm file to which a piece belongs."""
    return next(p for p in (q.with_suffix(".vtm") for q in (path, *path.parents)) if p.is_file())


def _read_frames(path: Path) -> None:
    from windmark import io

    with io.frames(path) as frames:
        for number in sorted({0, len(frames) // 2, len(frames) - 1}):
            frames[number]
        frames.time_s, frames.note, frames.name(0)


def put(files: list[Path], kind_folder: Path, folder: Path, seed: int) -> Path:
    """The changed file of a seed, its companions as they were, in ``folder``."""
    rng = np.random.default_rng(seed)
    name = files[rng.integers(len(files))]
    for file in kind_folder.rglob("*"):
        if file.is_file() and file != name:
            place = folder / file.relative_to(kind_folder)
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, place)
    place = folder / name.relative_to(kind_folder)
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_bytes(changed(name.read_bytes(), rng))
    return place


# --- reading


def child(kind: str, files: list[str], first: int, count: int, folder: str, pipe) -> None:
    """Change, read, report: a word for every file, and the most memory that any took."""
    import resource
    import warnings

    from windmark import io
    from windmark.io import apart

    warnings.simplefilter("error")
    read, paths = reader_of(kind), [Path(f) for f in files]
    root = Path(files[0]).parent
    apart._helper()
    for path in paths:  # imports and first use belong to the start
        with suppress(io.FileError):  # those that are only companions are no files of the kind
            read(path)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * os.sysconf("SC_PAGE_SIZE") + MEMORY_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # what libraries say of damage
    for k in range(first, first + count):
        place = put(paths, root, Path(folder), k)
        pipe.send((k, "start", "", 0))
        signal.setitimer(signal.ITIMER_PROF, HANG_S)  # ends this process
        try:
            read(place)
            word, text = "read", ""
        except io.FileError as error:
            memory = isinstance(error.__cause__, MemoryError)
            stopped = any(words in str(error) for words in _STOPPED)
            word = "memory" if memory else "stopped" if stopped else "refused"
            text = str(error) if memory or "\n" in str(error) or len(str(error)) > 2000 else ""
        except BaseException as error:
            word, text = "traceback", f"{type(error).__name__}: {error}"[:3000]
        signal.setitimer(signal.ITIMER_PROF, 0)
        pipe.send((k, word, text, _peak_mib() + sum(_peak_mib(h._process.pid) for h in apart._KEPT)))


def _peak_mib(process: int | str = "self") -> int:
    with suppress(OSError):
        found = re.search(r"VmHWM:\s*(\d+) kB", Path(f"/proc/{process}/status").read_text())
        return int(found[1]) // 1024 if found else 0
    return 0


def fuzz(kind: str, files: list[Path], count: int, seed: int = 0) -> tuple[Counter, list[tuple[int, str, str]], int]:
    """Counts of what became of ``count`` changed files, the bad ones, and the most memory in MiB."""
    context = mp.get_context("spawn")
    counts: Counter = Counter()
    bad: list[tuple[int, str, str]] = []
    at, end, most = seed, seed + count, 0
    while at < end:
        with tempfile.TemporaryDirectory() as folder:
            mine, theirs = context.Pipe(duplex=False)
            work = (kind, [str(f) for f in files], at, end - at, folder, theirs)
            process = context.Process(target=child, args=work)
            process.start()
            theirs.close()
            at, outcome, mib = _watched(process, mine, at, end, counts, bad)
            most = max(most, mib)
            if outcome:
                counts[outcome] += 1
                bad.append((at, outcome, f"exit code {process.exitcode}"))
                at += 1
    return counts, bad, most


def _watched(process, pipe, at: int, end: int, counts: Counter, bad: list) -> tuple[int, str, int]:
    """Follow a child until it is done, dies or hangs; the file at hand, what was wrong with it, the most memory."""
    most = 0
    while at < end:
        if not pipe.poll(WAIT_S):
            process.kill()
            process.join()
            return at, "hang", most
        try:
            k, word, text, mib = pipe.recv()
        except EOFError:
            process.join()
            return at, "hang" if process.exitcode == -signal.SIGPROF else "crash", most
        if word == "start":
            at = k
            continue
        counts[word] += 1
        most = max(most, mib)
        if text:
            bad.append((k, word, text))
        at = k + 1
    process.join()
    return at, "", most


def main(quick: bool = False, count: int = 10_000, only: str = "", seed: int = 0) -> dict:
    """Print the table; the counts of every format."""
    count = 300 if quick else count
    table = {}
    print(f"{'format':10} {'files':>7} " + " ".join(f"{w:>9}" for w in WORDS) + "      MiB      s")
    with tempfile.TemporaryDirectory() as folder:
        for kind, files in seeds(Path(folder)).items():
            if only and kind not in only.split(","):
                continue
            start = time.perf_counter()
            counts, bad, most = fuzz(kind, files, count, seed)
            table[kind] = {"files": count, **{w: counts[w] for w in WORDS}, "most_mib": most, "bad": bad[:50]}
            row = " ".join(f"{counts[w]:9d}" for w in WORDS)
            print(f"{kind:10} {count:7d} {row} {most:8d} {time.perf_counter() - start:6.0f}", flush=True)
            for item in bad[:8]:
                print("   ", *item)
    total = {w: sum(row[w] for row in table.values()) for w in ("files", *WORDS)}
    most = max((row["most_mib"] for row in table.values()), default=0)
    print(f"{'all':10} {total['files']:7d} " + " ".join(f"{total[w]:9d}" for w in WORDS) + f" {most:8d}")
    return table


def show(kind: str, seed: int, target: Path) -> Path:
    """Write the changed file of a seed, with its companions; its path."""
    with tempfile.TemporaryDirectory() as folder:
        files = seeds(Path(folder))[kind]
        return put(files, files[0].parent, target, seed)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--only", default="", help="only these formats, with commas between")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--show", type=Path, metavar="FOLDER", help="write the file of --only and --seed, read nothing")
    asked = parser.parse_args()
    if asked.show:
        print(show(asked.only, asked.seed, asked.show))
        sys.exit()
    figures = main(count=asked.count, only=asked.only, seed=asked.seed)
    if asked.json:
        asked.json.write_text(json.dumps(figures, indent=1))
    sys.exit(any(row["bad"] for row in figures.values()))
