"""The command line as a whole: patterns in its words, and what is wrong with its options."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import typer

from windmark.app import console

try:  # typer has a click of its own since 0.26
    from typer._click.exceptions import ClickException
except ImportError:
    from click import ClickException  # type: ignore[assignment]


def command_line(app: Callable[..., Any], as_json: bool) -> int:
    """Run the command line. Wrong options are said with what was given; under ``--json`` on standard output, too."""
    try:
        code = app(standalone_mode=False)
    except ClickException as error:
        error.message = _with_what_was_given(error)
        if as_json:
            from windmark.pipeline.verdict.errors import usage_verdict

            said = error.format_message()
            command = getattr(getattr(error, "ctx", None), "command_path", "windmark")
            with suppress(OSError):
                record = {"error": said, "verdict": usage_verdict(said, command).record()}
                typer.echo(console.printable(json.dumps(record)))
        error.show()
        return int(error.exit_code)
    except typer.Abort:
        return console.INTERRUPTED
    return code if isinstance(code, int) else console.DONE


_NOT_A_NUMBER = {"float_parsing": "a number", "int_parsing": "a whole number", "int_from_float": "a whole number"}


def _with_what_was_given(error: ClickException) -> str:
    """The message of a wrong option with its value, which Typer (pydantic) leaves out."""
    errors = getattr(error.__cause__, "errors", None)
    if errors is None or not (found := errors()):
        return error.message
    given, kind = found[0].get("input"), found[0].get("type")
    expected = f"expected {_NOT_A_NUMBER[kind]}" if kind in _NOT_A_NUMBER else error.message
    return f"{expected}, not {given!r}"


def expanded(words: list[str]) -> list[str]:
    """Arguments with the patterns in them expanded, where the shell has not done so (Windows); natural order.

    Values of options stay as they are, for some are patterns themselves; so does what matches nothing.
    """
    if sys.platform != "win32":
        return words
    return matched(words)


def matched(words: list[str]) -> list[str]:
    """See `expanded`, on every system."""
    from glob import glob, has_magic

    out: list[str] = []
    for before, word in zip(["", *words], words, strict=False):
        plain = not word.startswith("-") and not before.startswith("-") and has_magic(word) and not Path(word).exists()
        found = sorted(glob(word), key=_natural) if plain else []
        out += found or [word]
    return out


def _natural(text: str) -> list[tuple[int, str]]:
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", text)]
