"""Talking to a person or to a machine: progress, one-line answers, JSON, errors, exit codes."""

from __future__ import annotations

import json
import os
import re
import shutil
import sys
import textwrap
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from windmark.errors import WindmarkError

try:  # typer has a click of its own since 0.26
    from typer._click.globals import get_current_context
except ImportError:
    from click import get_current_context  # type: ignore[no-redef]

if TYPE_CHECKING:
    from windmark.geometry import Camera
    from windmark.io import PictureFile, ResultFolder
    from windmark.pipeline.lengths import Lengths

NARROWEST = 40
"""Letters of a line on a terminal that says it has fewer."""
_WHOLE = re.compile(r" *(report|results|written|picture|film): |.*\bnext: windmark ")
DONE, DATA_SAY_NO, WRONG_USAGE, FAULT, INTERRUPTED = 0, 1, 2, 3, 130


def answer(record: Mapping[str, Any], as_json: bool, lines: list[str]) -> None:
    """Print the result: JSON for machines, or lines for people, who may have had enough of it (``| head``)."""
    if as_json:
        from windmark.io import to_json

        lines = [printable(to_json(record))]
    else:
        lines = [laid(line, sys.stdout) for line in lines]
    try:
        for line in lines:
            typer.echo(line)
    except OSError as error:
        from windmark.io import reason

        _lead_nowhere()
        if not isinstance(error, BrokenPipeError):
            complain(f"standard output: cannot be written: {reason(error)}")
            raise typer.Exit(WRONG_USAGE) from error


def print_any_name() -> None:
    """Signs that the terminal's or the pipe's encoding lacks are printed as escapes, not taken for a bad file."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def printable(text: str) -> str:
    """JSON with the escapes of JSON where the output's encoding lacks a sign."""
    try:
        text.encode(sys.stdout.encoding or "utf-8")
    except UnicodeEncodeError:
        return re.sub(r"[^\x00-\x7f]+", lambda found: json.dumps(found[0])[1:-1], text)
    return text


def read_lens(path: Path) -> Camera:
    """The interior of a camera file, its pose is not used; what had to be done to read it (a backward lens refitted)
    is said.
    """
    from windmark.io import read_camera_file

    content = read_camera_file(path)
    if content.note:
        note(path, content.note)
    return content.camera


def note(path: Path, text: str) -> None:
    """One line about a file, beside the result."""
    complain(f"{path}: {text}")


def complain(text: str) -> None:
    """One line for the user on the standard error; no run ends because it leads nowhere (any more)."""
    with suppress(OSError):
        typer.echo(laid(f"windmark: {text}", sys.stderr), err=True)


def laid(line: str, stream: Any) -> str:
    """A line for people: paths from the folder that they are in; on a terminal broken between words, the rest indented.

    A line with a path or a command to be copied stays whole, and so does everything in a pipe.
    """
    here = os.getcwd() + os.sep
    line = line.replace(here, "") if len(here) > 1 else line
    if _WHOLE.match(line) or not stream.isatty():
        return line
    width = max(shutil.get_terminal_size().columns, NARROWEST)
    indent = " " * (len(line) - len(line.lstrip()) + 2)
    return textwrap.fill(line, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)


class Narration:
    """Lines that a run prints while it works: it goes on where nobody can read them any more, and says so once."""

    def __init__(self) -> None:
        self._heard = True

    def __call__(self, line: str) -> None:
        """Print a line."""
        from windmark.io import reason

        if not self._heard:
            return
        try:
            typer.echo(laid(line, sys.stdout))
        except OSError as error:
            self._heard = False
            complain(f"standard output: cannot be written: {reason(error)}; the run goes on without it")


def notes(lengths: Lengths) -> None:
    """What is to be said of the length units of a job's files, once all are read."""
    for path, text in lengths.notes():
        note(path, text)


def recordings(items: Sequence[PictureFile]) -> list[str]:
    """What should be known of the recordings that pictures are frames of, said and given back."""
    from windmark.io import notes_of

    of = notes_of(items)
    for address, text in of:
        note(Path(address), text)
    return [f"{address}: {text}" for address, text in of]


@contextmanager
def result_folder(folder: Path, *, live: bool = False, resume: bool = False) -> Iterator[ResultFolder]:
    """`io.result_folder` of the verb at work: its manifest has the options, what it has to say goes to the user."""
    from windmark import io

    with io.result_folder(folder, about(folder), say=complain, live=live, resume=resume) as out:
        yield out


def write_summary(out: ResultFolder, record: Mapping[str, Any], *folders: Path) -> None:
    """``summary.json`` of a result, without private paths: those below ``folders``, the test's, are told from there."""
    from windmark import io
    from windmark.pipeline.private_paths import without_folders

    record = {key: value for key, value in record.items() if key != "folder"}
    io.write_json(out.place / "summary.json", without_folders(record, *folders, out.target))


