"""A folder of results is one thing: it holds the files of one run, the new ones or the old ones, never both.

The result is made in a hidden folder (`staging`) and put in its place when it is whole. What stands in the target is
told apart by its manifest:

- files of ours, as we wrote them: they go when a new result comes. Where the new run says no, they are kept;
- files of ours that were changed since, and others' files whose names we need: kept;
- others' files: they stay as they are.

What is *kept* is moved into ``TARGET.kept-1`` (``-2``, ...) beside the target, and said.

A target that holds nothing but ours is exchanged in one step. Otherwise the files are moved one by one; a kill between
two of these moves is made good by the next run: the hidden folder has a list of them.
"""

from __future__ import annotations

import ctypes
import json
import os
import shutil
import signal
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

from windmark.io.atomic import replace_file, writing
from windmark.io.errors import FileError, reason, witness
from windmark.io.manifest import MANIFEST, files_below, read_manifest, unchanged, write_manifest
from windmark.io.staging import Say, Staging, busy, hidden_places, in_use, silent, stage
from windmark.io.text import write_json

FIXED = ("report.html", "summary.json", MANIFEST)
"""Names that results have: no folder of the target may be called so."""
UNFINISHED = "unfinished"
"""In the manifest of a live run until it ends."""


@dataclass
class ResultFolder:
    """A result in the making.

    Parameters
    ----------
    target : where it will be
    place : where to write now
    about : what the manifest says besides: verb, options
    refused : set it where the data said no: an older good result is kept then
    resumed : ``place`` has what a killed run left
    keep : set it where what is in ``place`` can be gone on with (``resume``): an exception does not remove it then
    """

    target: Path
    place: Path
    about: dict[str, Any] = field(default_factory=dict)
    refused: bool = False
    resumed: bool = False
    keep: bool = False


@contextmanager
def result_folder(
    path: str | os.PathLike[str],
    about: Mapping[str, Any] | None = None,
    *,
    say: Say = silent,
    live: bool = False,
    resume: bool = False,
) -> Iterator[ResultFolder]:
    """Hold a folder for a result: enter it before the work, write into its ``place``; it is put in order at the end.

    Any exception, Ctrl-C included, leaves the target as it was.

    Parameters
    ----------
    path : the folder; missing ones above it are made
    about : for the manifest, see `ResultFolder`
    say : takes sentences for the user: what was kept, what a killed run had left
    live : ``place`` is the target itself, whose files can be read while they grow; an older result is kept. After an
        exception the files stay, with a manifest that says unfinished.
    resume : go on in what a killed run has left, where there is something (``resumed``); otherwise it is removed

    Raises
    ------
    FileError
        At the start, when nothing can be written there or another run does; at the end, when the disk is full.
    """
    out = None
    with witness() as read:
        staging = stage(path, say)
        try:
            _refuse_folders(staging.target)
            with writing(path, staging.hidden, *([staging.target] if live else [])):
                resumed = _leftovers(path, staging, say, resume)
                out, there = _begin(staging, live, resume, say)
                out.about, out.resumed = dict(about or {}), out.resumed or resumed
                yield out
                described = {**out.about, "refused": out.refused}
                record = write_manifest(out.place, staging.target, read, described, there)
                if not live:
                    with _uninterrupted(staging.target):
                        _exchange(staging, set(record["outputs"]), out.refused, say)
                out.keep = False
        except FileError as error:
            if not error.path.is_relative_to(staging.new):
                raise
            # The user knows the file by the name that it would have had.
            raise FileError(staging.target / error.path.relative_to(staging.new), error.what, error.where) from error
        finally:
            staging.release(clear=out is None or not out.keep)


def unfinished(path: str | os.PathLike[str]) -> Path | None:
    """What a killed run has left of a result for ``path``: the folder with its files; None where there is nothing."""
    for hidden in hidden_places(Path(os.path.realpath(path))):
        if _is_unfinished(hidden / "new"):
            return hidden / "new"
    return None


def _is_unfinished(new: Path) -> bool:
    """Whether a folder has files and no manifest, which is written last (an older result, taken out, has one)."""
    return new.is_dir() and any(new.iterdir()) and not (new / MANIFEST).exists()


