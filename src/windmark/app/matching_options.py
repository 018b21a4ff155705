"""Options that the verbs share which register images, and the settings they stand for."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

MaxTime = Annotated[
    float | None,
    typer.Option("--max-time", help="Seconds of CPU time per image, then an honest refusal. [default: 0.2]"),
]
Roles = Annotated[
    list[str] | None,
    typer.Option("--roles", help="Markers that take part: model, wall, primary, secondary; several times for several."),
]
Prior = Annotated[
    Path | None, typer.Option("--prior", help="Camera file with a pose: solutions too far from it are rejected.")
]
PriorMaxAngle = Annotated[float, typer.Option(help="Largest angle between solution and prior, degrees.")]
PriorMaxScale = Annotated[float, typer.Option(help="Largest ratio of the scales of solution and prior; > 1.")]
Mask = Annotated[
    Path | None,
    typer.Option(help="Pixels that are used: a picture (not 0), or a table of a polygon's corners, x,y."),
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


def markers_settings(file: Path, roles: list[str] | tuple[str, ...] | None) -> dict[str, Any]:
    """Table [markers] of a project; without roles its default."""
    return {"file": file} | ({"roles": tuple(roles)} if roles else {})
