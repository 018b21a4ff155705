"""What a run that was killed has left for a folder: finished, taken over, or removed, and said."""

from __future__ import annotations

import os
import shutil
from contextlib import suppress
from pathlib import Path, PurePosixPath

from windmark.io.errors import FileError
from windmark.io.exchange import UNFINISHED, finish_exchange
from windmark.io.making import left_behind, left_below
from windmark.io.manifest import MANIFEST, read_manifest
from windmark.io.staging import Say, Staging, busy, hidden_places, in_use


def put_right(path: str | os.PathLike[str], staging: Staging, say: Say, resume: bool = False) -> bool:
    """Finish an exchange that a kill broke off, remove or take over an unfinished result; whether it is taken over.

    Parameters
    ----------
    path : the target as the user knows it
    staging : its hidden folder, held by us
    say : takes what was found
    resume : take over what has files and no manifest, which is written last (an older result, taken out, has one)

    Raises
    ------
    FileError
        When another run holds the other place where the target's hidden folder may stand.
    """
    for hidden in hidden_places(staging.target):
        if hidden == staging.hidden or not hidden.is_dir():
            continue
        if process := in_use(hidden):
            raise busy(path, process)
        with suppress(OSError, FileError):  # on a disk that we could not write to this time it must wait
            finish_exchange(Staging(staging.target, hidden, -1), say)
            shutil.rmtree(hidden)
            say(f"{hidden} was left by a run that was killed; removed")
    finish_exchange(staging, say)
    for folder in _ours(staging.target):
        for file in left_behind(folder):
            say(f"{file} was left by a run that was killed; removed")
    if resume and _is_unfinished(staging.new):
        left_below(staging.new)
        return True
    if staging.new.is_dir() and any(staging.new.iterdir()):
        say(f"{staging.hidden} was left by a run that was killed; removed")
    staging.clear()
    return False


def _ours(target: Path) -> list[Path]:
    """Folders that we write into: the target may be somebody's home, whose depths are none of our business."""
    old = read_manifest(target) or {UNFINISHED: False, "outputs": {}}
    if old.get(UNFINISHED):  # of a live run, which names its files at its end
        return [Path(place) for place, _, _ in os.walk(target)]
    names = [PurePosixPath(str(name)) for name in old["outputs"]]
    inside = {folder for name in names if not name.is_absolute() and ".." not in name.parts for folder in name.parents}
    return [target, *(target / folder for folder in sorted(inside) if folder.parts)]


def _is_unfinished(new: Path) -> bool:
    return new.is_dir() and any(new.iterdir()) and not (new / MANIFEST).exists()
