"""Disks that are full, read-only, mounted or elsewhere: is a result the old one or the new one, and is it said why?

    python benchmarks/disks.py                       # thirty full disks for each verb, every kind of place
    python benchmarks/disks.py --fills 6 --verbs run

Disks are file systems in memory that are mounted for it: by root, or by anybody where the system lends name spaces
(`unshare`). Where nothing can be mounted, no file may grow beyond a random size instead, and the rows of other disks
are left out; the first line says which it was. Half of the disks leave a random number of bytes, the other half is
filled by somebody else at a random moment. Afterwards the folder must hold the older result or the new one as a whole,
nothing hidden but frames that can be gone on with, and the next run, with space, must come to its end.
"""

from __future__ import annotations

import argparse
import os
import random
import resource
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

from _disk import can_mount, empty, fill, mounted, used
from _faults import Ended, Run, hidden, prepared, state, told, warm, watched
from _same import Rows, table

MIB = 2**20
IN_NAME_SPACE = "WINDMARK_BENCHMARK_IN_NAME_SPACE"
Sentences = Counter[str]


# --- full disks ----------------------------------------------------------------------------------


def full_disks(
    verb: str, command: list[str], disk: Path, count: int, chance: random.Random, sentences: Sentences, mounts: bool
) -> str:
    """A disk that fills up while a verb works, again and again."""
    out, seen = disk / "out", Counter[str]()
    talk = Path(tempfile.mkdtemp())
    live, resumable = "--watch" in command, command[0] in ("deform", "track")
    command = [*command, "-o", str(out)]
    for _ in range(2):  # the first one finds nothing, the second replaces
        whole = Run(command, talk).end()
        assert whole.code == 0, whole.said
        undisturbed, space = series(out), used(disk)
    largest = max(p.stat().st_size for p in out.rglob("*") if p.is_file())
    for k in range(count):
        for kept in disk.glob("out.kept-*"):
            shutil.rmtree(kept)
        before = state(out)
        if not mounts:
            most = int(chance.uniform(0, 1) ** 3 * largest)
            ended = Run(command, talk, partial(resource.setrlimit, resource.RLIMIT_FSIZE, (most, most))).end()
        elif k % 2:
            fill(disk, int(chance.uniform(0, 1.1) * space))
            ended = Run(command, talk).end()
        else:
            run = Run(command, talk)
            run.sleep(chance.uniform(0, 1) * whole.seconds)
            fill(disk, 0)
            ended = run.end()
        sentences.update(told(ended.said, disk))
        judge(ended, before, out, live, seen)
        left = hidden(disk)
        goes_on = resumable and "--resume goes on" in ended.said
        seen["BAD: hidden"] += bool(left) and not goes_on
        seen["frames kept"] += goes_on
        empty(disk)
        if ended.code:
            again = Run([*command, *(["--resume"] if goes_on else [])], talk).end()
            sentences.update(told(again.said, disk))
            bad = again.code != 0 or bool(hidden(disk)) or state(out)[:5] in ("none", "MIXED")
            seen["BAD: next run"] += bad
            seen[f"BAD: {again.said[-200:]} {hidden(disk)} {state(out)}"] += bad
            seen["BAD: other numbers after going on"] += goes_on and series(out) != undisturbed
            seen["next run comes to its end"] += not bad
    shutil.rmtree(talk)
    found = ", ".join(f"{what} {n}" for what, n in sorted(seen.items()) if n)
    return f"{verb} ({whole.seconds:.1f} s): {count} full disks: {found}"


def judge(ended: Ended, before: str, out: Path, live: bool, seen: Counter[str]) -> None:
    """Whether a run that a full disk met ended as it should."""
    after = state(out)
    if live and ended.code:  # its tables are in the folder itself; what was there before is beside it
        kept = next(iter(out.parent.glob("out.kept-*")), out)
        fine = before in (after, state(kept))
        what = "old" if fine else f"BAD {after} {[p.name for p in out.parent.iterdir()]}"
    else:
        fine = after == before if ended.code else not after.startswith("MIXED") and after != "none"
        what = ("old" if after == before else "new") if fine else f"BAD {after}"
    seen[f"code {ended.code} {what}"] += 1
    seen["BAD: traceback"] += "Traceback" in ended.said or ended.code not in (0, 2)
    if ended.code:
        full = "the disk is full" in ended.said or "larger than is allowed" in ended.said
        seen[f"BAD: no reason: {ended.said[-300:]}"] += not full
        seen[f"BAD: no place: {ended.said[-300:]}"] += str(out.parent) not in ended.said
        stays = ("frames are kept", "is as it was", "nothing was", *(["unfinished"] if live else []))
        seen["BAD: what was kept is not said"] += not any(words in ended.said for words in stays)
        seen["BAD: the disk is not named"] += "the disk is full" in ended.said and "MB free" not in ended.said


