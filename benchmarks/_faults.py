"""Runs of windmark that something outside of them ends, and what they leave: for kills, disks and series_faults.

A run is a forked copy of this process, in which every verb has been carried out once: it starts in milliseconds, with
everything imported and compiled, and goes through the command line's own entry.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

WINDMARK = [sys.executable, "-m", "windmark.app.cli"]


def prepared(folder: Path) -> dict[str, list[str]]:
    """Small synthetic tests as files, and the command of every verb without its output."""
    from windmark.pipeline.simulate_deforming import simulate_deforming

    for name, kind in (("test", []), ("photos", ["--photos", "12"])):
        if not (folder / name).exists():
            subprocess.run([*WINDMARK, "simulate", str(folder / name), *kind], check=True, capture_output=True)
    if not (folder / "bending").exists():
        (folder / "bending").mkdir()
        simulate_deforming(folder / "bending", 3, 8, (640, 400))
    test, photos, wing = folder / "test", folder / "photos", folder / "bending"
    frames = folder / "frames"
    frames.mkdir(exist_ok=True)
    for k in range(10):
        (frames / f"f{k}.tif").write_bytes((test / "wind-off.tif").read_bytes())
    unit = ["--unit", "mm"]
    taken = sorted(map(str, (photos / "photos").glob("*.tif")))
    return {
        "run": ["run", str(test / "project.toml")],
        "track": ["track", str(frames), "-m", str(test / "markers.csv"), "-c", str(test / "camera.json"), "-r", "4",
                  *unit],
        "deform": ["deform", str(wing / "deform.toml")],
        "reconstruct": ["reconstruct", *taken, "-c", str(photos / "camera.json"), "-p", str(photos / "primary.csv"),
                        *unit, "--radius", "2.7"],
        "calibrate": ["calibrate", *taken, "-m", str(photos / "truth" / "markers.csv"),
                      "-c", str(photos / "camera.json"), *unit, "--radius", "2.7", "--datum", "free"],
    }  # fmt: skip


def watched(commands: dict[str, list[str]]) -> list[str]:
    """`deform` of the same test, its pictures taken from a watched folder."""
    project = Path(commands["deform"][1])
    return [*commands["deform"], "--watch", str(project.parent / "images"), "--idle", "0.5"]


def state(folder: Path) -> str:
    """The result in one word: none, the hash of its manifest where all is as that says, or what is wrong."""
    if not folder.exists() or not any(folder.iterdir()):
        return "none"
    manifest = folder / "manifest.json"
    if not manifest.is_file():
        return "MIXED: no manifest"
    named = json.loads(manifest.read_text())["outputs"]
    there = {p.relative_to(folder).as_posix(): p for p in folder.rglob("*") if p.is_file() and p != manifest}
    there = {name: path for name, path in there.items() if not name.startswith("kept-")}
    if there.keys() != named.keys():
        return f"MIXED: {sorted(there.keys() ^ named.keys())[:3]}"
    wrong = [name for name, path in there.items() if hashlib.sha256(path.read_bytes()).hexdigest() != named[name]]
    return f"MIXED: {wrong[:3]}" if wrong else hashlib.sha256(manifest.read_bytes()).hexdigest()


def hidden(folder: Path) -> list[str]:
    """What is left of runs in a folder and in the folders of results there."""
    return [p.relative_to(folder).as_posix() for p in [*folder.glob(".windmark*"), *folder.glob("*/.windmark*")]]


def told(said: str, place: Path) -> list[str]:
    """Sentences without what changes from run to run."""
    lines = [re.sub(r"process \d+ on \S+?(?=[);])", "process N on HOST", line) for line in said.splitlines()]
    return [
        re.sub(r"[^ ]*\.windmark-[^ /]*", "HIDDEN", line.replace(str(place), "PLACE"))[:240] for line in lines if line
    ]


@dataclass(frozen=True)
class Ended:
    """How a run ended: its exit code (negative: the signal), what it printed, how long it took."""

    code: int
    out: str
    said: str
    seconds: float


class Run:
    """A forked run of the command line.

    Parameters
    ----------
    arguments : behind ``windmark``
    place : a folder for what it prints
    before : called in the run before it begins
    stdout : a file to print into; None for one of ``place``
    """

    def __init__(
        self, arguments: list[str], place: Path, before: Callable[[], object] | None = None, stdout: str | None = None
    ) -> None:
        self._out, self._said = place / f"out-{time.monotonic_ns()}", place / f"said-{time.monotonic_ns()}"
        self._begun = time.monotonic()
        sys.stdout.flush()
        self.pid = os.fork()
        if self.pid == 0:
            self._carry_out(arguments, before, stdout)

    def _carry_out(self, arguments: list[str], before: Callable[[], object] | None, stdout: str | None) -> None:
        code = 99
        try:
            writes = os.O_WRONLY | os.O_CREAT
            os.dup2(os.open(stdout or self._out, writes, 0o644), 1)
            os.dup2(os.open(self._said, writes, 0o644), 2)
            for number in (signal.SIGINT, signal.SIGHUP):  # this process may ignore them: it may have no terminal
                signal.signal(number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL)
            if before is not None:
                before()
            from windmark.app.cli import main

            # As a process of its own has them: this one's know where they stood in another file.
            sys.stdout, sys.stderr = _stream(1), _stream(2)  # type: ignore[assignment]
            sys.argv = ["windmark", *arguments]
            try:
                main()
            except SystemExit as end:
                code = int(end.code or 0)
            sys.stdout.flush()
            sys.stderr.flush()
        except BaseException:
            import traceback

            traceback.print_exc()
            sys.stderr.flush()
        finally:
            os._exit(code)

    def is_going(self) -> bool:
        """Whether it has not ended yet."""
        return os.waitid(os.P_PID, self.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None

    def sleep(self, seconds: float) -> bool:
        """Wait so long, or to its end; whether it goes on."""
        until = time.monotonic() + seconds
        while (going := self.is_going()) and time.monotonic() < until:
            time.sleep(0.002)
        return going

    def end(self) -> Ended:
        """Wait for its end."""
        code = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])
        seconds, texts = time.monotonic() - self._begun, []
        for path in (self._out, self._said):
            texts.append(path.read_text(errors="replace") if path.exists() else "")
            path.unlink(missing_ok=True)
        return Ended(code, *texts, seconds)


def _stream(number: int) -> TextIO | None:
    """A standard stream as Python makes it at its start: None for a closed one."""
    try:
        return open(number, "w", 1, closefd=False)
    except OSError:
        return None


def warm(command: list[str], out: Path) -> None:
    """Carry a verb out in this process."""
    from typer.testing import CliRunner

    from windmark.app.cli import app

    done = CliRunner().invoke(app, [*command, "-o", str(out)], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    shutil.rmtree(out)
