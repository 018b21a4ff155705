"""One impossible number in a file that every reader takes: does a verb still end in a sentence?

    python benchmarks/fuzz_verbs.py [--count 300] [--seed 0] [--verbs run register] [--tests FOLDER]

`fuzz.py` asks the readers; this asks what comes behind them. One number of one sound input (markers, camera, grid,
table of points, project) is replaced: by zero, by its negative, by one in another unit, by 1e30, 1e150 or 1e300, by
something tiny. Every verb then works on it, in a copy of this process. Good ends are a result, a no with its reason
(exit code 1) and a bad file (2); a fault (3), a crash, a warning of numpy on the screen, or more than `HANG_S` is BAD.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import resource
import shutil
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np

from _faults import Run, prepared, told

HANG_S = 120
"""Of the processor's time; the slowest verb takes ten."""
MEMORY_BYTES = 4 * 2**30
"""Beyond what this process has already."""
NUMBER = re.compile(rb"(?<![\w.\"#])[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?(?![\w\"])")
CHANGES: dict[str, Callable[[float], float]] = {
    "0": lambda _: 0.0, "negative": lambda x: -x, "x 25.4": lambda x: 25.4 * x, "x 1000": lambda x: 1000 * x,
    "/ 1000": lambda x: x / 1000, "1e30": lambda _: 1e30, "1e150": lambda _: 1e150, "-1e300": lambda _: -1e300,
    "1e300": lambda _: 1e300, "1e-300": lambda _: 1e-300, "1e9": lambda _: 1e9,
}  # fmt: skip
NARROW = {">f4": np.dtype(">f4"), "<f4": np.dtype("<f4"), "<f8": np.dtype("<f8")}


def commands(tests: Path) -> dict[str, list[str]]:
    """Every verb on the synthetic tests; OUT stands where its output goes."""
    made, test, wing = prepared(tests), tests / "test", tests / "bending"
    table, camera, unit = str(test / "markers.csv"), str(test / "camera.json"), ["--unit", "mm"]
    image, grid = str(test / "wind-off.tif"), str(test / "model.grid")
    posed = str(test / "truth" / "wind-off-camera.json")
    return {
        **{verb: [*command, "-o", "OUT"] for verb, command in made.items()},
        "register": ["register", image, "-m", table, "-c", camera, "-r", "4", *unit, "-o", "OUT"],
        "resect": ["resect", image, "-c", posed, "-g", grid, *unit, "--points", str(test / "taps.csv"), "-o", "OUT"],
        "markers check": ["markers", "check", table, *unit, "-o", "OUT"],
        "pov": ["pov", posed, "-g", grid, "-m", table, *unit, "--picture", "OUT.png"],
        "undistort": ["undistort", image, "-c", camera, "-o", "OUT"],
        "convert grid": ["convert", grid, "OUT.vtp", *unit],
        "convert markers": ["convert", table, "OUT.tgts", *unit],
        "convert camera": ["convert", posed, "OUT.cameramodel"],
        "laws": ["laws", str(wing / "my_law.py"), "-m", str(wing / "markers.csv"), "--volume", "wing"],
    }  # fmt: skip


def inputs(tests: Path) -> list[Path]:
    """Files with numbers that the verbs read."""
    return [p for p in sorted(tests.rglob("*")) if p.suffix in (".csv", ".json", ".toml", ".grid", ".tgts", ".py")
            and p.name not in ("manifest.json", "clicks.csv", "rough.csv") and "out" not in p.parts]  # fmt: skip


