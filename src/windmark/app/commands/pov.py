"""The command `windmark pov`. Heavy imports wait until it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from windmark.app import console
from windmark.app.commands.grouped import DIRECTION, INPUT, LABELS, NUMBERS, OUTPUT, ranged, written
from windmark.app.commands.matching_options import VolumeParts, label_places
from windmark.app.commands.options import Json


def add(app: typer.Typer) -> None:
    """Add this command to ``app``."""
    app.command(
        epilog="Examples: windmark pov camera.json --picture pov.png; windmark pov camera.json other.json -g wing.grid;"
        " windmark pov --rx 180 --ry 0 --rz 0 --dx -200 --dy 300 --dz 2400 --fov 30 --size 1280x800 --unit mm"
        " -o top.json;"
        " windmark pov --direction 0,0,-1 --up 0,1,0 -g wing.grid --size 1280x800 --unit mm -o top.json;"
        " windmark pov camera.json -m markers.csv --label W01=503,768 --label W13=678,372 --label B01=210,912 --unit mm"
    )(pov)


Degrees = Annotated[float | None, typer.Option(help="Angle in degrees, any value.", rich_help_panel=NUMBERS)]
Length = Annotated[
    float | None, typer.Option(help="Distance along the camera's axis, in the length unit.", rich_help_panel=NUMBERS)
]


def pov(
    cameras: Annotated[
        list[Path] | None, typer.Argument(help="Camera file with a pose; a second one is compared with it.")
    ] = None,
    rx: Degrees = None,
    ry: Degrees = None,
    rz: Degrees = None,
    dx: Length = None,
    dy: Length = None,
    dz: Length = None,
    fov: Annotated[
        float | None, typer.Option(help="Full horizontal field of view, degrees.", rich_help_panel=NUMBERS)
    ] = None,
    size: Annotated[
        str | None, typer.Option(help="WIDTHxHEIGHT of the image in pixels.", rich_help_panel=INPUT)
    ] = None,
    unit: Annotated[
        str | None, typer.Option(help="Length unit: in, ft, mm, cm, m; where no file says it.", rich_help_panel=INPUT)
    ] = None,
    direction: Annotated[
        str | None,
        typer.Option(help="x,y,z: look along it, framed on the --grid or --markers.", rich_help_panel=DIRECTION),
    ] = None,
    up: Annotated[
        str | None,
        typer.Option(help="x,y,z: points to the top of the image; with --direction.", rich_help_panel=DIRECTION),
    ] = None,
    grid: Annotated[
        Path | None, typer.Option("--grid", "-g", help="Surface grid, to be framed and drawn.", rich_help_panel=INPUT)
    ] = None,
    volume: VolumeParts = None,
    markers: Annotated[
        Path | None,
        typer.Option("--markers", "-m", help="Marker table, to be framed and drawn.", rich_help_panel=INPUT),
    ] = None,
    label: Annotated[
        list[str] | None,
        typer.Option(
            "--label",
            help="NAME=x,y: this marker's spot. Three give every pose that shows them so, a fourth decides.",
            rich_help_panel=LABELS,
        ),
    ] = None,
    sigma_px: Annotated[float, ranged("Of the spots of --label, per coordinate.", above=0.0, panel=LABELS)] = 0.1,
    output: Annotated[Path | None, written("Write the point of view as a camera file (see convert).")] = None,
    picture: Annotated[
        Path | None,
        typer.Option(
            help="Draw the camera, the model's axes, the three angles and distances (PNG).", rich_help_panel=OUTPUT
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Print, convert and draw a point of view: three angles, three distances and the field of view.

    It is given by a camera file, by its seven numbers (which replace those of a file), by a direction, or by the spots
    of three and more markers. The model is turned by rx, ry, rz about the camera's x, y, z axis (right, down, ahead),
    in this order, and its origin is then dx, dy, dz along them.
    """
    with console.errors(as_json):
        from windmark.app import pov_verb

        numbers = {"rx_deg": rx, "ry_deg": ry, "rz_deg": rz, "dx": dx, "dy": dy, "dz": dz, "fov_deg": fov}
        wishes = pov_verb.Wishes(
            tuple(cameras or ()), {k: v for k, v in numbers.items() if v is not None}, size, unit, direction, up, grid,
            tuple(volume or ()), markers, output, picture,
        )  # fmt: skip
        if label:
            from windmark.app import pov_candidates_verb

            pov_candidates_verb.show(wishes, label_places(label), sigma_px, as_json)
        else:
            pov_verb.show(wishes, as_json)
