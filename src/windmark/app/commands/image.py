"""Commands that work on images: markers, poses, views. Heavy imports wait until a verb needs them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from windmark.app import console
from windmark.app.commands.grouped import INPUT, LOOK, OUTPUT, VALUES, ranged, told, written
from windmark.app.commands.matching_options import (
    Binding,
    Exclude,
    FreeFocal,
    Label,
    Mask,
    MaxTime,
    Method,
    Offset,
    Prior,
    PriorMaxAngle,
    PriorMaxScale,
    Quantity,
    QuantityUnit,
    Roles,
    Scale,
    Tolerance,
    VolumeParts,
    detect_settings,
    grid_settings,
    image_settings,
    markers_settings,
    register_settings,
    values_settings,
)
from windmark.app.commands.options import (
    Bayer,
    CameraFile,
    Channel,
    GridFile,
    Json,
    Markers,
    MarkersGrid,
    MeritMax,
    Polarity,
    Radius,
    Seed,
    Unit,
)
from windmark.errors import UsageError
from windmark.options.detection import (
    BAYER,
    CHANNEL,
    MERIT_MAX,
    PHOTOMETRY,
    POLARITY_OR_AUTO,
    REFINE,
    SEARCH_PX,
)
from windmark.options.registration import (
    BINDING,
    FREE_FOCAL,
    MAX_TIME_S,
    METHOD,
    PRIOR_MAX_ANGLE_DEG,
    PRIOR_MAX_SCALE,
    SEED,
    TOLERANCE_PX,
)


def add(app: typer.Typer) -> None:
    """Add these commands to ``app``."""
    app.command(
        epilog="Example: windmark detect run12.tif --radius 3 --report spots.html --explain rejected.csv."
        " Tracking: windmark detect run13.tif --near detections.csv -o run13.csv, or"
        " windmark detect run13.tif --camera run12-registration/run12/camera.json --markers markers.csv"
    )(detect)
    app.command(epilog="Example: windmark register run12.tif -m markers.csv -c camera.json -r 3 --unit mm")(register)
    app.command(
        epilog="Example: windmark resect run12.tif -c run12-registration/run12/camera.json -g wing.grid --unit mm"
        " --points taps.tgts"
    )(resect)


def detect(
    images: Annotated[list[Path], typer.Argument(help="Images; recordings; frames: run.cine[120].")],
    radius: Radius = None,
    polarity: Polarity = POLARITY_OR_AUTO.default,
    merit_max: MeritMax = MERIT_MAX.default,
    refine: Annotated[str, told(REFINE, panel=LOOK)] = REFINE.default,
    photometry: Annotated[str | None, told(PHOTOMETRY, panel=LOOK)] = PHOTOMETRY.default,
    mask: Mask = None,
    roi: Annotated[
        str | None,
        typer.Option(help="x0,y0,x1,y1: first and last column and row that are used; else all.", rich_help_panel=LOOK),
    ] = None,
    output: Annotated[Path, written("Table of the spots, CSV.")] = Path("detections.csv"),
    picture: Annotated[
        Path | None,
        typer.Option(help="Also draw the spots (PNG); several images get a number each.", rich_help_panel=OUTPUT),
    ] = None,
    explain: Annotated[
        Path | None,
        typer.Option(
            help="Table of the rejected candidates with the reason; --picture draws them too.", rich_help_panel=OUTPUT
        ),
    ] = None,
    merit_map: Annotated[
        Path | None, typer.Option(help="Also draw the merit of every pixel (PNG).", rich_help_panel=OUTPUT)
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(
            help="Also write a page (HTML): verdict, pictures that zoom, spots, what was rejected and why.",
            rich_help_panel=OUTPUT,
        ),
    ] = None,
    channel: Channel = CHANNEL.default,
    bayer: Bayer = BAYER.default,
    near: Annotated[
        Path | None,
        typer.Option(
            help="Detections of a frame before: look only near them, with their ellipses; finds faint markers.",
            rich_help_panel=LOOK,
        ),
    ] = None,
    camera: Annotated[
        Path | None,
        typer.Option(
            "--camera", "-c", help="Camera with a pose: look only where it shows the --markers.", rich_help_panel=LOOK
        ),
    ] = None,
    markers: Annotated[
        Path | None,
        typer.Option(
            "--markers", "-m", help="Marker table, with the camera's length unit and frame.", rich_help_panel=LOOK
        ),
    ] = None,
    search_px: Annotated[float, told(SEARCH_PX, panel=LOOK)] = SEARCH_PX.default,
    as_json: Json = False,
) -> None:
    """Find markers in images: centres, covariances, merit.

    Anywhere; or near expected places (--near, or --camera with --markers), where the predicted ellipse is fitted and
    each marker is decided by its own false-alarm number: --merit-max and --refine do not matter then.
    """
    with console.errors(as_json):
        from windmark.app import detect_verb, guided_verb

        options = {"polarity": polarity, "merit_max": merit_max, "refine": refine, "photometry": photometry}
        wishes = detect_verb.Wishes(
            options, tuple(radius or ()), mask, detect_verb.parse_roi(roi), output, picture, explain, merit_map,
            report, channel, bayer,
        )  # fmt: skip
        guide = guided_verb.Guide(near, camera, markers, search_px)
        if guide:
            guided_verb.detect(images, wishes, guide, as_json)
        else:
            detect_verb.detect(images, wishes, as_json)


def register(
    image: Annotated[Path, typer.Argument(help="The image, or a frame of a recording: run.cine[120].")],
    markers: Markers,
    camera: CameraFile,
    unit: Unit,
    radius: Radius = None,
    polarity: Polarity = POLARITY_OR_AUTO.default,
    merit_max: MeritMax = MERIT_MAX.default,
    tolerance_px: Tolerance = TOLERANCE_PX.default,
    free_focal: FreeFocal = FREE_FOCAL.default,
    prior: Prior = None,
    prior_max_angle: PriorMaxAngle = PRIOR_MAX_ANGLE_DEG.default,
    prior_max_scale: PriorMaxScale = PRIOR_MAX_SCALE.default,
    label: Label = None,
    exclude: Exclude = None,
    binding: Binding = BINDING.default,
    roles: Roles = None,
    grid: MarkersGrid = None,
    method: Method = METHOD.default,
    max_time: MaxTime = MAX_TIME_S.default,
    mask: Mask = None,
    seed: Seed = SEED.default,
    output: Annotated[Path | None, written("Folder of the results. [default: IMAGE-registration]")] = None,
    as_json: Json = False,
) -> None:
    """Find which spot is which marker and where the camera was; no start pose is needed."""
    from windmark.app import verbs
    from windmark.io import one_picture, picture_name

    with console.errors(as_json):
        image = one_picture(image)
        settings: dict[str, Any] = {
            "title": f"Registration of {image.name}",
            "length_unit": unit,
            "camera": [{"file": camera}],
            "image": [image_settings(image, label, exclude)],
            "markers": markers_settings(markers, roles, grid),
            "detect": detect_settings(radius, polarity, merit_max, mask),
            "register": register_settings(
                seed,
                max_time,
                prior,
                prior_max_angle,
                prior_max_scale,
                tolerance_px=tolerance_px,
                free_focal=free_focal,
                method=method,
                binding=binding,
            ),
            "output": {"folder": output or Path(f"{picture_name(image)}-registration"), "nodes": ()},
        }
        verbs.run_settings(settings, as_json)


def resect(
    image: Annotated[Path, typer.Argument(help="The image, or a frame of a recording: run.cine[120].")],
    camera: Annotated[
        Path, typer.Option("--camera", "-c", help="Camera with a pose, as register writes it.", rich_help_panel=INPUT)
    ],
    grid: GridFile,
    unit: Unit,
    volume: VolumeParts = None,
    markers: Annotated[
        Path | None,
        typer.Option(
            "--markers",
            "-m",
            help="Marker table: zones that bear markers of role wall, and none of the model, take no"
            " part, for the camera's pose is that of the model. Not with --volume.",
            rich_help_panel=INPUT,
        ),
    ] = None,
    output: Annotated[Path | None, written("Folder of the results. [default: IMAGE-resection]")] = None,
    nodes: Annotated[
        list[str] | None,
        typer.Option(
            help="Formats of the node values: vtk, tecplot, plot3d, csv, netcdf. [default: all]", rich_help_panel=OUTPUT
        ),
    ] = None,
    max_obliquity_deg: Annotated[
        float, ranged("Surface seen more obliquely than this gets no value.", above=0.0, most=90.0, panel=VALUES)
    ] = 80,
    quantity: Quantity = None,
    quantity_unit: QuantityUnit = None,
    scale: Scale = 1.0,
    offset: Offset = 0.0,
    pixels: Annotated[
        bool,
        typer.Option(
            "--pixels", help="Also the surface point behind every pixel: pixels.nc (NetCDF).", rich_help_panel=OUTPUT
        ),
    ] = False,
    points: Annotated[
        list[Path] | None,
        typer.Option(
            help="Points at which values are wanted: taps of a .tgts file, or CSV name,x,y,z[,nx,ny,nz].",
            rich_help_panel=VALUES,
        ),
    ] = None,
    max_distance: Annotated[
        float | None,
        typer.Option(
            help="How far --points may be from the surface. [default: 0.002 of the grid's size]", rich_help_panel=VALUES
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Map a registered image onto the grid: values on nodes and at points, pictures."""
    from windmark.app import verbs
    from windmark.io import one_picture, picture_name

    with console.errors(as_json):
        image = one_picture(image)
        if markers is not None and volume:
            raise UsageError("--markers tells the walls of the grid, and --volume names what takes part: one of them")
        settings: dict[str, Any] = {
            "title": f"Resection of {image.name}",
            "length_unit": unit,
            "camera": [{"file": camera, "pose": "known"}],
            "image": [{"file": image, **values_settings(quantity, quantity_unit, scale, offset)}],
            "markers": markers_settings(markers, None) if markers is not None else None,
            "grid": grid_settings(grid, volume) | ({"walls": "leave_out"} if markers is not None else {}),
            "resect": {"max_obliquity_deg": max_obliquity_deg},
            "points": [{"file": path, "max_distance": max_distance} for path in points or ()],
            "output": {"folder": output or Path(f"{picture_name(image)}-resection"), "pixels": pixels}
            | ({"nodes": nodes} if nodes else {}),
        }
        verbs.run_settings(settings, as_json)
