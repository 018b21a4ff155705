"""Commands of deformation tests. Heavy imports wait until a verb needs them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from windmark.app import console
from windmark.app.commands.grouped import CAMERAS, LIVE, ranged, written
from windmark.app.commands.options import Finish, Json, Resume
from windmark.errors import UsageError


def add(app: typer.Typer) -> None:
    """Add these commands to ``app``."""
    app.command(
        epilog="Example: windmark deform deform.toml. Live: windmark deform deform.toml --watch incoming --idle 10"
    )(deform)


def deform(
    project: Annotated[Path, typer.Argument(help="Project file (TOML) of a deformation test.")],
    output: Annotated[Path | None, written("Folder instead of the project's own.")] = None,
    camera: Annotated[
        list[str] | None,
        typer.Option(
            "--camera",
            help="Only this one of the project's cameras; several times for several.",
            rich_help_panel=CAMERAS,
        ),
    ] = None,
    moves: Annotated[
        list[str] | None,
        typer.Option(
            "--moves",
            help="This camera moves; markers on walls hold it. Several times for several.",
            rich_help_panel=CAMERAS,
        ),
    ] = None,
    watch: Annotated[
        Path | None,
        typer.Option(help="Live: a folder that the cameras' images appear in; Ctrl-C ends.", rich_help_panel=LIVE),
    ] = None,
    idle: Annotated[
        float | None, ranged("Live: end when nothing has come for so many seconds.", above=0.0, panel=LIVE)
    ] = None,
    frames: Annotated[int | None, ranged("Live: end after so many frames.", least=1, panel=LIVE)] = None,
    resume: Resume = False,
    finish: Finish = False,
    as_json: Json = False,
) -> None:
    """Model deformation from one camera or several: laws, rigid motion, twist and bending, frame by frame."""
    with console.errors(as_json):
        from windmark.app import deform_verb
        from windmark.app.series_folder import how_to_go_on
        from windmark.pipeline.deform.project import Changes

        changed = Changes(output, tuple(camera or ()), tuple(moves or ()))
        if watch is None and (idle is not None or frames is not None):
            raise UsageError("--idle and --frames belong to --watch")
        live = None if watch is None else deform_verb.Live(watch, idle, frames)
        deform_verb.deform(project, changed, live, how_to_go_on(resume, finish, watch), as_json)