def spoil(path: Path, chance: random.Random) -> str:
    """Replace one number of a file; what was done, "" where it has none."""
    content, how = path.read_bytes(), chance.choice(list(CHANGES))
    if b"\0" in content[:400]:  # binary: a value somewhere behind the sizes
        kind = chance.choice(list(NARROW.values()))
        at = chance.randrange(64, len(content) - 8) // 4 * 4
        with np.errstate(all="ignore"):
            value = np.array(CHANGES[how](float(np.frombuffer(content, kind, 1, at)[0]))).astype(kind).tobytes()
        path.write_bytes(content[:at] + value + content[at + len(value) :])
        return f"byte {at} {how}"
    found = list(NUMBER.finditer(content))
    if not found:
        return ""
    one = chance.choice(found)
    new = repr(CHANGES[how](float(one[0])))
    new = new.removesuffix(".0") if b"." not in one[0] else new
    path.write_bytes(content[: one.start()] + new.encode() + content[one.end() :])
    line = content[: one.start()].count(b"\n") + 1
    return f"line {line}: {one[0].decode()} {how}"


def limited() -> None:
    """A hang ends by a signal, memory by an error."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = pages * os.sysconf("SC_PAGE_SIZE") + MEMORY_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    signal.setitimer(signal.ITIMER_PROF, HANG_S)


def main(count: int, seed: int, verbs: list[str] | None, tests: Path | None) -> int:
    """The counts of every verb, and what was bad; how many were."""
    chance, sentences, bad = random.Random(seed), Counter[str](), 0
    with tempfile.TemporaryDirectory(prefix="windmark-verbs-") as name:
        place = Path(name)
        tests = tests or place / "tests"
        tests.mkdir(exist_ok=True)
        known = commands(tests)
        for verb in (wanted := verbs or list(known)):
            warm(verb, placed(known[verb], place / "warm"))
        print(f"{'verb':16} {'runs':>5} {'done':>5} {'no':>5} {'file':>5} {'BAD':>5}", flush=True)
        for verb in wanted:
            seen = Counter[str]()
            for _ in range(max(1, count // len(wanted))):
                word, text = one(known[verb], tests, place / "copy", chance)
                seen[word] += 1
                if word == "BAD":
                    print(f"  BAD {verb}: {text}", flush=True)
                elif word == "file":
                    sentences.update(told(text, place))
            bad += seen["BAD"]
            row = " ".join(f"{seen[w]:5d}" for w in ("done", "no", "file", "BAD"))
            print(f"{verb:16} {seen.total():5d} {row}", flush=True)
    for line, n in sentences.most_common():
        print(f"  {n:3d}  {line}")
    return bad


def placed(command: list[str], out: Path) -> list[str]:
    """A command with its output."""
    return [part.replace("OUT", str(out)) if part.startswith("OUT") else part for part in command]


def warm(verb: str, command: list[str]) -> None:
    """Carry a verb out in this process."""
    from typer.testing import CliRunner

    from windmark.app.cli import app

    done = CliRunner().invoke(app, command, catch_exceptions=False)
    assert done.exit_code == 0, f"{verb}: {done.output}"


def one(command: list[str], tests: Path, copy: Path, chance: random.Random) -> tuple[str, str]:
    """A verb on a copy of its test with one number spoiled: a word, and what it said."""
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(tests, copy)
    moved = [part.replace(str(tests), str(copy)) for part in command]
    named = [Path(part) for part in moved if Path(part).is_file()]
    near = [p for p in inputs(copy) if p in named or any(n.suffix == ".toml" and p.parent == n.parent for n in named)]
    what, file = "", copy
    while not what:
        file = chance.choice(near)
        what = spoil(file, chance)
    talk = copy / "talk"
    talk.mkdir()
    end = Run(placed(moved, copy / "out"), talk, limited).end()
    case = f"{file.relative_to(copy)} {what}: exit code {end.code}: {end.said[-700:]}"
    if end.code not in (0, 1, 2) or "Traceback" in end.said or "Warning: " in end.said:
        return "BAD", case
    return ("done", "no", "file")[end.code], end.said.replace(str(copy), "COPY")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--verbs", nargs="*")
    parser.add_argument("--tests", type=Path, help="folder of the synthetic tests, made there if they are missing")
    asked = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    sys.exit(bool(main(asked.count, asked.seed, asked.verbs, asked.tests)))
