"""The command ``windmark calibrate`` and its options. Heavy imports wait until it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from windmark.app import console
from windmark.app.commands.matching_options import Mask, Roles

Texts = list[str] | None


def calibrate(
    inputs: Annotated[
        list[Path],
        typer.Argument(
            help="A table of matches (CSV: image,name,x,y[,sigma_x,sigma_y][,camera][,frame]), or pictures, in which "
            "the markers are found and matched."
        ),
    ],
    markers: Annotated[Path, typer.Option("--markers", "-m", help="Rough coordinates: CSV or .tgts.")],
    unit: Annotated[str, typer.Option("--unit", help="Length unit of the markers: in, ft, mm, cm, m.")],
    datum: Annotated[
        str | None,
        typer.Option(
            help="What fixes position, direction and size; no default. free[:A,B,C], fixed:A,B,C,D, or"
            " weighted[:A,B,C][=sigma]."
        ),
    ] = None,
    camera: Annotated[
        Texts,
        typer.Option(
            "--camera", "-c", help="Start values; several cameras as NAME=FILE, images' names begin with NAME."
        ),
    ] = None,
    size: Annotated[str | None, typer.Option(help="WIDTHxHEIGHT of the pictures, where there is no --camera.")] = None,
    focal: Annotated[
        float | None,
        typer.Option(help="Rough focal length in pixels. [default: found; in pictures from 0.33 to 3 widths]"),
    ] = None,
    lens: Annotated[
        str | None,
        typer.Option(help="Free parameters: pinhole, radial or brown, then +k3, +tilts. [default: brown]"),
    ] = None,
    free: Annotated[
        str | None, typer.Option(help="Free parameters one by one: focal_px,aspect,cx,cy,k1,k2,k3,p1,p2,tilt_x,tilt_y.")
    ] = None,
    prior_sigma: Annotated[
        Texts, typer.Option(help="PARAMETER=SIGMA: known so well round its start value; several times.")
    ] = None,
    free_focal: Annotated[
        Texts, typer.Option(help="Picture with a focal length of its own (another focus distance); several times.")
    ] = None,
    distance: Annotated[
        Texts, typer.Option(help="A,B,length,sigma: known distance of two markers; several times.")
    ] = None,
    rig: Annotated[
        bool, typer.Option("--rig", help="Several cameras that do not move against each other; frames are instants.")
    ] = False,
    eccentricity: Annotated[
        str, typer.Option(help="Of imaged discs: auto (normals from the table or the neighbours), table or off.")
    ] = "auto",
    reject: Annotated[bool, typer.Option("--reject/--no-reject", help="Leave gross errors out.")] = True,
    max_sigma0: Annotated[float, typer.Option(help="Residuals so many times larger than the sigmas are refused.")] = 5,
    sigma_px: Annotated[float, typer.Option(help="Of marks whose table has no sigma, per coordinate.")] = 0.1,
    against: Annotated[
        Path | None, typer.Option(help="Results of another set of pictures of these markers: compare with them.")
    ] = None,
    radius: Annotated[
        list[float] | None,
        typer.Option("--radius", "-r", help="Pictures: marker radius in pixels; several for a range. [default: found]"),
    ] = None,
    polarity: Annotated[str, typer.Option(help="Pictures: dark or bright markers.")] = "dark",
    merit_max: Annotated[float, typer.Option(help="Pictures: largest merit of a marker.")] = 0.7,
    channel: Annotated[str, typer.Option(help="Pictures: grey, red, green or blue.")] = "grey",
    bayer: Annotated[str | None, typer.Option(help="Pictures: raw mosaic, RGGB, BGGR, GRBG or GBRG.")] = None,
    mask: Mask = None,
    label: Annotated[
        Texts, typer.Option(help="Pictures: IMAGE:NAME=x,y, this marker is there (within 10 px); several times.")
    ] = None,
    labels: Annotated[Path | None, typer.Option(help="Pictures: the same as a table image,name,x,y.")] = None,
    tolerance_px: Annotated[
        float | None, typer.Option(help="Pictures: how far rough markers may be off. [default: 0.3 of their spacing]")
    ] = None,
    max_time: Annotated[float, typer.Option(help="Pictures: seconds of CPU time per matching.")] = 2.0,
    roles: Roles = None,
    seed: Annotated[int, typer.Option(help="Seed of every random choice: same seed, same result.")] = 0,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the results.")] = Path("calibration"),
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON, for machines.")] = False,
) -> None:
    """Calibrate cameras in place: interior parameters, poses and marker coordinates with their uncertainties.

    Needed: many pictures of the same markers from different directions, some of them rolled, at one focus setting.
    Rough coordinates may be off by some percent of the model; no poses and no focal length are needed.
    """
    with console.errors(as_json):
        from windmark.app import calibrate_options as typed
        from windmark.app import calibrate_verb
        from windmark.app.convert_verb import parse_size
        from windmark.pipeline.calibrate import CalibrateSettings, MatchOptions

        if not sigma_px > 0:
            raise ValueError(f"--sigma-px must be > 0, got {sigma_px:g}")
        settings = CalibrateSettings(
            typed.parse_datum(datum), typed.parse_free(lens, free), typed.parse_distances(distance or ()), rig,
            tuple(free_focal or ()), typed.parse_priors(prior_sigma or ()), eccentricity, reject, max_sigma0, seed,
        )  # fmt: skip
        match = MatchOptions(
            tuple(radius or ()), polarity, merit_max, channel, bayer, mask, typed.parse_labels(label or (), labels),
            tolerance_px, max_time, seed,
        )  # fmt: skip
        files = calibrate_verb.Files(
            tuple(inputs), markers, tuple(roles or ()), typed.read_cameras(camera or ()), parse_size(size), focal, unit,
            sigma_px, against, output,
        )  # fmt: skip
        calibrate_verb.calibrate(files, settings, match, as_json)
