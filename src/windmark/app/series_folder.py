"""The folder of a series' results: where the series is stopped, what it has measured is kept for `--resume`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from windmark import io
from windmark.app import console
from windmark.errors import UsageError
from windmark.io.exchange import UNFINISHED
from windmark.io.manifest import read_manifest
from windmark.pipeline.resume import begun_with, clear, measured


@contextmanager
def series_folder(
    folder: Path, go_on: str, *, live: bool = False, of: str = "frames"
) -> Iterator[tuple[io.ResultFolder, str]]:
    """`console.result_folder` of a series, and how it goes on with what was stopped there.

    Parameters
    ----------
    go_on : "resume", "finish" (only bring to its end what was measured), or "" for a new run. "resume" becomes "" where
        the run was stopped before there was anything to go on with
    of : what its parts are called in messages
    """
    out: io.ResultFolder | None = None
    _clear_if_finished(folder)
    try:
        with console.result_folder(folder, live=live, resume=bool(go_on)) as out:
            if live and not go_on:  # a result whose exchange a kill broke off may just have come, with its journal
                clear(folder)
            elif not live:
                _clear_if_finished(folder)
            if go_on == "resume" and out.resumed and begun_with(out.place) is None:
                go_on = ""
            try:
                yield out, go_on
            except BaseException:
                out.keep = bool(measured(out.place))
                if live and not out.keep:  # what it writes to is no hidden folder, which would go by itself
                    clear(out.place)
                raise
            out.keep = True  # until the result is in its place
    except BaseException as error:
        if out is None or came_to_its_end(out.place) or (told := _with_what_is_kept(error, out, of)) is None:
            raise
        raise told from error
    clear(folder)


def came_to_its_end(folder: Path) -> bool:
    """Whether the result in a folder is whole: a journal beside it is only what a kill left there."""
    manifest = read_manifest(folder)
    return manifest is not None and not manifest.get(UNFINISHED)


def left(folder: Path) -> int:
    """How many frames of a run that did not come to its end stand in a folder of results."""
    return 0 if came_to_its_end(folder) else measured(folder)


def how_to_go_on(resume: bool, finish: bool, watch: Path | None = None) -> str:
    """``go_on`` of the options `--resume` and `--finish`.

    Raises
    ------
    UsageError
        For both, and for `--finish` with a folder that is watched.
    """
    if (resume and finish) or (finish and watch is not None):
        also = "--resume" if watch is None else "--resume and --watch"
        raise UsageError(f"--finish measures no more: leave out {also}")
    return "resume" if resume else "finish" if finish else ""


def _clear_if_finished(folder: Path) -> None:
    if came_to_its_end(folder):
        clear(folder)


def _with_what_is_kept(error: BaseException, out: io.ResultFolder, of: str) -> BaseException | None:
    """What stopped a run, with what it leaves; None where it leaves nothing, or is a fault of ours."""
    if not (count := measured(out.place)):
        return None
    kept = f"{count} {of} are kept: --resume goes on with them, --finish makes do with them"
    if isinstance(error, io.FileError):
        return io.FileError(error.path, f"{error.what}; {kept}", error.where)
    if isinstance(error, OSError):
        return io.FileError(error.filename or out.target, f"{io.reason(error)}; {kept}")
    return KeyboardInterrupt(kept) if isinstance(error, KeyboardInterrupt) else None