def series(out: Path) -> Rows:
    """The numbers of a sequence without wall times; nothing for the other verbs."""
    return [row for name in ("deformation.csv", "poses.csv") if (out / name).is_file() for row in table(out / name)]


# --- places --------------------------------------------------------------------------------------


def places(command: list[str], folder: Path, sentences: Sentences) -> Iterator[str]:
    """Every kind of place that a result can have; one row each."""
    talk = Path(tempfile.mkdtemp(dir=folder))

    def row(what: str, out: Path, codes: tuple[int, ...], within: Path, twice: bool = True,
            before: Callable[[], object] | None = None) -> str:  # fmt: skip
        found = []
        for _ in range(1 + twice):
            was = state(out) if out.is_dir() else "none"
            ended = Run([*command, "-o", str(out)], talk, before).end()
            sentences.update(told(ended.said, within))
            whole = state(out) if out.is_dir() else "none"
            good = whole[:5] not in ("none", "MIXED") if ended.code == 0 else whole == was
            found.append((ended.code, good, "Traceback" not in ended.said))
        left = hidden(within)
        fine = all(code in codes and good and calm for code, good, calm in found) and not left
        return f"{what}: {'as it should' if fine else 'BAD'}, exit codes {[f[0] for f in found]}, hidden {left}"

    with mounted(folder / "disk") as disk, mounted(folder / "other") as other:
        yield row("the target is a mount point", disk, (0,), disk)
    with mounted(folder / "disk") as disk, mounted(folder / "other") as other:
        (other / "target").mkdir()
        (disk / "out").symlink_to(other / "target")
        yield row("a link to a folder on another disk", disk / "out", (0,), disk)
        yield f"  it is still a link: {(disk / 'out').is_symlink()}, hidden there: {hidden(other)}"
        (disk / "new").symlink_to(other / "not yet")
        yield row("a link to what is not there yet, on another disk", disk / "new", (0,), disk)
        (disk / "loop").symlink_to(disk / "loop")
        yield row("a link to itself", disk / "loop", (2,), disk)
        (disk / "bind").mkdir()
        (other / "bound").mkdir()
        subprocess.run(["mount", "--bind", str(other / "bound"), str(disk / "bind")], check=True)
        yield row("a folder bound from another disk", disk / "bind", (0,), disk)
        subprocess.run(["umount", str(disk / "bind")], check=True)
    with mounted(folder / "disk") as disk:
        ended = Run([*command, "-o", str(disk / "out")], talk).end()
        before = state(disk / "out")
        subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
        yield row("a read-only disk, nothing there before", disk / "new" / "deep", (2,), disk)
        ended = Run([*command, "-o", str(disk / "out")], talk).end()
        sentences.update(told(ended.said, disk))
        same = ended.code == 2 and state(disk / "out") == before and not hidden(disk)
        yield f"a read-only disk, an older result: {'as it should' if same else 'BAD'}, exit code {ended.code}"
    with mounted(folder / "disk") as disk:
        (disk / "closed").mkdir(mode=0o755)
        (disk / "open").mkdir(mode=0o777)
        (disk / "closed" / "mine").mkdir(mode=0o777)
        for path in ("open", "closed/mine"):
            os.chmod(disk / path, 0o777)
        os.chmod(disk, 0o755)
        plain = as_nobody if os.geteuid() == 0 and IN_NAME_SPACE not in os.environ else None
        if plain is not None and all(os.stat(p).st_mode & 1 for p in (folder, *folder.parents)):
            os.chmod(talk, 0o777)
            yield row("a folder that is not ours to write to", disk / "closed", (2,), disk, before=plain)
            yield row("a new folder where nothing can be made", disk / "closed" / "new", (2,), disk, before=plain)
            yield row("our own folder in one that is closed", disk / "closed" / "mine", (0,), disk, before=plain)
            yield row("our own folder", disk / "open" / "out", (0,), disk, before=plain)
    yield from read_only_package(folder, sentences)


