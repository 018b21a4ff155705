"""The command ``windmark epipolar``. Heavy imports wait until it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from windmark.app import console
from windmark.app.commands.grouped import INPUT, MATCH, ranged, written
from windmark.app.commands.matching_options import Mask
from windmark.app.commands.options import Bayer, Channel, Json, MeritMax, OnePolarity, Radius, Seed
from windmark.options.detection import BAYER, CHANNEL, MERIT_MAX, POLARITY
from windmark.options.registration import SEED


def add(app: typer.Typer) -> None:
    """Add this command to ``app``."""
    app.command(epilog="Example: windmark epipolar P01.tif P02.tif --matches clicks.csv -c camera.json --radius 3")(
        epipolar
    )


def epipolar(
    first: Annotated[Path, typer.Argument(help="A picture.")],
    second: Annotated[Path, typer.Argument(help="Another one of the same markers, from another place.")],
    matches: Annotated[
        Path,
        typer.Option(
            "--matches",
            "-m",
            help="Matches by hand: x_a,y_a,x_b,y_b, or image,name,x,y (within 10 px).",
            rich_help_panel=INPUT,
        ),
    ],
    camera: Annotated[
        list[Path] | None,
        typer.Option(
            "--camera",
            "-c",
            help="Interior parameters; twice where the second picture has its own camera.",
            rich_help_panel=INPUT,
        ),
    ] = None,
    sigma_px: Annotated[
        float | None,
        ranged(
            "1 sigma per coordinate of a spot, its own noise left out. [default: 0.1; no camera: 1]",
            above=0.0,
            panel=MATCH,
        ),
    ] = None,
    radius: Radius = None,
    polarity: OnePolarity = POLARITY.default,
    merit_max: MeritMax = MERIT_MAX.default,
    channel: Channel = CHANNEL.default,
    bayer: Bayer = BAYER.default,
    mask: Mask = None,
    seed: Seed = SEED.default,
    output: Annotated[Path, written("Folder of the results.")] = Path("epipolar"),
    as_json: Json = False,
) -> None:
    """Two pictures and a few matches by hand: F, wrong and unchecked clicks; with --camera all other matches too.

    Seven matches with a camera, also on a plane (six may agree by chance). Without one eight or better 16 (markers in
    space, a lens without much distortion), and the other spots are not matched: which of those on a line is meant needs
    depths, so a camera.
    """
    with console.errors(as_json):
        from windmark.app import epipolar_verb
        from windmark.io import one_picture
        from windmark.pipeline.calibrate import MatchOptions

        match = MatchOptions(tuple(radius or ()), polarity, merit_max, channel, bayer, mask, seed=seed)
        pair = one_picture(first), one_picture(second)
        epipolar_verb.run(pair, matches, tuple(camera or ()), sigma_px, match, output, as_json)
