"""The command `windmark align`: 3D with a camera and a grid, 2D without."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from windmark.app import console
from windmark.app.commands.grouped import FLAT, GRID, INPUT, ranged, written
from windmark.app.commands.matching_options import (
    ROLES_ALIGN,
    Mask,
    MaxTime,
    Method,
    NoOcclusion,
    Offset,
    Prior,
    PriorMaxAngle,
    PriorMaxScale,
    Quantity,
    QuantityUnit,
    Roles,
    Scale,
    VolumeParts,
    detect_settings,
    grid_settings,
    markers_settings,
    register_settings,
    values_settings,
)
from windmark.app.commands.options import Json, MeritMax, Polarity, Radius, Seed
from windmark.errors import UsageError
from windmark.options.detection import MERIT_MAX, POLARITY_OR_AUTO
from windmark.options.registration import MAX_TIME_S, METHOD, PRIOR_MAX_ANGLE_DEG, PRIOR_MAX_SCALE, SEED


def add(app: typer.Typer) -> None:
    """Add this command to ``app``."""
    app.command(
        epilog="Example: windmark align off.tif on*.tif -r 4 (2D: the markers alone), or windmark align off.tif on.tif"
        " --reference off -m markers.csv -c camera.json -g wing.grid -r 3 --unit mm (3D)"
    )(align)


def align(
    images: Annotated[list[Path], typer.Argument(help="Images of one camera, or its recording.")],
    reference: Annotated[
        str | None,
        typer.Option(
            help="Name (file stem) of the image that the others are aligned to. [default: the first]",
            rich_help_panel=INPUT,
        ),
    ] = None,
    markers: Annotated[
        Path | None, typer.Option("--markers", "-m", help="3D: marker table, CSV or .tgts.", rich_help_panel=INPUT)
    ] = None,
    camera: Annotated[
        Path | None, typer.Option("--camera", "-c", help="3D: camera (see convert).", rich_help_panel=INPUT)
    ] = None,
    grid: Annotated[
        Path | None,
        typer.Option("--grid", "-g", help="3D: surface grid, PLOT3D, STL, OBJ, PLY, VTK.", rich_help_panel=INPUT),
    ] = None,
    unit: Annotated[
        str | None,
        typer.Option("--unit", help="3D: length unit of markers and grid: in, ft, mm, cm, m.", rich_help_panel=INPUT),
    ] = None,
    radius: Radius = None,
    polarity: Polarity = POLARITY_OR_AUTO.default,
    merit_max: MeritMax = MERIT_MAX.default,
    kind: Annotated[
        str, typer.Option(help="2D: auto, similarity, affine, projective, poly2, poly3, spline.", rich_help_panel=FLAT)
    ] = "auto",
    max_shift_px: Annotated[
        float | None, ranged("2D: no marker has moved farther; tells regular layouts apart.", above=0.0, panel=FLAT)
    ] = None,
    matches: Annotated[
        Path | None,
        typer.Option(
            help="2D: markers by name in every image: a table image,name,x,y or detections with a name.",
            rich_help_panel=FLAT,
        ),
    ] = None,
    image_mask: Annotated[
        Path | None,
        typer.Option(help="2D: as --mask, of the images; --mask is that of the reference.", rich_help_panel=FLAT),
    ] = None,
    keep_still: Annotated[
        bool,
        typer.Option(
            "--keep-still", help="2D: use markers that stand still while the others move.", rich_help_panel=FLAT
        ),
    ] = False,
    volume: VolumeParts = None,
    background: Annotated[
        str | None,
        typer.Option(
            help="3D: pixels that show no part of --volume: blank (NaN), or keep (as they are in that image, where the"
            " model does not hide them; for a camera that stands still). [default: blank]",
            rich_help_panel=GRID,
        ),
    ] = None,
    prior: Prior = None,
    prior_max_angle: PriorMaxAngle = PRIOR_MAX_ANGLE_DEG.default,
    prior_max_scale: PriorMaxScale = PRIOR_MAX_SCALE.default,
    roles: Roles = None,
    no_occlusion: NoOcclusion = False,
    method: Method = METHOD.default,
    max_time: MaxTime = MAX_TIME_S.default,
    mask: Mask = None,
    quantity: Quantity = None,
    quantity_unit: QuantityUnit = None,
    scale: Scale = 1.0,
    offset: Offset = 0.0,
    output: Annotated[Path, written("Folder of the results.")] = Path("aligned"),
    seed: Seed = SEED.default,
    as_json: Json = False,
) -> None:
    """Recompute images as if all had been taken with the model where the reference shows it.

    2D, from the markers in the pictures alone: motion and deformation are compensated, parallax is not. 3D, with
    --markers, --camera, --grid and --unit: rigid motion exactly, relief and perspective included. Markers on the walls
    take no part in 3D unless --roles names them, and in 2D if they stand still while the model moves: else use --mask.
    Neither do zones of the grid that bear markers of walls; where the table has none, name the model's own zones with
    --volume, or walls are dragged along with it.
    """
    with console.errors(as_json):
        needed = {"--markers": markers, "--camera": camera, "--grid": grid, "--unit": unit}
        given = [name for name, value in needed.items() if value is not None]
        only_2d = {"--kind": kind != "auto", "--max-shift-px": max_shift_px is not None,
                   "--matches": matches is not None, "--image-mask": image_mask is not None,
                   "--keep-still": keep_still}  # fmt: skip
        only_3d = {"--prior": prior is not None, "--roles": bool(roles), "--no-occlusion": no_occlusion,
                   "--max-time": max_time is not None, "--volume": bool(volume),
                   "--background": background is not None, "--method": method != METHOD.default,
                   "--quantity": quantity is not None, "--quantity-unit": quantity_unit is not None,
                   "--scale": scale != 1, "--offset": offset != 0}  # fmt: skip
        wrong = [name for name, is_given in (only_2d if given else only_3d).items() if is_given]
        if given and len(given) < len(needed):
            missing = ", ".join(name for name in needed if name not in given)
            raise UsageError(f"3D alignment needs {missing} beside {', '.join(given)}; without any of them it is 2D")
        if wrong:
            raise UsageError(f"{wrong[0]} belongs to {'2D' if given else '3D'} alignment, this is "
                             f"{'3D (a camera is given)' if given else '2D (no camera is given)'}")  # fmt: skip
        if not given:
            from windmark.app import align_verb

            options = {
                "kind": kind, "max_shift_px": max_shift_px, "radius_px": tuple(radius) if radius else None,
                "polarity": polarity, "merit_max": merit_max, "mask": mask, "image_mask": image_mask,
                "keep_still": keep_still,
            }  # fmt: skip
            align_verb.align(align_verb.Wishes(images, reference, matches, output, options), as_json)
            return
        from windmark.app import verbs
        from windmark.io import addresses, picture_name

        images = addresses(images)
        reference = reference or picture_name(images[0])
        settings: dict[str, Any] = {
            "title": f"Alignment to {reference}",
            "length_unit": unit,
            "camera": [{"file": camera}],
            "image": [
                {"file": path, **values_settings(quantity, quantity_unit, scale, offset)} for path in addresses(images)
            ],
            "markers": markers_settings(markers, roles or ROLES_ALIGN),  # type: ignore[arg-type]
            "grid": grid_settings(grid, volume),  # type: ignore[arg-type]
            "detect": detect_settings(radius, polarity, merit_max, mask),
            "register": register_settings(
                seed, max_time, prior, prior_max_angle, prior_max_scale, occlusion=not no_occlusion, method=method
            ),
            "align": {"reference": reference} | ({"background": background} if background else {}),
            "output": {"folder": output, "nodes": ()},
        }
        verbs.run_settings(settings, as_json)
