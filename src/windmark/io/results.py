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

import os
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from windmark.io.atomic import FULL, writing
from windmark.io.errors import NO_SPACE, FileError, FileState, refusal, space_on, witness
from windmark.io.exchange import UNFINISHED, announce, exchange, newer, withdraw
from windmark.io.interrupts import interrupts_wait
from windmark.io.leftovers import put_right
from windmark.io.manifest import CHANGED, MANIFEST, files_below, read_manifest, sources, write_manifest
from windmark.io.staging import Say, Staging, silent, staged
from windmark.io.text import write_json
from windmark.io.written import note_written

FIXED = ("report.html", "summary.json", MANIFEST)
"""Names that results have: no folder of the target may be called so."""


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
    read: Mapping[str, FileState] = field(default_factory=dict, repr=False)
    hashes: dict[Path, tuple[FileState, str]] = field(default_factory=dict, repr=False)

    def sources(self) -> dict[str, Any]:
        """What the result is made of so far, as the manifest will have it: ``versions`` and ``inputs`` with hashes."""
        return sources(self.place, self.target, self.read, self.hashes)


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
        At the start, when nothing can be written there or another run does, or when a live run is to go on and came to
        its end; at the end, when the disk is full.
    """
    with witness() as read, ExitStack() as held:
        with _what_stays(path, live):
            staging = held.enter_context(staged(path, say))
        with _what_stays(path, live), _by_their_names(staging):
            _refuse_folders(staging.target)
            if not resume:
                _refuse_own_inputs(staging.target, read, dict(about or {}))
            with writing(path, staging.hidden, *([staging.target] if live else []), only=False):
                resumed = put_right(path, staging, say, resume)
                out, there = _begin(staging, live, resume, say)
                out.about, out.resumed, out.read = dict(about or {}), out.resumed or resumed, read
                try:
                    yield out
                finally:
                    staging.keep = out.keep
                described = {**out.about, "refused": out.refused}
                if live:
                    record = write_manifest(out.place, staging.target, read, described, there, out.hashes)
                    note_written(staging.target)
                    _say_changed(record, staging.target, say)
                else:
                    with _withdrawn_unless_it_comes(staging):
                        announce(staging)
                        record = write_manifest(out.place, staging.target, read, described, there, out.hashes)
                        with interrupts_wait(f"{staging.target} had been written whole before"):
                            exchange(staging, record, say)
                            note_written(staging.target)
                            staging.keep = False
                        _say_changed(record, staging.target, say)
                staging.keep = False


def _say_changed(manifest: Mapping[str, Any], target: Path, say: Say) -> None:
    """Name the files that were edited while the run was at work: the result is of what was in them before."""
    for entry in manifest["inputs"]:
        if entry.get(CHANGED):
            path = os.path.normpath(target / entry["file"])
            say(f"{path}: was changed after it had been read: the result is of what was in it then")


@contextmanager
def _withdrawn_unless_it_comes(staging: Staging) -> Iterator[None]:
    """A result that was not put in its place, and is kept to be gone on with, is none that the next run puts there."""
    try:
        yield
    except BaseException:
        if staging.keep:
            withdraw(staging)
        raise


@contextmanager
def _by_their_names(staging: Staging) -> Iterator[None]:
    """The user knows a file by the name that it would have had."""
    try:
        yield
    except FileError as error:
        if not error.path.is_relative_to(staging.new):
            raise
        raise FileError(staging.target / error.path.relative_to(staging.new), error.what, error.where) from error


@contextmanager
def _what_stays(path: str | os.PathLike[str], live: bool) -> Iterator[None]:
    """Where a disk takes no more, the error says which disk that is, and what is there as it was."""
    try:
        yield
    except FileError as error:
        cause = refusal(error)
        if cause is None or cause.errno not in FULL:
            raise
        there = read_manifest(Path(os.path.realpath(path)))
        words = [error.what, space_on(error.path) if cause.errno in NO_SPACE else ""]
        if there is None:
            words.append("nothing was put there")
        else:
            begun = live and there.get(UNFINISHED)
            words.append("what is there is unfinished" if begun else "the result that was there is as it was")
        raise FileError(error.path, "; ".join(word for word in words if word), error.where) from error


def _refuse_folders(target: Path) -> None:
    for name in FIXED:
        if (target / name).is_dir():
            raise FileError(target / name, "this is a folder, and the result needs a file of this name; move it, or "
                            "choose another folder for the result")  # fmt: skip


def _refuse_own_inputs(target: Path, read: Mapping[str, FileState], about: Mapping[str, Any]) -> None:
    """A result in the target would go for the new one: not where the new one is made of it.

    What is read later on is not known yet; `exchange` keeps it.
    """
    old = read_manifest(target)
    if old is None:
        return
    files = {os.path.realpath(target / name): name for name in old["outputs"]}
    given = about.get("options", {}).values()
    options = [value for several in given for value in (several if isinstance(several, list) else [several])]
    named = [os.path.join(target, value) for value in options if isinstance(value, str)]
    found = next((files[path] for path in map(os.path.realpath, (*read, *named)) if path in files), None)
    if found is not None:
        by = f" of windmark {old['verb']}" if old.get("verb") else ""
        words = f"holds the result{by}, and this run reads {found} of it; choose another folder for the output"
        raise FileError(target, words)


def _begin(staging: Staging, live: bool, resume: bool, say: Say) -> tuple[ResultFolder, dict[str, int]]:
    """Where to write, and the files that are there already, with their times: they are not of this result."""
    if not live:
        staging.new.mkdir(exist_ok=True)
        return ResultFolder(staging.target, staging.new), {}
    target = staging.target
    if not target.is_dir():
        target.mkdir()
    of_it: set[str] = set()
    old = read_manifest(target)
    resumed = resume and old is not None and bool(old.get(UNFINISHED))
    if resumed:
        of_it = newer(target, target / MANIFEST)
    elif resume and old is not None:
        raise FileError(target, "has no run to go on with: the one there came to its end")
    else:
        if old is not None:
            exchange(staging, {"refused": True}, say)
        write_json(target / MANIFEST, {UNFINISHED: True, "outputs": {}})
    there = {name: os.lstat(target / name).st_mtime_ns for name in files_below(target) if name not in of_it}
    return ResultFolder(target, target, resumed=resumed), there
