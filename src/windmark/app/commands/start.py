"""The commands that a test begins and ends with: init, check, verify, doctor, warmup. Heavy imports wait."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from windmark.app import console
from windmark.app.commands.options import Json


def add(app: typer.Typer) -> None:
    """Add these commands to ``app``."""
    app.command(epilog="Example: windmark init my-test --unit mm, or windmark init my-wing --for deform")(init)
    app.command(epilog="Example: windmark check my-test/project.toml")(check)
    app.command(epilog="Example: windmark verify my-test/results")(verify)
    app.command(epilog="Example: windmark doctor --json")(doctor)
    app.command(epilog="Example: windmark warmup")(warmup)


def init(
    folder: Annotated[Path, typer.Argument(help="Folder with pictures, marker table, camera file and grid.")],
    unit: Annotated[str | None, typer.Option("--unit", help="Length unit of markers and grid, if no file says it.")] = (
        None
    ),
    camera: Annotated[Path | None, typer.Option("--camera", "-c", help="Camera file of all pictures.")] = None,
    markers: Annotated[Path | None, typer.Option("--markers", "-m", help="Marker table, where there are several.")] = (
        None
    ),
    grid: Annotated[Path | None, typer.Option("--grid", "-g", help="Surface grid, where there are several.")] = None,
    title: Annotated[str | None, typer.Option(help="Title of the project. [default: the folder's name]")] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="The project file. [default: FOLDER/project.toml, /deform.toml]"),
    ] = None,
    verb: Annotated[
        str,
        typer.Option(
            "--for",
            help="run, deform, psp, infrared: a project of that verb; calibrate, reconstruct: the command line.",
        ),
    ] = "run",
    ask: Annotated[bool, typer.Option("--ask/--no-ask", help="Ask on a terminal for what is not clear.")] = True,
    as_json: Json = False,
) -> None:
    """A commented project file from a folder of pictures, tables, grids and cameras; says what is missing."""
    with console.errors(as_json):
        from windmark.app import init_verb

        given = {"unit": unit, "camera": camera, "markers": markers, "grid": grid}
        init_verb.init(folder, output, given, title, ask, as_json, verb)


def check(
    project: Annotated[Path, typer.Argument(help="Project file of any verb, or the folder that it is in.")],
    as_json: Json = False,
) -> None:
    """Read everything that a project names and list all that is wrong, with line and key, without running it."""
    with console.errors(as_json):
        from windmark.app import check_verb

        check_verb.check(project, as_json)


def verify(
    context: typer.Context,
    result: Annotated[Path, typer.Argument(help="Folder of a result (it has a manifest.json).")],
    keep: Annotated[Path | None, typer.Option(help="Keep what the second run gives in this new folder.")] = None,
    as_json: Json = False,
) -> None:
    """Run a result again and compare: inputs by their hashes, versions, numbers within a tenth of their sigma."""
    with console.errors(as_json):
        from windmark.app import verify_verb

        verify_verb.verify(context.find_root().command, result, keep, as_json)


def doctor(as_json: Json = False) -> None:
    """Versions, threads, display, browser, compiled kernels, folders that can be written: is all sound?"""
    with console.errors(as_json):
        from windmark.app import doctor_verb

        doctor_verb.doctor(as_json)


def warmup(
    processes: Annotated[
        int | None,
        typer.Option(min=1, help="How many rooms to compile at the same time. [default: one for each core, at most 3]"),
    ] = None,
    as_json: Json = False,
) -> None:
    """Compile everything once, with progress, so that no later run waits for it."""
    with console.errors(as_json):
        from windmark.app import doctor_verb

        doctor_verb.warmup(processes, as_json)