def about(folder: Path) -> dict[str, Any]:
    """The verb and its options, without those that do not change the result: where it goes, how it is printed,
    whether it goes on with a run that was stopped.
    """
    context = get_current_context(silent=True)
    if context is None:
        return {}
    none = ("as_json", "resume")
    given = {k: v for k, v in context.params.items() if k not in none and v not in (None, folder)}
    words, at = [], context
    while at.parent is not None:  # the path of the command itself has what windmark was started by
        words.append(str(at.info_name))
        at = at.parent
    verb = " ".join(reversed(words)) or context.info_name
    return {"verb": verb, "options": {key: _plain(value, folder) for key, value in given.items()}}


def _plain(value: Any, folder: Path) -> Any:
    if isinstance(value, list | tuple):
        return [_plain(v, folder) for v in value]
    if isinstance(value, Path):
        from windmark.io.manifest import relative

        return relative(value, folder)
    return value if isinstance(value, bool | int | float) else str(value)


@contextmanager
def errors(as_json: bool, *, writes_inputs: bool = False) -> Iterator[None]:
    """Turn what went wrong into one clear message and the exit code of the conventions.

    2: wrong usage or bad file, in windmark's own words (`windmark.errors`); 130: interrupted. 3: anything else
    is a fault of windmark, which keeps its traceback and is never dressed as bad data.

    ``writes_inputs``: for a command that changes the project which it has read; others are kept from it.
    """
    from windmark.io import reason, witness
    from windmark.io.written import begin_command

    try:
        begin_command()
        # What is read before the result's folder is known belongs into its manifest, too.
        with nullcontext() if writes_inputs else witness():
            yield
    except KeyboardInterrupt as error:
        _fail(interrupted(error), INTERRUPTED, as_json)
    except (typer.Exit, typer.Abort):  # said already
        raise
    except FileNotFoundError as error:
        _fail(str(error), WRONG_USAGE, as_json)
    except OSError as error:
        of = "" if error.filename is None else f"{error.filename}: "
        _fail(f"{of}{reason(error)}", WRONG_USAGE, as_json)
    except MemoryError:
        _fail("not enough memory for this image or grid", WRONG_USAGE, as_json)
    except Exception as error:
        if isinstance(error, WindmarkError):
            _fail(str(error), WRONG_USAGE, as_json, error)
        _report_fault(error, as_json)


def interrupted(error: KeyboardInterrupt) -> str:
    """That a command was ended, and what it left: what it says itself, or else what is in its place already."""
    from windmark.io.written import written_before

    return f"interrupted; {str(error) or written_before() or 'nothing was written'}"


def _report_fault(error: Exception, as_json: bool) -> None:
    """A fault of windmark: its traceback, and what to do with it."""
    from windmark import __version__

    with suppress(OSError):
        typer.echo("".join(traceback.format_exception(error)), err=True, nl=False)
    what = f"{type(error).__name__}: {error}"
    report = "please report it, with the lines above, the command and, if you may, its files"
    _fail(f"a fault of windmark {__version__}, not of your data ({what}); {report}", FAULT, as_json)


def refuse(reason: str, as_json: bool, record: Mapping[str, Any] | None = None, next_step: str = "") -> None:
    """The data say no: print the reason, and what to do about it, leave with exit code 1."""
    if as_json:
        answer({**(record or {}), "error": reason}, True, [])
    complain(reason)
    _advise(next_step)
    raise typer.Exit(DATA_SAY_NO)


def _fail(message: str, code: int, as_json: bool, error: WindmarkError | None = None) -> None:
    record: dict[str, Any] = {"error": message}
    step = ""
    if error is not None:
        from windmark.pipeline.verdict.errors import error_verdict

        verdict = error_verdict(error)
        record["verdict"] = verdict.record()
        # That a file is to be corrected goes without saying.
        step = verdict.next_step if verdict.cause != "file" else ""
    if as_json:
        with suppress(OSError):  # what it is about counts more than that it cannot be printed
            typer.echo(printable(json.dumps(record)))
    complain(message)
    _advise(step)
    raise typer.Exit(code)


def _advise(next_step: str) -> None:
    if next_step:
        typer.echo(laid(printable(f"  next: {next_step}"), sys.stderr), err=True)


def exit_with(code: int) -> typer.Exit:
    """To be raised by a verb whose answer has been printed."""
    return typer.Exit(code)


def _lead_nowhere() -> None:
    """The standard output of this process leads nowhere from now on: what is left in its buffer is dropped quietly."""
    with suppress(OSError, ValueError):  # tests have streams without a number
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
