"""The command of infrared runs. Heavy imports wait until it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from windmark.app import console
from windmark.app.commands.grouped import written
from windmark.app.commands.options import Finish, Json, Resume


def add(app: typer.Typer) -> None:
    """Add the command to ``app``."""
    app.command(epilog="Example: windmark infrared infrared.toml")(infrared)


def infrared(
    project: Annotated[Path, typer.Argument(help="Project file (TOML) of an infrared run.")],
    output: Annotated[Path | None, written("Folder instead of the project's own.")] = None,
    resume: Resume = False,
    finish: Finish = False,
    as_json: Json = False,
) -> None:
    """Infrared: frames of a run to temperature and heat flux on the moving model, each with its sigma."""
    with console.errors(as_json):
        from windmark.app import infrared_verb
        from windmark.app.series_folder import how_to_go_on

        infrared_verb.infrared(project, output, how_to_go_on(resume, finish), as_json)
