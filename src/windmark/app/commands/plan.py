"""Commands for planning a test: what markers give, which deformation laws there are. Heavy imports wait."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from windmark.app import console
from windmark.app.commands.grouped import CAMPAIGN, COMPARE, INPUT, LOOK, OUTPUT, OWN, PICTURES, App, ranged, written
from windmark.app.commands.options import Json, Seed, Unit
from windmark.errors import UsageError


def add(app: typer.Typer) -> None:
    """Add these commands to ``app``."""
    app.command(epilog="Example: windmark study --radius 3 --radius 5 --noise-percent 10 --output noisy-markers")(study)
    app.command(
        epilog="Examples: windmark laws --pictures laws; windmark laws wing.py -m markers.csv --volume wing; "
        "windmark laws --compare deform.toml --law modal_beam --law 'beam:twist=[2]'"
    )(laws)
    markers = App(help="Work on marker tables.", no_args_is_help=True, rich_markup_mode=None)
    app.add_typer(markers, name="markers")
    markers.command(
        "check",
        epilog="Example: windmark markers check markers.csv --unit mm -c camera.json --view-from 0,90 --within 50",
    )(markers_check)


def study(
    radius: Annotated[
        list[float] | None,
        typer.Option(
            "--radius",
            "-r",
            help="Reference radius in pixels; give it several times. [default: 2 3 4 5]",
            rich_help_panel=PICTURES,
        ),
    ] = None,
    span_px: Annotated[
        float, ranged("Real radii lie so far below and above the reference radius.", least=0.0, panel=PICTURES)
    ] = 0.5,
    steps: Annotated[int, ranged("Real radii per reference radius.", least=1, panel=PICTURES)] = 11,
    markers: Annotated[
        int, ranged("Random markers per real radius, rounded up to full rows.", least=1, panel=PICTURES)
    ] = 144,
    max_tilt_deg: Annotated[
        float, ranged("Viewing angles are random from 0 to this.", least=0.0, most=89.0, panel=PICTURES)
    ] = 60,
    blur_passes: Annotated[
        int, ranged("How often the image is averaged over 3 x 3 pixels.", least=0, panel=PICTURES)
    ] = 1,
    noise_percent: Annotated[
        float, ranged("Noise (1 sigma) in percent of the markers' depth.", least=0.0, panel=PICTURES)
    ] = 3,
    depth: Annotated[
        float, ranged("Depth of the markers in grey levels; images have whole ones.", above=0.0, panel=PICTURES)
    ] = 150,
    method: Annotated[
        list[str] | None,
        typer.Option(help="Refinement of the centre; several times to compare. [default: all]", rich_help_panel=LOOK),
    ] = None,
    seed: Seed = 0,
    output: Annotated[Path, written("Folder of the results.")] = Path("marker-study"),
    as_json: Json = False,
) -> None:
    """The paper's uncertainty study: error of virtual markers beside the Cramer-Rao bound, table and pictures."""
    with console.errors(as_json):
        from windmark.app import study_verb
        from windmark.pipeline.study import PAPER_RADII_PX, StudySettings

        settings = StudySettings(
            tuple(radius or PAPER_RADII_PX), span_px, steps, markers, max_tilt_deg, blur_passes, noise_percent, depth,
            tuple(method or ()), seed,
        )  # fmt: skip
        study_verb.study(settings, output, as_json)


