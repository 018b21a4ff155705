"""The command line: ``windmark VERB``. Heavy imports wait until a verb needs them."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any

import typer

from windmark.app import camera_commands, console
from windmark.app.matching_options import (
    ROLES_ALIGN,
    Exclude,
    Label,
    Mask,
    MaxTime,
    NoOcclusion,
    Prior,
    PriorMaxAngle,
    PriorMaxScale,
    Roles,
    image_settings,
    markers_settings,
    register_settings,
)

app = typer.Typer(
    name="windmark",
    help="Wind-tunnel camera images into measurements on the model's surface.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON, for machines.")]
Radius = Annotated[
    list[float] | None,
    typer.Option(
        "--radius", "-r", help="Marker radius in pixels; several times for a range. [default: found in the image]"
    ),
]
Polarity = Annotated[str, typer.Option(help="dark (markers on paint) or bright (infrared).")]
MeritMax = Annotated[float, typer.Option(help="Largest merit of a marker; 0 is a perfect inverse top-hat.")]
Markers = Annotated[Path, typer.Option("--markers", "-m", help="Marker table: CSV or .tgts.")]
CameraFile = Annotated[
    Path,
    typer.Option("--camera", "-c", help="Camera: windmark, OpenCV, NASA, COLMAP, mrcal, Metashape ... (see convert)."),
]
GridFile = Annotated[Path, typer.Option("--grid", "-g", help="Surface grid: PLOT3D, STL, OBJ, PLY, VTK.")]
Unit = Annotated[str, typer.Option("--unit", help="Length unit of markers and grid: in, ft, mm, cm, m.")]
Seed = Annotated[int, typer.Option(help="Seed of every random choice: same seed, same result.")]


def version_asked(value: bool) -> None:
    """Print the version and stop."""
    if value:
        from windmark import __version__

        typer.echo(f"windmark {__version__}")
        raise typer.Exit


@app.callback()
def root(
    version: Annotated[
        bool, typer.Option("--version", callback=version_asked, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Wind-tunnel camera images into measurements on the model's surface."""


@app.command(epilog="Example: windmark demo windmark-demo")
def demo(
    folder: Annotated[Path, typer.Argument(help="Where the synthetic test and its results go.")] = Path(
        "windmark-demo"
    ),
    seed: Seed = 1,
    as_json: Json = False,
) -> None:
    """Make a synthetic wind-tunnel test, run the main job on it and compare with its truth."""
    from windmark.app import verbs

    with console.errors(as_json):
        verbs.demo(folder, seed, as_json)


@app.command(epilog="Example: windmark simulate my-test --seed 7")
def simulate(
    folder: Annotated[Path, typer.Argument(help="Where the test is written.")],
    seed: Seed = 1,
    as_json: Json = False,
) -> None:
    """Write a synthetic test: images, markers, camera, grid, project file and the truth."""
    from windmark.app import verbs

    with console.errors(as_json):
        verbs.simulate(folder, seed, as_json)


@app.command(
    epilog="Example: windmark detect run12.tif --radius 3 --picture spots.png --explain rejected.csv."
    " Tracking: windmark detect run13.tif --near detections.csv -o run13.csv, or"
    " windmark detect run13.tif --camera run12-registration/run12/camera.json --markers markers.csv"
)
def detect(
    images: Annotated[list[Path], typer.Argument(help="Images.")],
    radius: Radius = None,
    polarity: Polarity = "dark",
    merit_max: MeritMax = 0.7,
    refine: Annotated[
        str, typer.Option(help="bowl (the paper's centre) or template (fit of a blurred ellipse).")
    ] = "template",
    photometry: Annotated[
        str | None, typer.Option(help="Of the template: multiplicative or additive. [default: by polarity]")
    ] = None,
    mask: Mask = None,
    roi: Annotated[
        str | None, typer.Option(help="x0,y0,x1,y1: first and last column and row that are used; else all.")
    ] = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="Table of the spots, CSV.")] = Path("detections.csv"),
    picture: Annotated[
        Path | None, typer.Option(help="Also draw the spots (PNG); several images get a number each.")
    ] = None,
    explain: Annotated[
        Path | None, typer.Option(help="Table of the rejected candidates with the reason; --picture draws them too.")
    ] = None,
    merit_map: Annotated[Path | None, typer.Option(help="Also draw the merit of every pixel (PNG).")] = None,
    channel: Annotated[
        str, typer.Option(help="Of colour pictures: grey (0.3 R + 0.6 G + 0.1 B), red, green, blue.")
    ] = ("grey"),
    bayer: Annotated[
        str | None, typer.Option(help="The picture is a colour sensor's raw mosaic: RGGB, BGGR, GRBG or GBRG.")
    ] = None,
    near: Annotated[
        Path | None,
        typer.Option(
            help="Detections of a frame before: look only near them, with their ellipses; finds faint markers."
        ),
    ] = None,
    camera: Annotated[
        Path | None, typer.Option("--camera", "-c", help="Camera with a pose: look only where it shows the --markers.")
    ] = None,
    markers: Annotated[
        Path | None, typer.Option("--markers", "-m", help="Marker table, with the camera's length unit and frame.")
    ] = None,
    search_px: Annotated[float, typer.Option(help="How far off the expected places may be, along each axis.")] = 2.5,
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
            channel, bayer,
        )  # fmt: skip
        guide = guided_verb.Guide(near, camera, markers, search_px)
        if guide:
            guided_verb.detect(images, wishes, guide, as_json)
        else:
            detect_verb.detect(images, wishes, as_json)


