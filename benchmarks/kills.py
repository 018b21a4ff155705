"""Runs that are killed, crowded or short of disk: is a result the old one or the new one as a whole, always?

    python benchmarks/kills.py                       # ten kills for each verb, four runs at once, lost outputs
    python benchmarks/kills.py --kills 30 --verbs run track

Every verb works on a small synthetic test. A run is ended by SIGINT, SIGTERM, SIGHUP or SIGKILL at a random moment;
then the folder of its results must hold exactly the files that its manifest names, with their hashes, of the run before
or of this one; the next run must leave nothing hidden; a series that is gone on with must come to the result of an
undisturbed one, every file but for wall times (`_same.py`); a live run that a signal ends, as it is meant to be, to the
first frames of that. Prints counts, and every sentence that a user reads, once. For full disks, mount points and other
places see `disks.py`.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from _faults import Ended, Run, hidden, prepared, state, told, warm, watched
from _same import differences, ended_rightly, table

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL, signal.SIGHUP)
SERIES = {"deform": "deformation.csv", "track": "poses.csv", "deform --watch": "deformation.csv"}
"""What can go on where it was stopped; the table that has a row for every frame."""


def resumed(
    name: str, command: list[str], place: Path, count: int, chance: random.Random, sentences: Counter[str]
) -> str:
    """Killed, perhaps killed again while it goes on, and gone on with to its end: the result of an undisturbed run."""
    kind = name.split()[-1].strip("-")
    out, whole, talk, seen = place / f"{kind}-resumed", place / f"{kind}-whole", place / "talk", Counter[str]()
    talk.mkdir(exist_ok=True)
    first = Run([*command, "-o", str(whole)], talk).end()
    assert first.code == 0, first.said
    frames = len(table(whole / SERIES[name]))
    command = [*command, "-o", str(out)]
    for k in range(count):
        shutil.rmtree(out, ignore_errors=True)
        more: list[str] = []
        for again in range(1 + k % 2):
            number = SIGNALS[(k + again) % len(SIGNALS)]
            run = Run([*command, *more], talk)
            # Half of them anywhere, half of them amid the frames, which a busy machine makes a small part of a run.
            amid = k % 4 < 2
            if _waited(run, out, chance.randrange(frames)) if amid else run.sleep(chance.random() * first.seconds):
                time.sleep(chance.uniform(0, 0.02) if amid else 0)
                os.kill(run.pid, number)
            ended = run.end()
            sentences.update(line for line in told(ended.said, place) if "report:" not in line)
            if "Traceback" in ended.said:
                seen[f"BAD {ended.said[ended.said.index('Traceback') :]}"] += 1
            if not ended.code:
                break
            kept = _kept(out)
            seen[f"{number.name}: {'frames kept' if kept else 'none'}"] += 1
            more = ["--resume"] if kept else []
        if ended.code:
            ended = Run([*command, *more], talk).end()
            sentences.update(told(ended.said, place))
            seen[f"{'gone on with' if more else 'begun anew'}: exit code {ended.code}"] += 1
        told_wrong = _judged(ended, out, whole)
        seen[told_wrong if told_wrong[0] != "[" else f"BAD: {told_wrong} after {number.name}"] += 1
        seen["BAD: hidden after the next run"] += len(hidden(place))
    found = ", ".join(f"{what} {n}" for what, n in sorted(seen.items()) if n)
    return f"{name}, resumed ({first.seconds:.1f} s): {found}"


def _kept(out: Path) -> int:
    """Frames that a run has measured so far, wherever it keeps them."""
    from windmark.pipeline.resume import measured

    return max(measured(folder) for folder in (out, out.with_name(f".windmark-{out.name}") / "new"))


def _waited(run: Run, out: Path, frames: int) -> bool:
    """Wait until so many frames are measured; whether it goes on."""
    while (going := run.is_going()) and _kept(out) < frames:
        time.sleep(0.002)
    return going


def _judged(ended: Ended, out: Path, whole: Path) -> str:
    """What a run that has come to its end has made, beside an undisturbed one; a list of what is wrong."""
    if ended.code or not state(out).isalnum():
        return str([ended.code, state(out), ended.said[-200:]])
    if ", interrupted" not in ended.out:
        wrong = differences(out, whole)
        return str(wrong) if wrong else "the same result"
    wrong = ended_rightly(out, whole)
    return str(wrong) if wrong else "live, ended by a signal as it is meant to be: first frames the same, the rest left"


def kills(
    name: str, command: list[str], place: Path, count: int, chance: random.Random, sentences: Counter[str]
) -> str:
    """Old or new as a whole, whatever ends the run."""
    out, talk = place / f"{name}-out", place / "talk"
    talk.mkdir(exist_ok=True)
    command = [*command, "-o", str(out)]
    first = Run(command, talk).end()
    assert first.code == 0, first.said
    whole_s, seen = first.seconds, Counter[str]()
    for k in range(count):
        number, before = SIGNALS[k % len(SIGNALS)], state(out)
        # Half of them near the end, where files are written and exchanged.
        part = chance.uniform(0.05, 1.0) if k % 2 else chance.uniform(0.8, 1.1)
        run = Run(command, talk)
        if run.sleep(part * whole_s):
            os.kill(run.pid, number)
        ended = run.end()
        sentences.update(line for line in told(ended.said, place) if "report:" not in line)
        after = state(out)
        bad = after.startswith("MIXED") or after == "none" or "Traceback" in ended.said
        left = bool(hidden(place))
        seen[f"{number.name}: {'BAD ' + after if bad else 'old' if after == before else 'new'}"] += 1
        seen["hidden folder after the kill"] += left
        resumable = name in SERIES  # keeps its frames for --resume, and says so
        seen["BAD: hidden after a signal that can be caught"] += left and number != signal.SIGKILL and not resumable
        if bad:
            seen[f"BAD {ended.said[-300:]}"] += 1
        if ended.code == 0:
            whole_s = min(whole_s, ended.seconds)
            seen["ended before the signal"] += 1
    done = Run(command, talk).end()
    sentences.update(told(done.said, place))
    final = state(out)
    seen["BAD at the end"] += done.code != 0 or bool(hidden(place)) or final.startswith("MIXED")
    seen["BAD: kept"] += len(list(place.glob("*.kept*")))
    return f"{name} ({whole_s:.1f} s): " + ", ".join(f"{what} {n}" for what, n in sorted(seen.items()) if n)


ENDLESS = """
import sys
from windmark.io import result_folder
for k in range(10**9):
    with result_folder(sys.argv[1]) as out:
        for i in range(30):
            (out.place / f"{i}.txt").write_text(str(k))
    if k == 0:
        print("ready", flush=True)
