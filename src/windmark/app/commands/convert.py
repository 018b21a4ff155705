"""The command ``windmark convert``. Heavy imports wait until it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from windmark.app import console
from windmark.app.commands.grouped import CAMERAS, GRIDS, INPUT, LENGTHS, PICTURES, ranged
from windmark.app.commands.options import Json
from windmark.errors import UsageError

EPILOG = (
    "Examples: windmark convert camera.xml camera.json; windmark convert wing.grid wing.vtp --unit mm;"
    " windmark convert wing.grid wing-in.grid --unit mm --to-unit in --plot3d big,double;"
    " windmark convert targets.tgts markers.csv --unit in;"
    " windmark convert targets.txt markers.csv --columns name,x,y,z,-,- --unit mm;"
    " windmark convert run.cine run.h5 --frames 0:100;"
    " windmark convert a.tif b.tif stack.tif"
)


def convert(
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar="SOURCE... TARGET",
            help="What is converted, and what it becomes: told by content and extension. A camera becomes .json"
            " (windmark), .yml (OpenCV), .cameramodel (mrcal), .xml (Metashape), .txt (Australis), a name without"
            " extension (folder of a COLMAP model); a grid .grid .x .xyz ... (PLOT3D), .dat (Tecplot), .stl, .obj,"
            " .ply, .tri (Cart3D), .vtp, .vtm, .vtu, .vtk, .nc; a table of markers .csv or .tgts; a recording, or"
            " several pictures, a stack .tif, .h5, .nc, a film .avi, .mkv, or a folder.",
        ),
    ],
    said: Annotated[
        str | None,
        typer.Option(
            "--as",
            help="What the source is, where that is open: camera, grid, markers, pictures.",
            rich_help_panel=INPUT,
        ),
    ] = None,
    columns: Annotated[
        str | None,
        typer.Option(
            help="What the columns of a table of markers from elsewhere are, with commas: name,x,y,z and any of"
            " nx,ny,nz,radius,volume,role,sigma_x,sigma_y,sigma_z; - for one that is left out. Separated by"
            " semicolon, tab, comma or spaces; lines before the first row are left out.",
            rich_help_panel=INPUT,
        ),
    ] = None,
    unit: Annotated[
        str | None,
        typer.Option(
            help="Length unit of the source, for files that do not say: in, ft, mm, cm, m.", rich_help_panel=LENGTHS
        ),
    ] = None,
    to_unit: Annotated[
        str | None, typer.Option(help="Scale all lengths into this unit.", rich_help_panel=LENGTHS)
    ] = None,
    from_format: Annotated[
        str | None,
        typer.Option(
            "--from",
            help="Refuse other formats than this. [default: told by the content]",
            rich_help_panel=CAMERAS,
        ),
    ] = None,
    to_format: Annotated[
        str | None,
        typer.Option(
            "--to",
            help="windmark, opencv (YAML or JSON), colmap, mrcal, metashape, australis. [default: by extension]",
            rich_help_panel=CAMERAS,
        ),
    ] = None,
    size: Annotated[
        str | None,
        typer.Option(help="WIDTHxHEIGHT of the images, for files that do not say.", rich_help_panel=CAMERAS),
    ] = None,
    pixel_mm: Annotated[
        list[float] | None,
        ranged("Pitch of the pixels in mm, for Australis; twice for x and y.", above=0.0, panel=CAMERAS),
    ] = None,
    which: Annotated[
        str | None,
        typer.Option(help="Of a COLMAP model an image (with its pose) or a camera's number.", rich_help_panel=CAMERAS),
    ] = None,
    no_pose: Annotated[bool, typer.Option("--no-pose", help="Leave the pose out.", rich_help_panel=CAMERAS)] = False,
    volume: Annotated[
        list[str] | None,
        typer.Option(
            help="NAME=zone01,zone02 (or one zone's own name): what is kept; several times. Others are left out.",
            rich_help_panel=GRIDS,
        ),
    ] = None,
    volume_face: Annotated[
        str | None,
        typer.Option(
            help="Of PLOT3D volume blocks the surface: imin, imax, jmin, jmax, kmin, kmax.", rich_help_panel=GRIDS
        ),
    ] = None,
    orientation: Annotated[
        str | None,
        typer.Option(
            help="file (as they are) or auto (triangles turned outward). [default: file]", rich_help_panel=GRIDS
        ),
    ] = None,
    plot3d: Annotated[
        str | None,
        typer.Option(
            help="How PLOT3D is written: words of ascii, binary, little, big, records, records8, stream, whole,"
            " component, plane, single, double, iblank, no-iblank, multi-block, one-block, with commas."
            " [default: as the source, else binary,little,records,multi-block]",
            rich_help_panel=GRIDS,
        ),
    ] = None,
    from_plot3d: Annotated[
        str | None,
        typer.Option(
            help="How the source is stored, where its sizes leave it open; the same words.", rich_help_panel=GRIDS
        ),
    ] = None,
    values: Annotated[
        Path | None,
        typer.Option(help="PLOT3D function file with the values of a PLOT3D source.", rich_help_panel=GRIDS),
    ] = None,
    frames: Annotated[
        str | None,
        typer.Option(
            help="Which frames, first:stop:step as 0:100:2 or -10:, or one number.",
            rich_help_panel=PICTURES,
        ),
    ] = None,
    pictures: Annotated[
        str | None,
        typer.Option(help="tif or png, of the pictures in a folder. [default: tif]", rich_help_panel=PICTURES),
    ] = None,
    as_json: Json = False,
) -> None:
    """Turn cameras, surface grids, tables of markers, pictures and recordings into other formats.

    What the other format cannot hold is refused or said ("lost: ..."); the result is read back and compared.
    """
    with console.errors(as_json):
        from windmark.app import convert_verb

        if len(paths) < 2:
            raise UsageError(f"convert needs a source and a target, got {paths[0]} alone")
        typed = {
            "from_format": from_format, "to_format": to_format, "size": size, "unit": unit, "to_unit": to_unit,
            "pixel_mm": tuple(pixel_mm or ()), "which": which, "no_pose": no_pose, "volume": tuple(volume or ()),
            "volume_face": volume_face, "orientation": orientation, "plot3d": plot3d, "from_plot3d": from_plot3d,
            "values": values, "frames": frames, "pictures": pictures,
            "columns": tuple(columns.split(",")) if columns is not None else (),
        }  # fmt: skip
        convert_verb.convert(paths[:-1], paths[-1], convert_verb.Wishes(said, typed), as_json)