@app.command(epilog="Example: windmark register run12.tif -m markers.csv -c camera.json -r 3 --unit mm")
def register(
    image: Annotated[Path, typer.Argument(help="The image.")],
    markers: Markers,
    camera: CameraFile,
    unit: Unit,
    radius: Radius = None,
    polarity: Polarity = "dark",
    merit_max: MeritMax = 0.7,
    tolerance_px: Annotated[float | None, typer.Option(help="Largest distance of a spot to its marker.")] = None,
    free_focal: Annotated[bool, typer.Option(help="The focal length is only roughly known: find it too.")] = False,
    prior: Prior = None,
    prior_max_angle: PriorMaxAngle = 30.0,
    prior_max_scale: PriorMaxScale = 1.3,
    label: Label = None,
    exclude: Exclude = None,
    roles: Roles = None,
    max_time: MaxTime = None,
    mask: Mask = None,
    seed: Seed = 0,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder of the results. [default: IMAGE-registration]")
    ] = None,
    as_json: Json = False,
) -> None:
    """Find which spot is which marker and where the camera was; no start pose is needed."""
    from windmark.app import verbs

    with console.errors(as_json):
        settings: dict[str, Any] = {
            "title": f"Registration of {image.name}",
            "length_unit": unit,
            "camera": [{"file": camera}],
            "image": [image_settings(image, label, exclude)],
            "markers": markers_settings(markers, roles),
            "detect": {
                "radius_px": tuple(radius) if radius else None,
                "polarity": polarity,
                "merit_max": merit_max,
                "mask": mask,
            },
            "register": register_settings(
                seed,
                max_time,
                prior,
                prior_max_angle,
                prior_max_scale,
                tolerance_px=tolerance_px,
                free_focal=free_focal,
            ),
            "output": {"folder": output or Path(f"{image.stem}-registration"), "nodes": ()},
        }
        verbs.run_settings(settings, as_json)


@app.command(epilog="Example: windmark resect run12.tif -c run12-registration/run12/camera.json -g wing.grid --unit mm")
def resect(
    image: Annotated[Path, typer.Argument(help="The image.")],
    camera: Annotated[Path, typer.Option("--camera", "-c", help="Camera with a pose, as register writes it.")],
    grid: GridFile,
    unit: Unit,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder of the results. [default: IMAGE-resection]")
    ] = None,
    nodes: Annotated[
        list[str] | None,
        typer.Option(help="Formats of the node values: vtk, tecplot, plot3d, csv, netcdf. [default: all]"),
    ] = None,
    max_obliquity_deg: Annotated[float, typer.Option(help="Surface seen more obliquely than this gets no value.")] = 80,
    as_json: Json = False,
) -> None:
    """Map a registered image onto the grid: values on nodes, pictures."""
    from windmark.app import verbs

    with console.errors(as_json):
        settings: dict[str, Any] = {
            "title": f"Resection of {image.name}",
            "length_unit": unit,
            "camera": [{"file": camera, "pose": "known"}],
            "image": [{"file": image}],
            "grid": {"file": grid},
            "resect": {"max_obliquity_deg": max_obliquity_deg},
            "output": {"folder": output or Path(f"{image.stem}-resection")} | ({"nodes": nodes} if nodes else {}),
        }
        verbs.run_settings(settings, as_json)


