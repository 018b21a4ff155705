"""The command that follows the model through images. Heavy imports wait until a verb needs them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from windmark.app import console
from windmark.app.commands.grouped import INPUT, POSE, ranged, written
from windmark.app.commands.matching_options import Mask, MaxTime, Roles
from windmark.app.commands.options import (
    CameraFile,
    Channel,
    Finish,
    Json,
    Markers,
    MarkersGrid,
    MeritMax,
    Polarity,
    Radius,
    Resume,
    Seed,
    Unit,
)
from windmark.options.detection import CHANNEL, MERIT_MAX, POLARITY_OR_AUTO
from windmark.options.registration import MAX_TIME_S, SEED


def add(app: typer.Typer) -> None:
    """Add this command to ``app``."""
    app.command(
        epilog="Example: windmark track run12-*.tif -m markers.csv -c camera.json -r 3 --unit mm -o run12-track"
    )(track)


def track(
    images: Annotated[
        list[Path], typer.Argument(help="Images of one camera in the order in which they were taken, or its recording.")
    ],
    markers: Markers,
    camera: CameraFile,
    unit: Unit,
    grid: MarkersGrid = None,
    radius: Radius = None,
    polarity: Polarity = POLARITY_OR_AUTO.default,
    merit_max: MeritMax = MERIT_MAX.default,
    channel: Channel = CHANNEL.default,
    mask: Mask = None,
    roles: Roles = None,
    prior: Annotated[
        Path | None,
        typer.Option(
            "--prior", help="Camera file with a pose: the first one is near it (30 deg, 1.3).", rich_help_panel=POSE
        ),
    ] = None,
    frames: Annotated[
        Path | None,
        typer.Option(
            help="Table image,frame: the number of every image where frames were dropped.", rich_help_panel=INPUT
        ),
    ] = None,
    change_deg: Annotated[
        float, ranged("How much the rotation per frame changes from frame to frame.", above=0.0, most=180.0, panel=POSE)
    ] = (0.3),
    change_percent: Annotated[
        float,
        ranged(
            "How much the shift per frame changes, in percent of the markers' distance.",
            above=0.0,
            most=1000.0,
            panel=POSE,
        ),
    ] = 0.3,
    max_time: MaxTime = MAX_TIME_S.default,
    seed: Seed = SEED.default,
    output: Annotated[Path, written("Folder of the results.")] = Path("track"),
    resume: Resume = False,
    finish: Finish = False,
    as_json: Json = False,
) -> None:
    """Follow the model through images: pose and labels in each; bad images are flagged and stop nothing."""
    with console.errors(as_json):
        from windmark.app import track_verb
        from windmark.app.series_folder import how_to_go_on

        wishes = track_verb.Wishes(images, markers, camera, unit, roles, prior, frames, mask, output, grid)
        options = {
            "radius_px": tuple(radius) if radius else None, "polarity": polarity, "merit_max": merit_max,
            "channel": channel, "max_time_s": max_time, "seed": seed,
        }  # fmt: skip
        track_verb.follow_files(wishes, options, (change_deg, change_percent), how_to_go_on(resume, finish), as_json)
