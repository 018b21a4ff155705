"""Is a run that goes on the same one: verb, version, options, the files it was made with, and its pictures."""

from __future__ import annotations

import hashlib
import os
import zlib
from collections.abc import Iterable, Mapping, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

import windmark
from windmark import io
from windmark.io.errors import reading
from windmark.io.manifest import relative
from windmark.pipeline.resume import KeptFrame, begun_with


def made_with(verb: str, options: Mapping[str, Any], files: Iterable[tuple[str, Path]]) -> dict[str, Any]:
    """Verb, version, options and the SHA-256 of every file besides pictures that a run is made with.

    Parameters
    ----------
    options, files : what they are called in messages -> plain values, paths
    """
    prints = {key: _sha256(path) for key, path in files}
    return {"verb": verb, "version": windmark.__version__, "options": dict(options), "files": prints}


def with_all(
    named: Iterable[tuple[str, Path]], read: Iterable[Path], project: Path, besides: Iterable[Path] = ()
) -> list[tuple[str, Path]]:
    """The files that a project names, each with its key, and all others that were read with it, by their path.

    A grid of several files, pages of a picture, what a law's file imports: no list of keys has them all.

    Parameters
    ----------
    read : see `io.errors.noted`
    project : the project's file
    besides : of ``read``, what is no such file: pictures of frames, whose prints are compared frame by frame
    """
    out = list(named)
    known = {os.path.realpath(path) for path in (*(p for _, p in out), *besides)}
    for path in sorted(set(read)):
        if os.path.realpath(path) not in known and path.is_file():
            out.append((relative(path, project.resolve().parent), path))
    return out


def check_begun(folder: Path, made: Mapping[str, Any]) -> None:
    """See that the run that was stopped in a folder was made with the same.

    Raises
    ------
    FileError
        Where there is none, or something has changed: it is named.
    """
    begun = begun_with(folder)
    if begun is None:
        raise io.FileError(folder, "has no run that was stopped; expected one to go on with")
    if (why := changed(begun, made)) is not None:
        raise io.FileError(folder, f"the run that was stopped there cannot go on: {why}")


def changed(before: Mapping[str, Any], now: Mapping[str, Any]) -> str | None:
    """What a run is made with otherwise than ``before``, see `made_with`, in words; None where all is the same."""
    if before["verb"] != now["verb"]:
        return f"it was begun by windmark {before['verb']}"
    if before["version"] != now["version"]:
        return f"it was begun by windmark {before['version']}, this is {now['version']}"
    for key, digest in now["files"].items():
        if before["files"].get(key) != digest:
            return f"{key} has changed since"
    for key in sorted({*before["options"], *now["options"]}):
        if before["options"].get(key) != now["options"].get(key):
            return f"{key} has changed since"
    return None if before == dict(now) else "other files take part now"


def check_pictures(
    folder: Path, done: Sequence[KeptFrame], now: Sequence[tuple[str, Mapping[str, str]]], *, of: str = "frame"
) -> None:
    """See that the pictures of the frames that were measured are still the same.

    Parameters
    ----------
    now : key and prints of the first frames as they are now, as many as there are of those that were measured
    of : what they are called in messages

    Raises
    ------
    FileError
        For the first frame whose pictures are others.
    """
    for kept, new in zip_longest(done, now):
        if new is None or (kept.key, dict(kept.pictures)) != (new[0], dict(new[1])):
            raise io.FileError(
                folder, f"the run that was stopped there cannot go on: the pictures of {of} {kept.key} have "
                "changed since",
            )  # fmt: skip


def picture_print(item: io.PictureFile) -> str:
    """A picture's name, size and checksum; of a recording its file's size, date and the frame's number."""
    path = item if isinstance(item, Path) else item.path
    try:
        if isinstance(item, io.Frame):
            stat = path.stat()
            return f"{path.name}[{item.number}]:{stat.st_size}:{stat.st_mtime_ns}"
        with reading(path):
            content = path.read_bytes()
    except (OSError, io.FileError):
        return f"{path.name}:gone"
    return f"{path.name}:{len(content)}:{zlib.crc32(content):08x}"


def _sha256(path: Path) -> str:
    with reading(path), open(path, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
