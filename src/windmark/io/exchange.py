"""Old for new: a result that is whole takes the place of the one before, see `results`.

A target that holds nothing but ours is exchanged in one step. Otherwise the files are moved one by one, by a list
(`Staging.journal`) that stands beside them. Before the manifest of the new result is written, which makes it whole, the
journal says what the target holds: a kill from then on, also between two moves, is made good by the next run.
"""

from __future__ import annotations

import ctypes
import json
import os
import shutil
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path, PurePosixPath
from typing import Any

from windmark.io.atomic import replace_file
from windmark.io.errors import FileError, reason
from windmark.io.manifest import MANIFEST, Record, file_hash, files_below, read_manifest, unchanged
from windmark.io.staging import Say, Staging

UNFINISHED = "unfinished"
"""In the manifest of a live run until it ends."""


_BEFORE = "before"
"""In the journal: the hash of the manifest in the target before the exchange; None without one."""


def announce(staging: Staging) -> None:
    """Note what the target holds, before the new result's manifest is written; see `finish_exchange`."""
    _note(staging, {_BEFORE: _print(staging.target)})


def withdraw(staging: Staging) -> None:
    """What is in ``new`` is no whole result (any more): its frames may be gone on with."""
    for note in (staging.new / MANIFEST, staging.draft, staging.journal):
        note.unlink(missing_ok=True)


def exchange(staging: Staging, record: Mapping[str, Any], say: Say) -> None:
    """Put the result in its place; on failure everything is as it was.

    Parameters
    ----------
    staging : has the new files
    record : their manifest: ``outputs``; where an older result is kept: `_why_kept`
    say : takes what was kept

    Raises
    ------
    FileError
        When a file cannot be moved.
    """
    target, outputs = staging.target, set(record.get("outputs", ()))
    old = read_manifest(target)
    ours, changed = (set(), set()) if old is None else unchanged(target, old)
    ours |= {MANIFEST} if old is not None else set()
    if old is not None and old.get(UNFINISHED):
        changed |= newer(target, target / MANIFEST)
    above = {str(folder) for name in outputs for folder in PurePosixPath(name).parents if (target / folder).is_file()}
    taken = {name for name in (outputs | above) - ours - changed if os.path.lexists(target / name)}
    why = "" if old is None else _why_kept(old, record, ours)
    keep = changed | taken | (ours if why else set())
    foreign = target.is_dir() and any(name not in ours for name in files_below(target))
    if (not target.exists() or not (foreign or keep)) and _swapped(staging):
        return
    kept = _kept_folder(staging) if keep else None
    _moved(staging, {"away": sorted(ours - keep), "keep": sorted(keep), "kept": None if kept is None else str(kept)})
    if kept is not None:
        why = why or "not written by windmark, or changed since"
        first = ", ".join(sorted(keep)[:3]) + (f" and {len(keep) - 3} more" if len(keep) > 3 else "")
        say(f"{target}: {first}: {why}; kept in {kept}")
    if old is None and foreign and "summary.json" in taken:
        say(f"{target}: holds an older result without a manifest; what the new one does not replace stays beside it")


def _why_kept(old: Mapping[str, Any], new: Mapping[str, Any], ours: set[str]) -> str:
    """Why an older result does not go for a new one, in words; "" where it does: the same again, as a rule."""
    if any(entry["file"] in ours for entry in new.get("inputs", ())):
        return "of an earlier run that this one reads"
    if old.get("verb") and new.get("verb") and old["verb"] != new["verb"]:
        return f"made by windmark {old['verb']}"  # the pictures of `simulate` are somebody's test
    if new.get("refused") and not old.get("refused"):
        return "of an earlier run that was not refused"
    return ""


def add(staging: Staging) -> None:
    """Put the new files into the target, in place of those of the same names; on failure everything is as it was.

    Raises
    ------
    FileError
        When a file cannot be moved.
    """
    target = staging.target
    _moved(staging, {"away": [n for n in files_below(staging.new) if os.path.isfile(target / n)], "keep": [],
                     "kept": None})  # fmt: skip


def _moved(staging: Staging, todo: Mapping[str, Any]) -> None:
    """Carry a list of moves out, which the next run goes on with after a kill; on failure everything is as it was."""
    target, there, earlier = staging.target, staging.target.exists(), _noted(staging)
    _note(staging, todo)
    done: list[tuple[Path, Path]] = []
    try:
        _carry_out(staging, todo, done)
    except OSError as error:
        for source, place in reversed(done):
            with suppress(OSError):
                source.parent.mkdir(parents=True, exist_ok=True)
                replace_file(place, source)
        _remove_empty(target, {place.parent.relative_to(target) for _, place in done if place.is_relative_to(target)})
        if not there:
            with suppress(OSError):
                target.rmdir()
        if earlier is None:
            staging.journal.unlink(missing_ok=True)
        else:
            with suppress(OSError):
                _note(staging, earlier)
        raise FileError(target, f"cannot be written: {error.filename2 or error.filename}: {reason(error)}") from error
    staging.journal.unlink(missing_ok=True)


def finish_exchange(staging: Staging, say: Say) -> None:
    """Do an exchange that a kill broke off, or what is left of it.

    Raises
    ------
    FileError
        When a whole result cannot be put in its place; it waits for the next run then.
    """
    todo = _noted(staging)
    if todo is None:
        return
    if _BEFORE not in todo:
        _carry_out(staging, todo)
    elif (record := _whole(staging)) is not None and _print(staging.new) != todo[_BEFORE]:
        staging.keep = True
        exchange(staging, record, say)
        staging.keep = False
    elif _print(staging.target) != todo[_BEFORE]:  # both have changed places: what is here is the older one
        staging.clear()
        return
    else:  # killed before it was whole
        withdraw(staging)
        return
    staging.clear()
    say(f"{staging.target}: a run was killed while it put its result there; this is done now")


def _whole(staging: Staging) -> Record | None:
    """The manifest of what is in ``new`` where all files are as it says: a power failure may have cut some."""
    record = read_manifest(staging.new)
    return None if record is None or unchanged(staging.new, record) != (set(record["outputs"]), set()) else record


def _print(folder: Path) -> str | None:
    """The hash of the manifest in a folder; None without one."""
    return file_hash(folder / MANIFEST) if (folder / MANIFEST).is_file() else None


def _note(staging: Staging, todo: Mapping[str, Any]) -> None:
    """Write the journal anew, whole."""
    staging.draft.write_text(json.dumps(todo), encoding="utf-8")
    replace_file(staging.draft, staging.journal)


def _noted(staging: Staging) -> dict[str, Any] | None:
    """What the journal says; None where there is none, or not a whole one (a power failure)."""
    with suppress(FileNotFoundError, ValueError):
        found = json.loads(staging.journal.read_bytes())
        return found if isinstance(found, dict) else None
    return None


def newer(target: Path, than: Path) -> set[str]:
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