def markers_check(
    file: Annotated[Path, typer.Argument(help="Marker table: CSV or .tgts.")],
    unit: Unit,
    camera: Annotated[
        Path | None,
        typer.Option(
            "--camera",
            "-c",
            help="Interior parameters. [default: 2048 x 1536 px, 30 deg field of view]",
            rich_help_panel=INPUT,
        ),
    ] = None,
    grid: Annotated[
        Path | None,
        typer.Option(
            "--grid", "-g", help="Surface of the model: it hides markers; new places lie on it.", rich_help_panel=INPUT
        ),
    ] = None,
    role: Annotated[
        list[str] | None,
        typer.Option(
            help="Only markers of this role; several times. [default: all painted ones]", rich_help_panel=INPUT
        ),
    ] = None,
    view_from: Annotated[
        str | None,
        typer.Option(
            help="AZIMUTH,ELEVATION in degrees where the camera may stand, seen from the model: from x towards y,"
            " from the x-y plane towards z. [default: wherever two thirds as many markers are in sight as from the"
            " best direction]",
            rich_help_panel=CAMPAIGN,
        ),
    ] = None,
    within: Annotated[float, ranged("Half angle of that region, degrees.", above=0.0, most=180.0, panel=CAMPAIGN)] = 40,
    views: Annotated[
        int,
        ranged(
            "Virtual views in the first round, all round, three per direction.", least=24, most=100_000, panel=CAMPAIGN
        ),
    ] = 360,
    quick: Annotated[
        bool, typer.Option("--quick", help="120 views, whatever --views says.", rich_help_panel=CAMPAIGN)
    ] = False,
    hidden: Annotated[
        float, ranged("Percent of the markers in view that are not detected.", least=0.0, most=95.0, panel=CAMPAIGN)
    ] = 30,
    false: Annotated[
        float, ranged("False spots, percent of the markers in view.", "--false", least=0.0, most=1000.0, panel=CAMPAIGN)
    ] = 50,
    noise_px: Annotated[
        float, ranged("1 sigma per coordinate of a spot.", least=0.01, most=10.0, panel=CAMPAIGN)
    ] = 0.2,
    advice: Annotated[
        bool,
        typer.Option(
            "--advice/--no-advice", help="Look for markers to move or add where it is needed.", rich_help_panel=OUTPUT
        ),
    ] = True,
    seed: Seed = 0,
    output: Annotated[Path, written("Folder of the results.")] = Path("marker-check"),
    as_json: Json = False,
) -> None:
    """Before the test: can the layout be identified from anywhere, what would help, where will the pose be weak."""
    with console.errors(as_json):
        from windmark.app import markers_verb
        from windmark.tasks.marker_check import CheckSettings

        settings = CheckSettings(
            view_from=markers_verb.view_from(view_from), within_deg=within,
            views=markers_verb.QUICK_VIEWS if quick else views, hidden_percent=hidden, false_percent=false,
            noise_px=noise_px, advise=advice, seed=seed,
        )  # fmt: skip
        files = markers_verb.Files(file, camera, grid, unit, tuple(role or ()), output)
        markers_verb.check(files, settings, as_json)


def laws(
    file: Annotated[
        Path | None, typer.Argument(help="Python file with your own laws, to be checked. [default: list the built-in]")
    ] = None,
    markers: Annotated[
        Path | None,
        typer.Option("--markers", "-m", help="Marker table: your laws are checked on its points.", rich_help_panel=OWN),
    ] = None,
    volume: Annotated[str | None, typer.Option(help="Only the markers of this volume.", rich_help_panel=OWN)] = None,
    pictures: Annotated[
        Path | None,
        typer.Option(
            help="Folder for one PNG per law: a wing moved by each parameter in turn; of --compare: its table and "
            "picture [default: law-comparison].",
            rich_help_panel=OUTPUT,
        ),
    ] = None,
    compare: Annotated[
        Path | None,
        typer.Option(
            help="Project of a deformation test: which law do its pictures ask for? Exit code 1: several.",
            rich_help_panel=COMPARE,
        ),
    ] = None,
    law: Annotated[
        list[str] | None,
        typer.Option(
            help="To be compared, besides the project's own and its [[volume.alternative]]: "
            "[VOLUME/]LAW[:option=value;...]; several times.",
            rich_help_panel=COMPARE,
        ),
    ] = None,
    frames: Annotated[
        int, ranged("Compare on so many frames of the sequence, evenly spaced.", least=1, panel=COMPARE)
    ] = 8,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """The deformation laws there are; the check of a file with your own; or which law a test's pictures ask for."""
    with console.errors(as_json):
        from windmark.app import laws_verb

        if compare is not None:
            if file is not None or markers is not None or volume is not None:
                raise UsageError("--compare takes everything from its project; leave out FILE, --markers and --volume")
            from windmark.app import laws_compare

            laws_compare.compare(compare, law or (), frames, pictures, seed, as_json)
        elif law:
            raise UsageError("--law belongs to --compare")
        elif file is not None:
            laws_verb.check_file(file, markers, volume, pictures, as_json)
        elif markers is not None or volume is not None:
            raise UsageError("--markers and --volume are for a file with your own laws; give it first")
        else:
            laws_verb.built_in(pictures, as_json)
