"""The command `windmark view`. Heavy imports wait until it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from windmark.app import console


def add(app: typer.Typer) -> None:
    """Add this command to ``app``."""
    app.command(epilog="Example: windmark view project.toml")(view)


def view(
    project: Annotated[Path, typer.Argument(help="Project file of windmark run (TOML).")],
    port: Annotated[int, typer.Option(min=0, max=65535, help="Of this computer; 0: a free one.")] = 0,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")] = True,
) -> None:
    """Run a project and show it in the browser: name and exclude spots, move the point of view, run again.

    Names and exclusions are written into the project file. The page is for this computer only; Ctrl-C ends it.
    """
    with console.errors(False, writes_inputs=True):
        from windmark.app import view_verb

        view_verb.view(project, port, browser)