@app.command(epilog="Example: windmark align off.tif on.tif --reference off -m markers.csv -c camera.json -g wing.grid"
                    " -r 3 --unit mm")  # fmt: skip
def align(
    images: Annotated[list[Path], typer.Argument(help="Images of one camera.")],
    reference: Annotated[str, typer.Option(help="Name (file stem) of the image that the others are aligned to.")],
    markers: Markers,
    camera: CameraFile,
    grid: GridFile,
    unit: Unit,
    radius: Radius = None,
    polarity: Polarity = "dark",
    prior: Prior = None,
    prior_max_angle: PriorMaxAngle = 30.0,
    prior_max_scale: PriorMaxScale = 1.3,
    roles: Roles = None,
    no_occlusion: NoOcclusion = False,
    max_time: MaxTime = None,
    mask: Mask = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the results.")] = Path("aligned"),
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """3D alignment: recompute images as if all had been taken from the reference image's pose.

    Markers on the walls take no part unless --roles names them: they do not move with the model.
    """
    from windmark.app import verbs

    with console.errors(as_json):
        settings: dict[str, Any] = {
            "title": f"Alignment to {reference}",
            "length_unit": unit,
            "camera": [{"file": camera}],
            "image": [{"file": path} for path in images],
            "markers": markers_settings(markers, roles or ROLES_ALIGN),
            "grid": {"file": grid},
            "detect": {"radius_px": tuple(radius) if radius else None, "polarity": polarity, "mask": mask},
            "register": register_settings(
                seed, max_time, prior, prior_max_angle, prior_max_scale, occlusion=not no_occlusion
            ),
            "align": {"reference": reference},
            "output": {"folder": output, "nodes": ()},
        }
        verbs.run_settings(settings, as_json)


@app.command(epilog="Example: windmark track run12-*.tif -m markers.csv -c camera.json -r 3 --unit mm -o run12-track")
def track(
    images: Annotated[list[Path], typer.Argument(help="Images of one camera, in the order in which they were taken.")],
    markers: Markers,
    camera: CameraFile,
    unit: Unit,
    radius: Radius = None,
    polarity: Polarity = "dark",
    merit_max: MeritMax = 0.7,
    channel: Annotated[str, typer.Option(help="Of colour pictures: grey, red, green, blue.")] = "grey",
    mask: Mask = None,
    roles: Roles = None,
    prior: Annotated[
        Path | None, typer.Option("--prior", help="Camera file with a pose: the first one is near it (30 deg, 1.3).")
    ] = None,
    frames: Annotated[
        Path | None, typer.Option(help="Table image,frame: the number of every image where frames were dropped.")
    ] = None,
    change_deg: Annotated[float, typer.Option(help="How much the rotation per frame changes from frame to frame.")] = (
        0.3
    ),
    change_percent: Annotated[
        float, typer.Option(help="How much the shift per frame changes, in percent of the markers' distance.")
    ] = 0.3,
    max_time: MaxTime = None,
    seed: Seed = 0,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the results.")] = Path("track"),
    as_json: Json = False,
) -> None:
    """Follow the model through images: pose and labels in each; bad images are flagged and stop nothing."""
    with console.errors(as_json):
        from windmark.app import track_verb

        wishes = track_verb.Wishes(images, markers, camera, unit, roles, prior, frames, mask, output)
        options = {
            "radius_px": tuple(radius) if radius else None, "polarity": polarity, "merit_max": merit_max,
            "channel": channel, "max_time_s": max_time, "seed": seed,
        }  # fmt: skip
        track_verb.follow_files(wishes, options, (change_deg, change_percent), as_json)


@app.command(epilog="Example: windmark study --radius 3 --radius 5 --noise-percent 10 --output noisy-markers")
def study(
    radius: Annotated[
        list[float] | None,
        typer.Option("--radius", "-r", help="Reference radius in pixels; give it several times. [default: 2 3 4 5]"),
    ] = None,
    span_px: Annotated[float, typer.Option(help="Real radii lie so far below and above the reference radius.")] = 0.5,
    steps: Annotated[int, typer.Option(help="Real radii per reference radius.")] = 11,
    markers: Annotated[int, typer.Option(help="Random markers per real radius, rounded up to full rows.")] = 144,
    max_tilt_deg: Annotated[float, typer.Option(help="Viewing angles are random from 0 to this.")] = 60,
    blur_passes: Annotated[int, typer.Option(help="How often the image is averaged over 3 x 3 pixels.")] = 1,
    noise_percent: Annotated[float, typer.Option(help="Noise (1 sigma) in percent of the markers' depth.")] = 3,
    depth: Annotated[float, typer.Option(help="Depth of the markers in grey levels; images have whole ones.")] = 150,
    method: Annotated[
        list[str] | None, typer.Option(help="Refinement of the centre; several times to compare. [default: all]")
    ] = None,
    seed: Seed = 0,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the results.")] = Path("marker-study"),
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


markers_app = typer.Typer(help="Work on marker tables.", no_args_is_help=True, rich_markup_mode=None)
app.add_typer(markers_app, name="markers")


@markers_app.command(
    "check", epilog="Example: windmark markers check markers.csv --unit mm -c camera.json --view-from 0,90 --within 50"
)
def markers_check(
    file: Annotated[Path, typer.Argument(help="Marker table: CSV or .tgts.")],
    unit: Unit,
    camera: Annotated[
        Path | None,
        typer.Option("--camera", "-c", help="Interior parameters. [default: 2048 x 1536 px, 30 deg field of view]"),
    ] = None,
    grid: Annotated[
        Path | None, typer.Option("--grid", "-g", help="Surface of the model: it hides markers; new places lie on it.")
    ] = None,
    role: Annotated[
        list[str] | None, typer.Option(help="Only markers of this role; several times. [default: all painted ones]")
    ] = None,
    view_from: Annotated[
        str | None,
        typer.Option(
            help="AZIMUTH,ELEVATION in degrees where the camera may stand, seen from the model: from x towards y,"
            " from the x-y plane towards z. [default: wherever two thirds as many markers are in sight as from the"
            " best direction]"
        ),
    ] = None,
    within: Annotated[float, typer.Option(help="Half angle of that region, degrees.")] = 40,
    views: Annotated[int, typer.Option(help="Virtual views in the first round, all round, three per direction.")] = 360,
    quick: Annotated[bool, typer.Option("--quick", help="120 views, whatever --views says.")] = False,
    hidden: Annotated[float, typer.Option(help="Percent of the markers in view that are not detected.")] = 30,
    false: Annotated[float, typer.Option("--false", help="False spots, percent of the markers in view.")] = 50,
    noise_px: Annotated[float, typer.Option(help="1 sigma per coordinate of a spot.")] = 0.2,
    advice: Annotated[
        bool, typer.Option("--advice/--no-advice", help="Look for markers to move or add where it is needed.")
    ] = True,
    seed: Seed = 0,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the results.")] = Path("marker-check"),
    as_json: Json = False,
) -> None:
    """Before the test: can the layout be identified from anywhere, what would help, where will the pose be weak."""
    with console.errors(as_json):
        from windmark.app import markers_verb
        from windmark.pipeline.marker_check import CheckSettings

        settings = CheckSettings(
            view_from=markers_verb.view_from(view_from), within_deg=within,
            views=markers_verb.QUICK_VIEWS if quick else views, hidden_percent=hidden, false_percent=false,
            noise_px=noise_px, advise=advice, seed=seed,
        )  # fmt: skip
        files = markers_verb.Files(file, camera, grid, unit, tuple(role or ()), output)
        markers_verb.check(files, settings, as_json)


@app.command(epilog="Example: windmark run project.toml")
def run(
    project: Annotated[Path, typer.Argument(help="Project file (TOML).")],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Folder instead of the project's own.")] = None,
    max_time: MaxTime = None,
    roles: Roles = None,
    no_occlusion: NoOcclusion = False,
    as_json: Json = False,
) -> None:
    """The main job: from images to values on the grid, with pictures and one HTML report."""
    from windmark.app import verbs

    with console.errors(as_json):
        verbs.run(project, output, as_json, max_time_s=max_time, roles=tuple(roles or ()), no_occlusion=no_occlusion)


camera_commands.add(app)


def main() -> None:
    """Entry point of the ``windmark`` command."""
    # Our matrices are small and images run in threads of their own: threads of BLAS would only get in their
    # way (on two busy cores milliseconds become seconds). Must be said before numpy is imported.
    for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    app()


if __name__ == "__main__":
    main()
