"""Types of the options of ``windmark calibrate``, with their help."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Texts = list[str] | None

Inputs = Annotated[
    list[Path],
    typer.Argument(
        help="A table of matches (CSV: image,name,x,y[,sigma_x,sigma_y][,camera][,frame]), or pictures or "
        "recordings, in which the markers (or, with --board, the dots) are found."
    ),
]
Markers = Annotated[
    Path | None, typer.Option("--markers", "-m", help="Rough coordinates: CSV or .tgts. Not with --board.")
]
Unit = Annotated[str, typer.Option("--unit", help="Length unit of the markers or of the pitch: in, ft, mm, cm, m.")]
Datum = Annotated[
    str | None,
    typer.Option(
        help="What fixes position, direction and size; no default. free[:A,B,C], fixed[:A,B,C,D], or"
        " weighted[:A,B,C][=sigma]. [with --board: the board's own grid]"
    ),
]
ControlCov = Annotated[
    Path | None,
    typer.Option(
        "--control-cov",
        help="With --datum weighted: joint covariance of known markers, first,second,xx,xy,...,zz for each pair.",
    ),
]
Cameras = Annotated[
    Texts,
    typer.Option("--camera", "-c", help="Start values; several cameras as NAME=FILE, images' names begin with NAME."),
]
ImagesOf = Annotated[
    Texts,
    typer.Option(
        "--images-of",
        help="NAME=PATTERN, such as left='*_0': the images of this camera, by name; for each of several cameras. What "
        "stands for * is the instant.",
    ),
]
Size = Annotated[str | None, typer.Option(help="WIDTHxHEIGHT of the pictures, where there is no --camera.")]
Focal = Annotated[
    float | None,
    typer.Option(help="Rough focal length in pixels. [default: found; in pictures from 0.33 to 3 widths]"),
]
Lens = Annotated[
    str | None,
    typer.Option(
        help="Free parameters: pinhole, radial, brown (then +k3), rational or fisheye, then +tilts. [default: "
        "brown; where that does not fit, or the lens is wider than 90 deg, the one the marks speak for]"
    ),
]
Parameters = Annotated[
    str | None,
    typer.Option(help="Free parameters one by one: focal_px,aspect,cx,cy,k1,k2,k3,p1,p2,tilt_x,tilt_y,k4,k5,k6."),
]
PriorSigma = Annotated[Texts, typer.Option(help="PARAMETER=SIGMA: known so well round its start value; several times.")]
FreeFocal = Annotated[
    Texts, typer.Option(help="Picture with a focal length of its own (another focus distance); several times.")
]
Distances = Annotated[
    Texts, typer.Option("--distance", help="A,B,length,sigma: known distance of two markers; several times.")
]
Rig = Annotated[
    bool, typer.Option("--rig", help="Several cameras that do not move against each other; frames are instants.")
]
Eccentricity = Annotated[
    str,
    typer.Option(
        help="Of imaged discs: auto (normals from ellipses in pictures, the table or the neighbours), table or off."
    ),
]
Reject = Annotated[bool, typer.Option("--reject/--no-reject", help="Leave gross errors out.")]
MaxSigma0 = Annotated[float, typer.Option(help="Residuals so many times larger than the sigmas are refused.")]
SigmaPx = Annotated[float, typer.Option(help="Of marks whose table has no sigma, per coordinate.")]
Against = Annotated[
    Path | None, typer.Option(help="Results of another set of pictures of these markers: compare with them.")
]
BoardPitch = Annotated[
    float | None,
    typer.Option(
        "--board", help="Pictures of a regular board of dots instead of --markers: from column to column, in --unit."
    ),
]
BoardMarks = Annotated[
    str | None,
    typer.Option(
        help="Dots that are not like the others, so that the board can be measured: holes:0,0:5,0:0,3 (column,row of "
        "rings; rows count downwards), large:... or small:...  [default: none; the grid is held as it should be]"
    ),
]
BoardSize = Annotated[
    str | None, typer.Option(help="COLUMNSxROWS of the board; of a staggered one in half pitches. [default: found]")
]
BoardLayout = Annotated[
    str, typer.Option(help="square; staggered: dots only where column + row is even. With rows apart: staggered:1.73.")
]
Radius = Annotated[
    list[float] | None,
    typer.Option("--radius", "-r", help="Pictures: marker radius in pixels; several for a range. [default: found]"),
]
Polarity = Annotated[str, typer.Option(help="Pictures: dark or bright markers.")]
MeritMax = Annotated[float, typer.Option(help="Pictures: largest merit of a marker.")]
Channel = Annotated[str, typer.Option(help="Pictures: grey, red, green or blue.")]
Bayer = Annotated[str | None, typer.Option(help="Pictures: raw mosaic, RGGB, BGGR, GRBG or GBRG.")]
Label = Annotated[
    Texts, typer.Option(help="Pictures: IMAGE:NAME=x,y, this marker is there (within 10 px); several times.")
]
Labels = Annotated[Path | None, typer.Option(help="Pictures: the same as a table image,name,x,y.")]
Tolerance = Annotated[
    float | None, typer.Option(help="Pictures: how far rough markers may be off. [default: 0.3 of their spacing]")
]
MaxTime = Annotated[float, typer.Option(help="Pictures: seconds of CPU time per matching.")]
Solver = Annotated[
    str,
    typer.Option(
        help="newton, or steps: the paper's own growing and shrinking steps per parameter, to compare; hundreds of"
        " times slower, and a valley of focal length and distance may hold it up."
    ),
]
Seed = Annotated[int, typer.Option(help="Seed of every random choice: same seed, same result.")]
Output = Annotated[Path, typer.Option("--output", "-o", help="Folder of the results.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON, for machines.")]
