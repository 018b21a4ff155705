"""Run every command of docs/paper-map.md from start to end.

``python docs/run_paper_map.py [FOLDER] [--only 1,2,40-45]``

The commands run in the order of the table, in one folder (a temporary one if none is given), on data that windmark
makes itself. A line for each says how long it took and what it printed last; the exit code is 1 if any of them did not
end as the table says: with 0, or with what stands behind it in brackets, as in (exit 1).
"""

from __future__ import annotations

import argparse
import glob
import os
import re
import shlex
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

MAP = Path(__file__).parent / "paper-map.md"
_ROW = re.compile(r"^\| (?P<number>\d+) \| (?P<rest>.*) \|$")
_COMMAND = re.compile(r"`(windmark [^`]*)`(?: \(exit (\d)\))?")
LIMIT_S = 600


@dataclass(frozen=True)
class Command:
    """One command line of the table and the exit code it must have."""

    words: tuple[str, ...]
    code: int

    @property
    def text(self) -> str:
        """As it stands in the table."""
        return shlex.join(self.words).replace("'", "")


@dataclass(frozen=True)
class Row:
    """One capability: number, place in the paper, what it is, its commands; names of Python, tests and figures."""

    number: int
    section: str
    what: str
    commands: tuple[Command, ...]
    python: tuple[str, ...]
    tests: tuple[str, ...]
    figures: tuple[str, ...]


def rows() -> list[Row]:
    """The rows of the table, in order."""
    out = []
    for line in MAP.read_text(encoding="utf-8").splitlines():
        found = _ROW.match(line)
        if found is None:
            continue
        cells = [cell.strip() for cell in found["rest"].split(" | ")]
        if len(cells) != 6:
            raise ValueError(f"{MAP.name}: row {found['number']} has {len(cells)} cells behind its number, expected 6")
        section, what, commands, python, tests, figure = cells
        out.append(Row(
            int(found["number"]), section, what, _commands(commands), tuple(re.findall(r"`([^`]+)`", python)),
            tuple(re.findall(r"`([^`]+)`", tests)), tuple(re.findall(r"\((pictures/[^)]+)\)", figure)),
        ))  # fmt: skip
    return out


def data_commands() -> list[Command]:
    """The commands of the section that makes the data."""
    text = MAP.read_text(encoding="utf-8")
    part = text.split("## The data", 1)[1].split("\n## ", 1)[0]
    return [Command(tuple(shlex.split(line)), 0) for line in part.splitlines() if line.startswith("windmark ")]


def _commands(cell: str) -> tuple[Command, ...]:
    return tuple(Command(tuple(shlex.split(text)), int(code or 0)) for text, code in _COMMAND.findall(cell))


def run(command: Command, folder: Path) -> tuple[bool, float, str]:
    """Whether it ended as it must, the seconds it took, and the last line it printed."""
    words = [w for word in command.words[1:] for w in _expanded(word, folder)]
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "windmark.app.cli", *words], cwd=folder, capture_output=True, text=True,
        encoding="utf-8", timeout=LIMIT_S, env={**os.environ, "PYTHONIOENCODING": "utf-8"}, check=False,
    )  # fmt: skip
    lines = [line for line in (done.stdout + done.stderr).splitlines() if line.strip()]
    said = lines[-1] if lines else ""
    return done.returncode == command.code, time.perf_counter() - start, f"[exit {done.returncode}] {said}"


def _expanded(word: str, folder: Path) -> list[str]:
    """What a shell makes of a pattern; on Windows nobody else does it."""
    if not any(ch in word for ch in "*?") or "=" in word:
        return [word]
    found = sorted(glob.glob(word, root_dir=folder))
    return [Path(name).as_posix() for name in found] or [word]


def chosen(text: str | None) -> set[int] | None:
    """Numbers from ``1,2,40-45``."""
    if text is None:
        return None
    out: set[int] = set()
    for part in text.split(","):
        low, _, high = part.partition("-")
        out |= set(range(int(low), int(high or low) + 1))
    return out


def main() -> int:
    """Run, say, count."""
    sys.stdout.reconfigure(encoding="utf-8", errors="replace")  # type: ignore[union-attr]
    parser = argparse.ArgumentParser(description="Run every command of docs/paper-map.md.")
    parser.add_argument("folder", nargs="?", type=Path)
    parser.add_argument("--only", help="numbers of rows: 1,2,40-45")
    options = parser.parse_args()
    only = chosen(options.only)
    with tempfile.TemporaryDirectory() as temporary:
        folder = (options.folder or Path(temporary)).resolve()
        (folder / "out").mkdir(parents=True, exist_ok=True)
        jobs = [(0, c) for c in data_commands()]
        jobs += [(row.number, c) for row in rows() for c in row.commands if only is None or row.number in only]
        done: set[str] = set()
        failed = 0
        for number, command in jobs:
            if command.text in done:  # some rows point to the same command
                continue
            done.add(command.text)
            good, seconds, said = run(command, folder)
            failed += not good
            print(f"{number:3d} {'ok  ' if good else 'FAIL'} {seconds:6.1f} s  {command.text}\n         {said[:200]}",
                  flush=True)  # fmt: skip
    print(f"{len(done) - failed} of {len(done)} commands ended as they must; {len(rows())} rows")
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
