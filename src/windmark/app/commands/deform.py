"""Commands of deformation tests. Heavy imports wait until a verb needs them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from windmark.app import console
from windmark.app.commands.options import Json
from windmark.errors import UsageError


def add(app: typer.Typer) -> None:
    """Add these commands to ``app``."""
    app.command(
        epilog="Example: windmark deform deform.toml. Live: windmark deform deform.toml --watch incoming --idle 10"
    )(deform)


def deform(
    project: Annotated[Path, typer.Argument(help="Project file (TOML) of a deformation test.")],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Folder instead of the project's own.")] = None,
    camera: Annotated[
        list[str] | None,
        typer.Option("--camera", help="Only this one of the project's cameras; several times for several."),
    ] = None,
    moves: Annotated[
        list[str] | None,
        typer.Option("--moves", help="This camera moves; markers on walls hold it. Several times for several."),
    ] = None,
    watch: Annotated[
        Path | None, typer.Option(help="Live: a folder that the cameras' images appear in; Ctrl-C ends.")
    ] = None,
    idle: Annotated[float | None, typer.Option(help="Live: end when nothing has come for so many seconds.")] = None,
    frames: Annotated[int | None, typer.Option(help="Live: end after so many frames.")] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with a run that was stopped, from its last frame.")
    ] = False,
    finish: Annotated[
        bool, typer.Option("--finish", help="End a run that was stopped: results of the frames that it has measured.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Model deformation from one camera or several: laws, rigid motion, twist and bending, frame by frame."""
    with console.errors(as_json):
        from windmark.app import deform_verb
        from windmark.pipeline.deform.project import Changes

        changed = Changes(output, tuple(camera or ()), tuple(moves or ()))
        if watch is None and (idle is not None or frames is not None):
            raise UsageError("--idle and --frames belong to --watch")
        if (resume and finish) or (finish and watch is not None):
            raise UsageError("--finish measures no more: leave out --resume and --watch")
        live = None if watch is None else deform_verb.Live(watch, idle, frames)
        deform_verb.deform(project, changed, live, "resume" if resume else "finish" if finish else "", as_json)