def _refuse_folders(target: Path) -> None:
    for name in FIXED:
        if (target / name).is_dir():
            raise FileError(target / name, "this is a folder, and the result needs a file of this name; move it, or "
                            "choose another folder for the result")  # fmt: skip


def _begin(staging: Staging, live: bool, resume: bool, say: Say) -> tuple[ResultFolder, dict[str, int]]:
    """Where to write, and the files that are there already, with their times: they are not of this result."""
    if not live:
        staging.new.mkdir(exist_ok=True)
        return ResultFolder(staging.target, staging.new), {}
    target = staging.target
    if not target.is_dir():
        target.mkdir()
    old, of_it = read_manifest(target), set()
    resumed = resume and old is not None and bool(old.get(UNFINISHED))
    if resumed:
        of_it = _newer(target, target / MANIFEST)
    else:
        if old is not None:
            _exchange(staging, set(), True, say)
        write_json(target / MANIFEST, {UNFINISHED: True, "outputs": {}})
    there = {name: os.lstat(target / name).st_mtime_ns for name in files_below(target) if name not in of_it}
    return ResultFolder(target, target, resumed=resumed), there


# --- what a killed run has left ------------------------------------------------------------------------


def _leftovers(path: str | os.PathLike[str], staging: Staging, say: Say, resume: bool) -> bool:
    """Finish an exchange that a kill broke off, remove or take over an unfinished result; whether it is taken over."""
    for hidden in hidden_places(staging.target):
        if hidden == staging.hidden or not hidden.is_dir():
            continue
        if holder := in_use(hidden):
            raise busy(path, holder)
        with suppress(OSError):  # on a disk that we could not write to this time it must wait
            _finish_exchange(Staging(staging.target, hidden, -1), say)
            shutil.rmtree(hidden)
            say(f"{hidden} was left by a run that was killed; removed")
    _finish_exchange(staging, say)
    if resume and _is_unfinished(staging.new):
        return True
    if staging.new.is_dir() and any(staging.new.iterdir()):
        say(f"{staging.hidden} was left by a run that was killed; removed")
    staging.clear()
    return False


def _finish_exchange(staging: Staging, say: Say) -> None:
    if not staging.journal.is_file():
        return
    try:
        todo = json.loads(staging.journal.read_bytes())
    except ValueError:  # killed while it was written: nothing has been moved yet
        return
    _carry_out(staging, todo)
    staging.clear()
    say(f"{staging.target}: a run was killed while it put its result there; this is done now")


# --- old for new -------------------------------------------------------------------------------------------


def _exchange(staging: Staging, outputs: set[str], refused: bool, say: Say) -> None:
    """Put the result in its place; on failure everything is as it was."""
    target = staging.target
    old = read_manifest(target)
    ours, changed = (set(), set()) if old is None else unchanged(target, old)
    ours |= {MANIFEST} if old is not None else set()
    if old is not None and old.get(UNFINISHED):
        changed |= _newer(target, target / MANIFEST)
    above = {str(folder) for name in outputs for folder in PurePosixPath(name).parents if (target / folder).is_file()}
    taken = {name for name in (outputs | above) - ours - changed if os.path.lexists(target / name)}
    keep = changed | taken | (ours if refused and old is not None and not old.get("refused") else set())
    foreign = target.is_dir() and any(name not in ours for name in files_below(target))
    if (not target.exists() or not (foreign or keep)) and _swapped(staging):
        return
    kept = _kept_folder(staging) if keep else None
    todo = {"away": sorted(ours - keep), "keep": sorted(keep), "kept": None if kept is None else str(kept)}
    staging.journal.write_text(json.dumps(todo), encoding="utf-8")
    done: list[tuple[Path, Path]] = []
    try:
        _carry_out(staging, todo, done)
    except OSError as error:
        for source, place in reversed(done):
            with suppress(OSError):
                source.parent.mkdir(parents=True, exist_ok=True)
                replace_file(place, source)
        staging.journal.unlink(missing_ok=True)
        raise FileError(target, f"cannot be written: {error.filename2 or error.filename}: {reason(error)}") from error
    staging.journal.unlink(missing_ok=True)
    if kept is not None:
        why = "of an earlier run that was not refused" if refused else "not written by windmark, or changed since"
        first = ", ".join(sorted(keep)[:3]) + (f" and {len(keep) - 3} more" if len(keep) > 3 else "")
        say(f"{target}: {first}: {why}; kept in {kept}")
    if old is None and foreign and "summary.json" in taken:
        say(f"{target}: holds an older result without a manifest; what the new one does not replace stays beside it")


