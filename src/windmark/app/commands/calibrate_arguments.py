"""Types of the options of ``windmark calibrate``, with their help."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from windmark.app.commands.grouped import ADJUSTMENT, BOARD, DATUM, INPUT, LENS, MATCH, OUTPUT, ranged, told, written
from windmark.options import calibration

Texts = list[str] | None

Inputs = Annotated[
    list[Path],
    typer.Argument(
        help="A table of matches (CSV: image,name,x,y[,sigma_x,sigma_y][,camera][,frame]), or pictures or "
        "recordings, in which the markers (or, with --board, the dots) are found."
    ),
]
Markers = Annotated[
    Path | None,
    typer.Option("--markers", "-m", help="Rough coordinates: CSV or .tgts. Not with --board.", rich_help_panel=INPUT),
]
Unit = Annotated[
    str,
    typer.Option(
        "--unit", help="Length unit of the markers or of the pitch: in, ft, mm, cm, m.", rich_help_panel=INPUT
    ),
]
Datum = Annotated[
    str | None,
    typer.Option(
        help="What fixes position, direction and size; no default. free[:A,B,C], fixed[:A,B,C,D], or"
        " weighted[:A,B,C][=sigma]. [with --board: the board's own grid]",
        rich_help_panel=DATUM,
    ),
]
ControlCov = Annotated[
    Path | None,
    typer.Option(
        "--control-cov",
        help="With --datum weighted: joint covariance of known markers, first,second,xx,xy,...,zz for each pair.",
        rich_help_panel=DATUM,
    ),
]
Cameras = Annotated[
    Texts,
    typer.Option(
        "--camera",
        "-c",
        help="Start values; several cameras as NAME=FILE, images' names begin with NAME.",
        rich_help_panel=INPUT,
    ),
]
ImagesOf = Annotated[
    Texts,
    typer.Option(
        "--images-of",
        help="NAME=PATTERN, such as left='*_0': the images of this camera, by name; for each of several cameras. What "
        "stands for * is the instant.",
        rich_help_panel=INPUT,
    ),
]
Size = Annotated[
    str | None, typer.Option(help="WIDTHxHEIGHT of the pictures, where there is no --camera.", rich_help_panel=INPUT)
]
Focal = Annotated[
    float | None,
    ranged("Rough focal length in pixels. [default: found; in pictures from 0.33 to 3 widths]", above=0.0, panel=INPUT),
]
Lens = Annotated[
    str | None,
    typer.Option(
        help="Free parameters: pinhole, radial, brown (then +k3), rational or fisheye, then +tilts, +shear. "
        "[default: brown; where that does not fit, or the lens is wider than 90 deg, the one the marks speak for]",
        rich_help_panel=LENS,
    ),
]
Parameters = Annotated[
    str | None,
    typer.Option(
        help="Free parameters one by one: focal_px,aspect,cx,cy,k1,k2,k3,p1,p2,tilt_x,tilt_y,k4,k5,k6,shear.",
        rich_help_panel=LENS,
    ),
]
PriorSigma = Annotated[
    Texts,
    typer.Option(
        help="PARAMETER=SIGMA: known so well round its start value; focus=0.003: focal lengths of --free-focal "
        "pictures differ by 0.3 % (1 sigma); principal=10: principal points of --free-principal pictures by 10 px; "
        "several times.",
        rich_help_panel=LENS,
    ),
]
FreeFocal = Annotated[
    Texts,
    typer.Option(
        help="Picture with a focal length of its own (another focus distance); several times; all: a camera that "
        "focused by itself.",
        rich_help_panel=LENS,
    ),
]
FreePrincipal = Annotated[
    Texts,
    typer.Option(
        help="Picture with a principal point of its own (it was cut, or its lens stabilised or loose); several times; "
        "all: every picture.",
        rich_help_panel=LENS,
    ),
]
Distances = Annotated[
    Texts,
    typer.Option(
        "--distance", help="A,B,length,sigma: known distance of two markers; several times.", rich_help_panel=DATUM
    ),
]
Rig = Annotated[bool, told(calibration.RIG, panel=DATUM)]
Eccentricity = Annotated[str, told(calibration.ECCENTRICITY, panel=LENS)]
Reject = Annotated[bool, told(calibration.REJECT, panel=ADJUSTMENT)]
MaxSigma0 = Annotated[float, told(calibration.MAX_SIGMA0, panel=ADJUSTMENT)]
SigmaPx = Annotated[float, told(calibration.SIGMA_PX, panel=ADJUSTMENT)]
Against = Annotated[
    Path | None,
    typer.Option(
        help="Results of another set of pictures of these markers: compare with them.", rich_help_panel=OUTPUT
    ),
]
BoardPitch = Annotated[
    float | None,
    ranged(
        "Pictures of a regular board of dots instead of --markers: from column to column, in --unit.",
        "--board",
        above=0.0,
        panel=BOARD,
    ),
]
BoardMarks = Annotated[
    str | None,
    typer.Option(
        help="Dots that are not like the others, so that the board can be measured: holes:0,0:5,0:0,3 (column,row of "
        "rings; rows count downwards), large:... or small:...  [default: none; the grid is held as it should be]",
        rich_help_panel=BOARD,
    ),
]
BoardSize = Annotated[
    str | None,
    typer.Option(
        help="COLUMNSxROWS of the board; of a staggered one in half pitches. [default: found]", rich_help_panel=BOARD
    ),
]
BoardLayout = Annotated[
    str,
    typer.Option(
        help="square; staggered: dots only where column + row is even. With rows apart: staggered:1.73.",
        rich_help_panel=BOARD,
    ),
]
Label = Annotated[
    Texts,
    typer.Option(help="IMAGE:NAME=x,y, this marker is there (within 10 px); several times.", rich_help_panel=MATCH),
]
Labels = Annotated[Path | None, typer.Option(help="--label as a table image,name,x,y.", rich_help_panel=MATCH)]
Tolerance = Annotated[float | None, told(calibration.MATCH_TOLERANCE_PX, panel=MATCH)]
MaxTime = Annotated[float, told(calibration.MATCH_TIME_S, panel=MATCH)]
Solver = Annotated[str, told(calibration.SOLVER, panel=ADJUSTMENT)]
Output = Annotated[Path, written("Folder of the results.")]
