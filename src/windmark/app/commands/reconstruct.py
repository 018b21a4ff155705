"""The command ``windmark reconstruct``. Heavy imports wait until it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from windmark.app import console
from windmark.app.commands import calibrate_arguments as a
from windmark.app.commands.grouped import ADJUSTMENT, DATUM, INPUT, LENS, MATCH, OUTPUT, ranged, written
from windmark.app.commands.matching_options import Mask
from windmark.app.commands.options import Bayer, Channel, Json, MeritMax, OnePolarity, Radius, Seed
from windmark.options.detection import BAYER, CHANNEL, MERIT_MAX, POLARITY
from windmark.options.registration import SEED

Images = Annotated[list[Path], typer.Argument(help="Pictures of the same markers from different directions.")]
Cameras = Annotated[
    list[str],
    typer.Option(
        "--camera",
        "-c",
        help="Interior parameters; several cameras as NAME=FILE, images' names begin so.",
        rich_help_panel=INPUT,
    ),
]
Primary = Annotated[
    Path | None,
    typer.Option(
        "--primary",
        "-p",
        help="The known markers: CSV or .tgts. Three with --labels, else four; six best.",
        rich_help_panel=DATUM,
    ),
]
PrimaryCov = Annotated[
    Path | None,
    typer.Option(
        "--primary-cov",
        help="Joint covariance of primaries: first,second,xx,xy,...,zz for each pair.",
        rich_help_panel=DATUM,
    ),
]
FreeFrame = Annotated[
    bool,
    typer.Option(
        "--free-frame",
        help="No known markers: in the frame of --poses, or of the markers' mean plane with the scale "
        "of --distance, or a free one.",
        rich_help_panel=DATUM,
    ),
]
Distances = Annotated[
    list[str] | None,
    typer.Option(
        "--distance",
        help="A,B,length,sigma: known distance of two markers in --labels; with --free-frame.",
        rich_help_panel=DATUM,
    ),
]
Unit = Annotated[
    str | None,
    typer.Option(
        "--unit", help="Length unit of primaries, poses or distances: in, ft, mm, cm, m.", rich_help_panel=INPUT
    ),
]
Labels = Annotated[
    Path | None,
    typer.Option(
        help="Table image,name,x,y: primary markers in some pictures (within 10 px); seldom needed.",
        rich_help_panel=MATCH,
    ),
]
Rough = Annotated[
    Path | None,
    typer.Option(help="Rough coordinates of some or all markers, CSV or .tgts, to begin.", rich_help_panel=MATCH),
]
Poses = Annotated[
    Path | None,
    typer.Option(
        help="Folder of poses in the primaries' frame: NAME.json of each picture, as in views/ of a result.",
        rich_help_panel=MATCH,
    ),
]
Free = Annotated[
    str | None,
    typer.Option(
        help="Interior parameters to be found, too: focal_px,cx,cy,k1,... [default: none]", rich_help_panel=LENS
    ),
]
Pair = Annotated[
    tuple[str, str] | None,
    typer.Option(
        help="Names of two of the pictures: draw both with the epipolar lines of every marker.", rich_help_panel=OUTPUT
    ),
]
ModelPx = Annotated[
    float,
    ranged(
        "1 sigma that lens, light and JPEG add to the spots' own; calibrate measures it.",
        "--model-px",
        least=0.0,
        panel=ADJUSTMENT,
    ),
]
Output = Annotated[Path, written("Folder of the results.")]


def reconstruct(
    images: Images,
    camera: Cameras,
    primary: Primary = None,
    primary_cov: PrimaryCov = None,
    unit: Unit = None,
    free_frame: FreeFrame = False,
    distance: Distances = None,
    labels: Labels = None,
    rough: Rough = None,
    poses: Poses = None,
    images_of: a.ImagesOf = None,
    free: Free = None,
    model_px: ModelPx = 0.0,
    pair: Pair = None,
    radius: Radius = None,
    polarity: OnePolarity = POLARITY.default,
    merit_max: MeritMax = MERIT_MAX.default,
    channel: Channel = CHANNEL.default,
    bayer: Bayer = BAYER.default,
    mask: Mask = None,
    seed: Seed = SEED.default,
    output: Output = Path("reconstruction"),
    as_json: Json = False,
) -> None:
    """Find the coordinates of unknown markers in the frame of a few known ones, from pictures taken by hand.

    Needed: 20 or more pictures taken close to each other, and a calibrated camera. No labels, no poses: which spot is
    which marker is found from the pictures alone, and the known markers by their distances.
    """
    with console.errors(as_json):
        from windmark.app import calibrate_options as typed
        from windmark.app.reconstruct_verb import Files, run
        from windmark.pipeline.calibrate import MatchOptions

        files = Files(
            typed.expanded(images), typed.read_cameras(camera), typed.parse_patterns(images_of or ()), primary, labels,
            rough, poses, typed.parse_free(None, free or ""), model_px, pair, unit or "", output, free_frame,
            typed.parse_distances(distance or ()), primary_cov,
        )  # fmt: skip
        match = MatchOptions(tuple(radius or ()), polarity, merit_max, channel, bayer, mask, seed=seed)
        run(files, match, as_json)