"""


def exchanges(place: Path, count: int, foreign: bool, chance: random.Random) -> str:
    """A process that does nothing but replace a result of 30 files by the next one, killed again and again."""
    from windmark.io import result_folder

    out, seen = place / f"exchange-{foreign}", Counter[str]()
    out.mkdir()
    for _ in range(count):
        if foreign:  # files are moved one by one then
            (out / "notes.txt").write_text("mine")
        process = subprocess.Popen([sys.executable, "-c", ENDLESS, str(out)], stdout=subprocess.PIPE,
                                   stderr=subprocess.PIPE)  # fmt: skip
        assert process.stdout is not None
        process.stdout.readline()
        time.sleep(chance.uniform(0.0, 0.1))
        process.kill()
        process.communicate()
        seen[
            "whole at once" if _of_one_run(out) else "in between, no manifest" if not _manifest(out) else "BAD: mixed"
        ] += 1
        try:
            with result_folder(out, say=lambda text: seen.update([re.sub("/.*/", "", text)])):
                raise RuntimeError  # what a kill left is put right before the work
        except RuntimeError:
            seen["whole after the next run" if _of_one_run(out) else "BAD after the next run"] += 1
        seen["BAD: hidden"] += len(hidden(place)) + len(hidden(out))
        seen["BAD: notes lost"] += foreign and not (out / "notes.txt").exists()
    kind = "with a user's file in it" if foreign else "of ours alone"
    return f"{count} kills while a folder {kind} is replaced: " + ", ".join(f"{w} {n}" for w, n in seen.items() if n)


def _manifest(out: Path) -> bool:
    return (out / "manifest.json").is_file()


def _of_one_run(out: Path) -> bool:
    files = [out / f"{i}.txt" for i in range(30)]
    return _manifest(out) and all(f.exists() for f in files) and len({f.read_text() for f in files}) == 1


def crowd(command: list[str], place: Path, rounds: int, sentences: Counter[str]) -> str:
    """Four runs into one folder at once, again and again: one does it, the others are refused at once."""
    out, talk, seen = place / "crowd", place / "talk", Counter[str]()
    talk.mkdir(exist_ok=True)
    for _ in range(rounds):
        before = state(out)
        begun, took = time.monotonic(), dict[int, float]()
        runs = [Run([*command, "-o", str(out)], talk) for _ in range(4)]
        while len(took) < len(runs):
            took.update({r.pid: time.monotonic() - begun for r in runs if r.pid not in took and not r.is_going()})
            time.sleep(0.01)
        ends = [run.end() for run in runs]
        refused = [e for e in ends if e.code == 2 and "another run writes into this folder (process " in e.said]
        won = [e for e in ends if e.code == 0]
        for end in ends:
            sentences.update(told(end.said, place))
        after = state(out)
        seen["one wins, three are refused"] += len(won) == 1 and len(refused) == 3
        seen["more than one, one after the other"] += len(won) > 1 and len(won) + len(refused) == 4
        seen[f"BAD: {sorted(e.code for e in ends)}"] += not won or len(won) + len(refused) != 4
        seen["BAD: mixed"] += after == before or after == "none" or after.startswith("MIXED")
        seen["BAD: hidden"] += bool(hidden(place))
        late = max((took[r.pid] for r, e in zip(runs, ends, strict=True) if e.code), default=0.0)
        seen["all refused before half of the longest run's time"] += late < 0.5 * max(took.values())
    found = ", ".join(f"{what} {n}" for what, n in sorted(seen.items()) if n)
    return f"4 runs into one folder, {rounds} times: {found}"


def lost_outputs(commands: dict[str, list[str]], place: Path, sentences: Counter[str]) -> str:
    """A standard output that is closed, full, or that its reader has left: the result comes, and the code is right."""
    talk, seen = place / "talk", Counter[str]()
    talk.mkdir(exist_ok=True)
    for name, command in commands.items():
        out = place / f"lost-{name.split()[-1]}"
        for what, codes in (("full", (2,)), ("left", (0,)), ("closed", (0,))):
            if what == "full":
                end = Run([*command, "-o", str(out)], talk, stdout="/dev/full").end()
            else:
                pipe = os.pipe()
                os.close(pipe[0])

                def broken(writes: int = pipe[1], what: str = what) -> None:
                    os.dup2(writes, 1)
                    if what == "closed":
                        os.close(1)

                end = Run([*command, "-o", str(out)], talk, broken).end()
                os.close(pipe[1])
            sentences.update(told(end.said, place))
            whole = not state(out).startswith(("none", "MIXED"))
            calm = "Traceback" not in end.said and not hidden(place)
            good = end.code in codes and whole and calm
            seen[f"{what}: {'as it should' if good else f'BAD {name} {end.code} {state(out)} {end.said[-200:]}'}"] += 1
    return "standard output: " + ", ".join(f"{what} {n}" for what, n in sorted(seen.items()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--exchanges", type=int, default=50)
    parser.add_argument("--crowds", type=int, default=20)
    parser.add_argument("--verbs", nargs="*")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--tests", type=Path, help="folder of the synthetic tests, made there if they are missing")
    asked = parser.parse_args()
    chance, sentences = random.Random(asked.seed), Counter[str]()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with tempfile.TemporaryDirectory(prefix="windmark-kills-") as name:
        place = Path(name)
        for foreign in (False, True):
            print(exchanges(place, asked.exchanges, foreign, chance), flush=True)
        commands = prepared(asked.tests or place)
        commands["deform --watch"] = watched(commands)
        verbs = asked.verbs if asked.verbs is not None else list(commands)
        for verb in {*verbs, "track"}:
            warm(commands[verb], place / "warm")
        for verb in verbs:
            if verb in SERIES:
                print(resumed(verb, commands[verb], place, asked.kills, chance, sentences), flush=True)
            if verb != "deform --watch":  # its tables are in the folder itself: see series_faults.py
                print(kills(verb, commands[verb], place, asked.kills, chance, sentences), flush=True)
        print(crowd(commands["track"], place, asked.crowds, sentences), flush=True)
        print(lost_outputs({verb: commands[verb] for verb in verbs or ["track"]}, place, sentences), flush=True)
    print("sentences:")
    for line, count in sentences.most_common():
        print(f"  {count:3d}  {line}")


if __name__ == "__main__":
    main()
