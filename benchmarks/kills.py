"""Runs that are killed, crowded or short of disk: is a result the old one or the new one as a whole, always?

    python benchmarks/kills.py                       # ten kills for each verb, four runs at once, full disks
    python benchmarks/kills.py --kills 30 --verbs run track

Every verb works on a small synthetic test. A run is ended by SIGINT, SIGTERM or SIGKILL at a random moment; then the
folder of its results must hold exactly the files that its manifest names, with their hashes, of the run before or of
this one; the next run must leave nothing hidden. Prints counts, and every sentence that a user reads, once.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)
WINDMARK = [sys.executable, "-m", "windmark.app.cli"]


def prepared(folder: Path) -> dict[str, list[str]]:
    """Tests as files, and the command of every verb without its output."""
    for name, kind in (("test", []), ("wing", ["--deforming", "12"]), ("photos", ["--photos", "12"])):
        if not (folder / name).exists():
            subprocess.run([*WINDMARK, "simulate", str(folder / name), *kind], check=True, capture_output=True)
    test, photos = folder / "test", folder / "photos"
    frames = folder / "frames"
    frames.mkdir(exist_ok=True)
    for k in range(4):
        shutil.copy(test / "wind-off.tif", frames / f"f{k}.tif")
    unit = ["--unit", "mm"]
    taken = sorted(map(str, (photos / "photos").glob("*.tif")))
    return {
        "run": ["run", str(test / "project.toml")],
        "track": ["track", str(frames), "-m", str(test / "markers.csv"), "-c", str(test / "camera.json"), "-r", "4",
                  *unit],
        "deform": ["deform", str(folder / "wing" / "deform.toml")],
        "reconstruct": ["reconstruct", *taken, "-c", str(photos / "camera.json"), "-p", str(photos / "primary.csv"),
                        *unit, "--radius", "2.7"],
        "calibrate": ["calibrate", *taken, "-m", str(photos / "truth" / "markers.csv"),
                      "-c", str(photos / "camera.json"), *unit, "--radius", "2.7", "--datum", "free"],
    }  # fmt: skip


def state(folder: Path) -> str:
    """The result in one word: none, the hash of its manifest where all is as that says, or what is wrong."""
    if not folder.exists():
        return "none"
    manifest = folder / "manifest.json"
    if not manifest.is_file():
        return "MIXED: no manifest"
    named = json.loads(manifest.read_text())["outputs"]
    there = {p.relative_to(folder).as_posix(): p for p in folder.rglob("*") if p.is_file() and p != manifest}
    if there.keys() != named.keys():
        return f"MIXED: {sorted(there.keys() ^ named.keys())[:3]}"
    wrong = [name for name, path in there.items() if hashlib.sha256(path.read_bytes()).hexdigest() != named[name]]
    return f"MIXED: {wrong[:3]}" if wrong else hashlib.sha256(manifest.read_bytes()).hexdigest()


def hidden(folder: Path) -> list[str]:
    return [p.name for p in folder.iterdir() if p.name.startswith(".windmark")]


def killed(command: list[str], out: Path, after_s: float, number: int) -> tuple[int, str]:
    """Run, and send a signal after some time."""
    process = subprocess.Popen([*WINDMARK, *command, "-o", str(out)], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    try:
        _, said = process.communicate(timeout=after_s)
    except subprocess.TimeoutExpired:
        process.send_signal(number)
        _, said = process.communicate(timeout=120)
    return process.returncode, said.decode()


def kills(
    name: str, command: list[str], place: Path, count: int, chance: random.Random, sentences: Counter[str]
) -> str:
    """Old or new as a whole, whatever ends the run."""
    out = place / f"{name}-out"
    for _ in range(2):  # the first one may have to compile
        begun = time.perf_counter()
        subprocess.run([*WINDMARK, *command, "-o", str(out)], check=True, capture_output=True)
    whole_s, seen = time.perf_counter() - begun, Counter()
    for k in range(count):
        number, before = SIGNALS[k % len(SIGNALS)], state(out)
        # Half of them near the end, where files are written and exchanged.
        part = chance.uniform(0.05, 1.0) if k % 2 else chance.uniform(0.8, 1.1)
        begun = time.perf_counter()
        code, said = killed(command, out, part * whole_s, number)
        sentences.update(line for line in told(said, place) if "report:" not in line)
        after = state(out)
        bad = after.startswith("MIXED") or after == "none" or "Traceback" in said
        left = bool(hidden(place))
        seen[f"{number.name}: {'BAD ' + after if bad else 'old' if after == before else 'new'}"] += 1
        seen["hidden folder after the kill"] += left
        resumable = name == "deform"  # keeps its frames for --resume, and says so
        seen["BAD: hidden after a signal that can be caught"] += left and number != signal.SIGKILL and not resumable
        if bad:
            seen[f"BAD {said[-300:]}"] += 1
        if code == 0:
            whole_s = min(whole_s, time.perf_counter() - begun)
            seen["ended before the signal"] += 1
    done = subprocess.run([*WINDMARK, *command, "-o", str(out)], capture_output=True, check=False)
    sentences.update(told(done.stderr.decode(), place))
    seen["BAD: hidden after the next run"] += len(hidden(place))
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


def crowd(command: list[str], place: Path, sentences: Counter[str]) -> str:
    """Four runs into one folder at once: one does it, the others are refused at once."""
    out = place / "crowd"
    runs = [subprocess.Popen([*WINDMARK, *command, "-o", str(out)], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
            for _ in range(4)]  # fmt: skip
    codes = []
    for process in runs:
        _, said = process.communicate()
        codes.append(process.returncode)
        sentences.update(told(said.decode(), place))
    return f"4 runs into one folder: exit codes {sorted(codes)}, result {state(out)[:12]}, hidden {hidden(place)}"


def full_disks(command: list[str], place: Path, count: int, chance: random.Random, sentences: Counter[str]) -> str:
    """No file may grow beyond a random size, as on a disk that fills up."""
    out, seen = place / "full", Counter()
    subprocess.run([*WINDMARK, *command, "-o", str(out)], check=True, capture_output=True)
    largest = max(p.stat().st_size for p in out.rglob("*") if p.is_file())
    for _ in range(count):
        limit, before = int(chance.uniform(0, 1) ** 3 * largest), state(out)

        def limited(limit: int = limit) -> None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

        done = subprocess.run([*WINDMARK, *command, "-o", str(out)], capture_output=True, check=False,
                              preexec_fn=limited)  # fmt: skip
        sentences.update(told(done.stderr.decode(), place))
        after, said = state(out), done.stderr.decode()
        bad = after != before if done.returncode else after.startswith("MIXED")
        seen[f"code {done.returncode}: {'BAD ' + after if bad else 'old' if after == before else 'new'}"] += 1
        seen["BAD: traceback"] += "Traceback" in said
        seen["BAD: hidden"] += len(hidden(place))
    return f"full disk, {count} sizes: " + ", ".join(f"{what} {n}" for what, n in sorted(seen.items()) if n)


def told(said: str, place: Path) -> list[str]:
    """Sentences without what changes from run to run."""
    lines = [re.sub(r"process \d+ on \S+?(?=[);])", "process N on HOST", line) for line in said.splitlines()]
    return [
        re.sub(r"[^ ]*\.windmark-[^ /]*", "HIDDEN", line.replace(str(place), "PLACE"))[:200] for line in lines if line
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--exchanges", type=int, default=50)
    parser.add_argument("--disks", type=int, default=10)
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
        for verb in asked.verbs or commands:
            print(kills(verb, commands[verb], place, asked.kills, chance, sentences), flush=True)
        print(crowd(commands["track"], place, sentences), flush=True)
        print(full_disks(commands["track"], place, asked.disks, chance, sentences), flush=True)
    print("sentences:")
    for line, count in sentences.most_common():
        print(f"  {count:3d}  {line}")


if __name__ == "__main__":
    main()