def _newer(target: Path, than: Path) -> set[str]:
    """What a live run that was killed has written."""
    since = than.stat().st_mtime_ns
    return {n for n in files_below(target) if n != MANIFEST and os.lstat(target / n).st_mtime_ns >= since}


def _carry_out(staging: Staging, todo: Mapping[str, Any], done: list[tuple[Path, Path]] | None = None) -> None:
    """Do the moves of an exchange, or those that are left of it: what is away already is not moved again."""
    done = [] if done is None else done
    target = staging.target

    def move(source: Path, place: Path) -> None:
        place.parent.mkdir(parents=True, exist_ok=True)
        replace_file(source, place)
        done.append((source, place))

    if not target.is_dir():
        target.mkdir()
    for base, names in ((staging.old, todo["away"]), (Path(todo["kept"] or "."), todo["keep"])):
        # The manifest goes first and comes last: while it is missing, the folder is known to be in between.
        for name in sorted(names, key=lambda n: n != MANIFEST):
            if os.path.lexists(target / name) and not os.path.lexists(base / name):
                move(target / name, base / name)
    for name in sorted(files_below(staging.new), key=lambda n: n == MANIFEST):
        if (target / name).is_dir():  # emptied by the moves before, or somebody's
            with suppress(OSError):
                (target / name).rmdir()
        move(staging.new / name, target / name)
    _remove_empty(target, {Path(name).parent for name in (*todo["away"], *todo["keep"])})


def _remove_empty(target: Path, folders: set[Path]) -> None:
    for folder in sorted(folders, key=lambda f: -len(f.parts)):
        for place in (folder, *folder.parents):
            if place.parts:
                with suppress(OSError):
                    (target / place).rmdir()


def _kept_folder(staging: Staging) -> Path:
    """A new name beside the target, inside of it where nothing can be put beside it."""
    target, k = staging.target, 1
    while True:
        kept = target.with_name(f"{target.name}.kept-{k}") if staging.beside else target / f"kept-{k}"
        if not os.path.lexists(kept):
            return kept
        k += 1


def _swapped(staging: Staging) -> bool:
    """Exchange the target as a whole for the new folder; False where that is not possible here."""
    new, target = staging.new, staging.target
    if not staging.beside or _we_stand_in(target):
        return False
    try:
        if not target.exists():
            os.rename(new, target)
            return True
        there, here = target.stat(), new.stat()
        if (there.st_uid, there.st_gid) != (here.st_uid, here.st_gid):
            return False
        shutil.copymode(target, new)
        return _rename_exchange(new, target)
    except OSError:
        return False


def _we_stand_in(target: Path) -> bool:
    """Whether the working folder is the target or below: a shell that stands there would stand in a removed one."""
    try:
        return Path.cwd().resolve().is_relative_to(target)
    except OSError:
        return True


def _rename_exchange(a: Path, b: Path) -> bool:
    """Exchange two names in one step of the file system (Linux, `renameat2`); False where it has none."""
    rename = getattr(ctypes.CDLL(None), "renameat2", None) if os.name == "posix" else None
    here, exchange = -100, 2
    return rename is not None and rename(here, os.fsencode(a), here, os.fsencode(b), exchange) == 0


@contextmanager
def _uninterrupted(target: Path) -> Iterator[None]:
    """Ctrl-C and SIGTERM wait until the block is done."""
    caught: list[int] = []
    before = {}
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            before[number] = signal.signal(number, lambda n, _: caught.append(n))
    try:
        yield
    finally:
        for number, handler in before.items():
            if handler is not None:  # None: not Python's own, nobody can set it again
                signal.signal(number, handler)
    if caught:
        raise KeyboardInterrupt(f"{target} had been written whole before")
