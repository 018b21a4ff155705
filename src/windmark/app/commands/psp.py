"""The command of paint tests. Heavy imports wait until it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from windmark.app import console
from windmark.app.commands.options import Finish, Json, Resume


def add(app: typer.Typer) -> None:
    """Add the command to ``app``."""
    app.command(epilog="Example: windmark psp psp.toml --threads 2")(psp)


def psp(
    project: Annotated[Path, typer.Argument(help="Project file (TOML) of a paint test.")],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Folder instead of the project's own.")] = None,
    threads: Annotated[int, typer.Option(help="Points that are reduced at a time.", min=1, max=64)] = 1,
    resume: Resume = False,
    finish: Finish = False,
    as_json: Json = False,
) -> None:
    """Pressure-sensitive paint: pictures of a polar to pressure, Cp, loads and sections, each with its sigma."""
    with console.errors(as_json):
        from windmark.app import psp_verb
        from windmark.app.series_folder import how_to_go_on

        psp_verb.psp(project, output, threads, how_to_go_on(resume, finish), as_json)
