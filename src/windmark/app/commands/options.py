"""Options that several commands have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON, for machines.")]
Radius = Annotated[
    list[float] | None,
    typer.Option(
        "--radius", "-r", help="Marker radius in pixels; several times for a range. [default: found in the image]"
    ),
]
Polarity = Annotated[
    str,
    typer.Option(
        help="dark (markers on paint), bright (warm ones in infrared), or auto: bright where dark ones are not there."
    ),
]
MeritMax = Annotated[float, typer.Option(help="Largest merit of a marker; 0 is a perfect inverse top-hat.")]
Markers = Annotated[Path, typer.Option("--markers", "-m", help="Marker table: CSV or .tgts.")]
CameraFile = Annotated[
    Path,
    typer.Option("--camera", "-c", help="Camera: windmark, OpenCV, NASA, COLMAP, mrcal, Metashape ... (see convert)."),
]
GridFile = Annotated[Path, typer.Option("--grid", "-g", help="Surface grid: PLOT3D, STL, OBJ, PLY, VTK.")]
Unit = Annotated[str, typer.Option("--unit", help="Length unit of markers and grid: in, ft, mm, cm, m.")]
Resume = Annotated[bool, typer.Option("--resume", help="Go on with a run that was stopped, from its last frame.")]
Finish = Annotated[
    bool, typer.Option("--finish", help="End a run that was stopped: results of the frames that it has measured.")
]
Seed = Annotated[int, typer.Option(help="Seed of every random choice: same seed, same result.")]
