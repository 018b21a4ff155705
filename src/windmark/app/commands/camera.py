"""Commands about cameras and what they saw of the markers. Heavy imports wait until a verb needs them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from windmark.app import console
from windmark.app.commands import calibrate as calibrate_command
from windmark.app.commands import convert as convert_command
from windmark.app.commands import reconstruct as reconstruct_command
from windmark.app.commands.grouped import INPUT, LENS, OUTPUT, ranged, written
from windmark.app.commands.options import Json


def add(app: typer.Typer) -> None:
    """Add these commands to ``app``."""
    app.command(epilog=convert_command.EPILOG)(convert_command.convert)
    app.command(
        epilog="Examples: windmark calibrate matches.csv -m rough.csv --size 3004x2000 --datum free --unit mm;"
        " windmark calibrate photos/*.jpg -m rough.csv -r 3 --datum fixed:A,B,C,D --unit mm"
    )(calibrate_command.calibrate)
    app.command(
        epilog="Example: windmark reconstruct photos/*.jpg -c camera.json -p primary.csv --unit mm --pair IMG01 IMG02"
    )(reconstruct_command.reconstruct)
    app.command(epilog="Example: windmark undistort run12.tif -c camera.json --magnify 3 --field --picture")(undistort)


def undistort(
    images: Annotated[list[Path], typer.Argument(help="Images of one camera; stacks page by page.")],
    camera: Annotated[
        Path,
        typer.Option("--camera", "-c", help="Camera with its lens, of any format of convert.", rich_help_panel=INPUT),
    ],
    keep: Annotated[
        str,
        typer.Option(
            help="size (of the original), all (as large as it takes to hold every pixel), filled (no empty pixels).",
            rich_help_panel=LENS,
        ),
    ] = "size",
    magnify: Annotated[
        float | None,
        ranged("Also draw the images with so many times their distortion.", above=0.0, most=1000.0, panel=LENS),
    ] = None,
    field: Annotated[
        bool, typer.Option("--field", help="Also draw the distortion over the sensor.", rich_help_panel=OUTPUT)
    ] = False,
    picture: Annotated[
        bool,
        typer.Option(
            "--picture",
            help="Also draw each image as taken, corrected and magnified, side by side.",
            rich_help_panel=OUTPUT,
        ),
    ] = False,
    output: Annotated[Path, written("Folder of the results.")] = Path("undistorted"),
    as_json: Json = False,
) -> None:
    """Undo the lens: corrected images, and the camera without distortion that fits them."""
    with console.errors(as_json):
        from windmark.app import undistort_verb

        wishes = undistort_verb.Wishes(keep, magnify, field, picture, output)
        undistort_verb.undistort(images, camera, wishes, as_json)
