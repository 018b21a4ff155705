"""Commands about cameras and what they saw of the markers. Heavy imports wait until a verb needs them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from windmark.app import console
from windmark.app.commands import calibrate as calibrate_command
from windmark.app.commands import reconstruct as reconstruct_command
from windmark.app.commands.options import Json


def add(app: typer.Typer) -> None:
    """Add these commands to ``app``."""
    app.command(epilog="Example: windmark convert camera.xml camera.json")(convert)
    app.command(
        epilog="Examples: windmark calibrate matches.csv -m rough.csv --size 3004x2000 --datum free --unit mm;"
        " windmark calibrate photos/*.jpg -m rough.csv -r 3 --datum fixed:A,B,C,D --unit mm"
    )(calibrate_command.calibrate)
    app.command(
        epilog="Example: windmark reconstruct photos/*.jpg -c camera.json -p primary.csv --unit mm --pair IMG01 IMG02"
    )(reconstruct_command.reconstruct)
    app.command(epilog="Example: windmark undistort run12.tif -c camera.json --magnify 3 --field --picture")(undistort)


def convert(
    source: Annotated[Path, typer.Argument(help="Camera file; a folder or cameras.txt is a COLMAP model.")],
    target: Annotated[
        Path,
        typer.Argument(
            help=".json windmark, .yml OpenCV, .cameramodel mrcal, .xml Metashape, .txt Australis, a name without"
            " extension: folder of a COLMAP model."
        ),
    ],
    from_format: Annotated[
        str | None, typer.Option("--from", help="Refuse other formats than this. [default: told by the content]")
    ] = None,
    to_format: Annotated[
        str | None,
        typer.Option(
            "--to", help="windmark, opencv (YAML or JSON), colmap, mrcal, metashape, australis. [default: by extension]"
        ),
    ] = None,
    size: Annotated[str | None, typer.Option(help="WIDTHxHEIGHT of the images, for files that do not say.")] = None,
    unit: Annotated[str | None, typer.Option(help="Length unit of the pose, for files that do not say.")] = None,
    pixel_mm: Annotated[
        list[float] | None, typer.Option(help="Pitch of the pixels in mm, for Australis; twice for x and y.")
    ] = None,
    which: Annotated[
        str | None, typer.Option(help="Of a COLMAP model: an image (with its pose) or a camera's number.")
    ] = None,
    no_pose: Annotated[bool, typer.Option("--no-pose", help="Leave the pose out.")] = False,
    as_json: Json = False,
) -> None:
    """Convert a camera file; what the other format cannot hold is refused, and the result is read back and compared."""
    with console.errors(as_json):
        from windmark.app import convert_verb

        wishes = convert_verb.Wishes(
            from_format, to_format, convert_verb.parse_size(size), unit, tuple(pixel_mm or ()), which, no_pose
        )
        convert_verb.convert(source, target, wishes, as_json)


def undistort(
    images: Annotated[list[Path], typer.Argument(help="Images of one camera; stacks page by page.")],
    camera: Annotated[Path, typer.Option("--camera", "-c", help="Camera with its lens, of any format of convert.")],
    keep: Annotated[
        str,
        typer.Option(
            help="size (of the original), all (as large as it takes to hold every pixel), filled (no empty pixels)."
        ),
    ] = "size",
    magnify: Annotated[
        float | None, typer.Option(help="Also draw the images with so many times their distortion.")
    ] = None,
    field: Annotated[bool, typer.Option("--field", help="Also draw the distortion over the sensor.")] = False,
    picture: Annotated[
        bool, typer.Option("--picture", help="Also draw each image as taken, corrected and magnified, side by side.")
    ] = False,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the results.")] = Path("undistorted"),
    as_json: Json = False,
) -> None:
    """Undo the lens: corrected images, and the camera without distortion that fits them."""
    with console.errors(as_json):
        from windmark.app import undistort_verb

        wishes = undistort_verb.Wishes(keep, magnify, field, picture, output)
        undistort_verb.undistort(images, camera, wishes, as_json)
