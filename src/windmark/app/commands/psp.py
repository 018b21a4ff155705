"""The commands of paint tests. Heavy imports wait until it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from windmark.app import console
from windmark.app.commands.grouped import ranged, written
from windmark.app.commands.options import Json
from windmark.errors import UsageError


def add(app: typer.Typer) -> None:
    """Add these commands to ``app``."""
    app.command(epilog="Example: windmark psp psp.toml --threads 2")(psp)
    app.command(epilog="Example: windmark paint-calibrate paint-cell.csv -o paint.json")(paint_calibrate)


def psp(
    project: Annotated[Path, typer.Argument(help="Project file (TOML) of a paint test.")],
    output: Annotated[Path | None, written("Folder instead of the project's own.")] = None,
    threads: Annotated[
        int | None, typer.Option(help="Points that are reduced at a time. [default: 1]", min=1, max=64)
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Reduce the points on a dask.distributed cluster: tcp://HOST:PORT.")
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with a run that was stopped: reduce the points that it lacks.")
    ] = False,
    finish: Annotated[
        bool, typer.Option("--finish", help="End a run that was stopped: results of the points that it has reduced.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Pressure-sensitive paint: pictures of a polar to pressure, Cp, loads and sections, each with its sigma."""
    with console.errors(as_json):
        from windmark.app import psp_verb
        from windmark.app.series_folder import how_to_go_on

        if scheduler is not None and threads is not None:
            raise UsageError("--threads is of this machine; the workers of --scheduler have threads of their own")
        psp_verb.psp(project, output, threads or 1, how_to_go_on(resume, finish), as_json, scheduler=scheduler)


def paint_calibrate(
    table: Annotated[
        Path, typer.Argument(help="Cell measurements, CSV: pressure_UNIT, temperature_UNIT, ratio (I_ref/I)[, sigma].")
    ],
    output: Annotated[Path, written("The calibration, JSON; a picture goes beside it.")] = (Path("paint.json")),
    p_ref: Annotated[float, ranged("Pressure of I_ref, Pa.", above=0.0)] = 1e5,
    t_ref: Annotated[float, ranged("Temperature of I_ref, K.", above=50.0)] = 293.15,
    order: Annotated[
        str | None, typer.Option(help="Powers of pressure and temperature: 2,1. [default: by cross-validation]")
    ] = None,
    temperature: Annotated[
        bool, typer.Option("--temperature", help="A temperature paint: temperature_UNIT, ratio[, sigma] alone.")
    ] = False,
    as_json: Json = False,
) -> None:
    """A paint's calibration from measurements in a cell: the law with its covariance, for the key of a project."""
    with console.errors(as_json):
        from windmark.app import paint_verb

        paint_verb.paint_calibrate(table, output, p_ref, t_ref, order, temperature, as_json)
