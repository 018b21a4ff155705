"""Options that several commands have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from windmark.app.commands.grouped import INPUT, LOOK, OUTPUT, told
from windmark.options import detection, registration

Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON, for machines.", rich_help_panel=OUTPUT)]
Radius = Annotated[list[float] | None, told(detection.RADIUS_PX, "--radius", "-r", panel=LOOK)]
Polarity = Annotated[str, told(detection.POLARITY_OR_AUTO, panel=LOOK)]
OnePolarity = Annotated[str, told(detection.POLARITY, panel=LOOK)]
MeritMax = Annotated[float, told(detection.MERIT_MAX, panel=LOOK)]
Channel = Annotated[str, told(detection.CHANNEL, panel=LOOK)]
Bayer = Annotated[str | None, told(detection.BAYER, panel=LOOK)]
Markers = Annotated[Path, typer.Option("--markers", "-m", help="Marker table: CSV or .tgts.", rich_help_panel=INPUT)]
CameraFile = Annotated[
    Path,
    typer.Option(
        "--camera", "-c", help="Camera: windmark, OpenCV, NASA, COLMAP, mrcal, Metashape ... (see convert).",
        rich_help_panel=INPUT,
    ),
]  # fmt: skip
GridFile = Annotated[
    Path, typer.Option("--grid", "-g", help="Surface grid: PLOT3D, STL, OBJ, PLY, VTK.", rich_help_panel=INPUT)
]
MarkersGrid = Annotated[
    Path | None,
    typer.Option(
        "--grid", "-g", rich_help_panel=INPUT,
        help="The surface that the markers lie on: on curved parts a disc's image is not centred on the disc.",
    ),
]  # fmt: skip
Unit = Annotated[
    str, typer.Option("--unit", help="Length unit of markers and grid: in, ft, mm, cm, m.", rich_help_panel=INPUT)
]
Resume = Annotated[
    bool,
    typer.Option("--resume", help="Go on with a run that was stopped, from its last frame.", rich_help_panel=OUTPUT),
]
Finish = Annotated[
    bool,
    typer.Option(
        "--finish", help="End a run that was stopped: results of the frames that it has measured.",
        rich_help_panel=OUTPUT,
    ),
]  # fmt: skip
Seed = Annotated[int, told(registration.SEED, panel=OUTPUT)]