def as_nobody() -> None:
    """Go on as a user without rights."""
    os.setgid(65534)
    os.setuid(65534)


def read_only_package(folder: Path, sentences: Sentences) -> Iterator[str]:
    """The program on a read-only disk: without a home, and with nothing that can be written to at all."""
    import windmark

    source = Path(windmark.__file__).parent
    io_image = folder / "image.png"
    windmark.io.write_image(io_image, np.full((60, 80), 99, np.uint8))
    with mounted(folder / "disk", "size=128m") as disk:
        shutil.copytree(source, disk / "windmark", ignore=shutil.ignore_patterns("__pycache__"))
        subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
        home = folder / "nothing"
        for what, temporary in (("without a home", str(folder / "tmp")), ("without home or temporary folder", "")):
            (folder / "tmp").mkdir(exist_ok=True)
            environment = {"PATH": os.environ["PATH"], "PYTHONPATH": str(disk), "HOME": "/proc/nowhere",
                           "OPENBLAS_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}  # fmt: skip
            if temporary:
                environment["TMPDIR"] = temporary
            code = [sys.executable, "-c", "import sys, tempfile\nif sys.argv[1] == 'none':\n    tempfile.tempdir = "
                    "'/proc'\ndel sys.argv[1]\nfrom windmark.app.cli import main\nmain()", "some" if temporary else
                    "none"]  # fmt: skip
            out = folder / "points.csv"
            begun = subprocess.run([*code, "detect", str(io_image), "-o", str(out)], env=environment, cwd="/",
                                   capture_output=True, text=True, check=False)  # fmt: skip
            sentences.update(told(begun.stderr, folder))
            calm = begun.returncode == 1 and "Traceback" not in begun.stderr  # there is no marker in it
            kernels = len(list((folder / "tmp").rglob("*.nbi")))
            shutil.rmtree(folder / "tmp")
            yield (f"a read-only package {what}: {'as it should' if calm else 'BAD'}, exit code {begun.returncode}, "
                   f"kernels kept in the temporary folder {kernels}")  # fmt: skip
        assert not home.exists()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--fills", type=int, default=30)
    parser.add_argument("--verbs", nargs="*")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--no-places", action="store_true")
    parser.add_argument("--tests", type=Path, help="folder of the synthetic tests, made there if they are missing")
    asked = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    chance, sentences = random.Random(asked.seed), Sentences()
    with tempfile.TemporaryDirectory(prefix="windmark-disks-") as name:
        folder = Path(name)
        os.chmod(folder, 0o755)
        mounts = can_mount(folder / "trial")
        if not mounts and IN_NAME_SPACE not in os.environ and shutil.which("unshare"):
            os.environ[IN_NAME_SPACE] = "1"
            if subprocess.run(["unshare", "-rm", "true"], capture_output=True, check=False).returncode == 0:
                os.execvp("unshare", ["unshare", "-rm", sys.executable, *sys.argv])
        print("disks: " + ("mounted file systems in memory" if mounts else "nothing can be mounted here: limits of the "
              "size of files; no other disks"), flush=True)  # fmt: skip
        tests = asked.tests or folder / "tests"
        tests.mkdir(exist_ok=True)
        commands = prepared(tests)
        commands["deform --watch"] = watched(commands)
        verbs = asked.verbs or list(commands)
        for verb in {*verbs, "track"}:  # everything is imported and compiled here; runs are copies of this process
            warm(commands[verb], folder / "warm")
        for verb in verbs:
            disk = folder / "full"
            disk.mkdir(exist_ok=True)
            if mounts:
                with mounted(disk, "size=256m"):
                    print(full_disks(verb, commands[verb], disk, asked.fills, chance, sentences, True), flush=True)
            else:
                print(full_disks(verb, commands[verb], disk, asked.fills, chance, sentences, False), flush=True)
        if mounts and not asked.no_places:
            for line in places(commands["track"], folder, sentences):
                print(line, flush=True)
    print("sentences:")
    for line, count in sentences.most_common():
        print(f"  {count:3d}  {line}")


if __name__ == "__main__":
    main()
