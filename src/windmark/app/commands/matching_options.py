"""Options that the verbs share which register images, and the settings they stand for."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from windmark.app.commands.grouped import GRID, LOOK, MATCH, POSE, VALUES, told
from windmark.errors import UsageError
from windmark.options import registration

MaxTime = Annotated[float | None, told(registration.MAX_TIME_S, panel=MATCH)]
Method = Annotated[str, told(registration.METHOD, panel=MATCH)]
Tolerance = Annotated[float | None, told(registration.TOLERANCE_PX, panel=MATCH)]
FreeFocal = Annotated[bool, told(registration.FREE_FOCAL, panel=POSE)]
Roles = Annotated[
    list[str] | None,
    typer.Option(
        "--roles",
        help="Markers that take part: model, wall, primary, secondary; several times for several.",
        rich_help_panel=MATCH,
    ),
]
Prior = Annotated[
    Path | None,
    typer.Option(
        "--prior", help="Camera file with a pose: solutions too far from it are rejected.", rich_help_panel=POSE
    ),
]
PriorMaxAngle = Annotated[float, told(registration.PRIOR_MAX_ANGLE_DEG, panel=POSE)]
PriorMaxScale = Annotated[float, told(registration.PRIOR_MAX_SCALE, panel=POSE)]
Mask = Annotated[
    Path | None,
    typer.Option(
        help="Pixels that are used: a picture (not 0), or a table of a polygon's corners, x,y.", rich_help_panel=LOOK
    ),
]
Label = Annotated[
    list[str] | None,
    typer.Option(
        "--label",
        help="NAME=x,y: the spot there (within 10 px) is this marker; several times for several.",
        rich_help_panel=MATCH,
    ),
]
Exclude = Annotated[
    list[str] | None,
    typer.Option(
        "--exclude",
        help="x,y: the spot there (within 10 px) takes no part; several times for several.",
        rich_help_panel=MATCH,
    ),
]
Binding = Annotated[bool, told(registration.BINDING, panel=MATCH)]
NoOcclusion = Annotated[
    bool,
    typer.Option(
        "--no-occlusion", help="Markers that the grid hides are expected and matched all the same.",
        rich_help_panel=MATCH,
    ),
]  # fmt: skip

Quantity = Annotated[
    str | None,
    typer.Option(
        help="What the values are: grey, radiance or temperature. [default: what the file says, else grey]",
        rich_help_panel=VALUES,
    ),
]
QuantityUnit = Annotated[
    str | None,
    typer.Option(help="Unit of the values: K, degC or degF; of a radiance such as W/m2/sr.", rich_help_panel=VALUES),
]
Scale = Annotated[float, typer.Option(help="Values are OFFSET + SCALE x grey level.", rich_help_panel=VALUES)]
Offset = Annotated[float, typer.Option(help="Values are OFFSET + SCALE x grey level.", rich_help_panel=VALUES)]
VolumeParts = Annotated[
    list[str] | None,
    typer.Option(
        "--volume",
        help="NAME=zone01,zone02 (or one zone's own name): what of the grid takes part; several times for several."
        " Zones that are not named are as if they were not in the file. [default: all]",
        rich_help_panel=GRID,
    ),
]

ROLES_ALIGN = ("model", "primary", "secondary")
"""What moves with the model."""


def register_settings(
    seed: int, max_time: float | None, prior: Path | None, max_angle: float, max_scale: float, **others: Any
) -> dict[str, Any]:
    """Table [register] of a project."""
    return {
        "seed": seed, "max_time_s": max_time, "prior": prior, "prior_max_angle_deg": max_angle,
        "prior_max_scale": max_scale, **others,
    }  # fmt: skip


def detect_settings(radius: list[float] | None, polarity: str, merit_max: float, mask: Path | None) -> dict[str, Any]:
    """Table [detect] of a project."""
    return {
        "radius_px": tuple(radius) if radius else None, "polarity": polarity, "merit_max": merit_max, "mask": mask,
    }  # fmt: skip


def markers_settings(
    file: Path, roles: list[str] | tuple[str, ...] | None, surface: Path | None = None
) -> dict[str, Any]:
    """Table [markers] of a project; without roles its default."""
    return {"file": file, "surface": surface} | ({"roles": tuple(roles)} if roles else {})


def values_settings(quantity: str | None, unit: str | None, scale: float, offset: float) -> dict[str, Any]:
    """What the values of an image are, of table [[image]] of a project."""
    return {"quantity": quantity, "unit": unit, "scale": scale, "offset": offset}


def grid_settings(file: Path, volumes: list[str] | None) -> dict[str, Any]:
    """Table [grid] of a project.

    Raises
    ------
    ValueError
        For a volume that is neither NAME=zone,zone nor a zone's name, or comes twice.
    """
    parts: dict[str, tuple[str, ...]] = {}
    for text in volumes or ():
        name, sign, zones = text.partition("=")
        name = name.strip()
        found = tuple(z.strip() for z in zones.split(",")) if sign else (name,)
        if not name or not all(found):
            raise UsageError(f"--volume: expected NAME=zone01,zone02 or the name of a zone, got {text!r}")
        if name in parts:
            raise UsageError(f"--volume: {name} is given twice; give all its zones at once, {name}=zone01,zone02")
        parts[name] = found
    return {"file": file} | ({"volumes": parts} if parts else {})


def image_settings(file: Path, labels: list[str] | None, exclude: list[str] | None) -> dict[str, Any]:
    """Table [[image]] of a project.

    Raises
    ------
    ValueError
        For a label that is not NAME=x,y, a place that is not x,y, or a name that comes twice.
    """
    excluded = tuple(_place(t, "--exclude", "x,y", t) for t in exclude or ())
    return {"file": file, "labels": label_places(labels), "exclude": excluded}


def label_places(labels: list[str] | None) -> dict[str, tuple[float, float]]:
    """Places by name from ``NAME=x,y``; errors as `image_settings`."""
    places: dict[str, tuple[float, float]] = {}
    for text in labels or ():
        name, sign, place = text.rpartition("=")
        if not (name and sign):
            raise UsageError(f"--label: expected NAME=x,y, got {text!r}")
        if name in places:
            raise UsageError(f"--label: {name} is given twice; a marker has one place")
        places[name] = _place(place, "--label", "NAME=x,y", text)
    return places


def _place(text: str, option: str, form: str, whole: str) -> tuple[float, float]:
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        raise UsageError(f"{option}: expected {form} with x and y in pixels, got {whole!r}") from None
    return x, y
