"""The command ``windmark calibrate``. Heavy imports wait until it runs."""

from __future__ import annotations

from pathlib import Path

from windmark.app import console
from windmark.app.commands import calibrate_arguments as a
from windmark.app.commands.matching_options import Mask, Roles


def calibrate(
    inputs: a.Inputs,
    unit: a.Unit,
    markers: a.Markers = None,
    datum: a.Datum = None,
    control_cov: a.ControlCov = None,
    camera: a.Cameras = None,
    images_of: a.ImagesOf = None,
    size: a.Size = None,
    focal: a.Focal = None,
    lens: a.Lens = None,
    free: a.Parameters = None,
    prior_sigma: a.PriorSigma = None,
    free_focal: a.FreeFocal = None,
    distance: a.Distances = None,
    rig: a.Rig = False,
    eccentricity: a.Eccentricity = "auto",
    reject: a.Reject = True,
    max_sigma0: a.MaxSigma0 = 5,
    sigma_px: a.SigmaPx = 0.1,
    against: a.Against = None,
    board: a.BoardPitch = None,
    board_marks: a.BoardMarks = None,
    board_size: a.BoardSize = None,
    board_layout: a.BoardLayout = "square",
    radius: a.Radius = None,
    polarity: a.Polarity = "dark",
    merit_max: a.MeritMax = 0.7,
    channel: a.Channel = "grey",
    bayer: a.Bayer = None,
    mask: Mask = None,
    label: a.Label = None,
    labels: a.Labels = None,
    tolerance_px: a.Tolerance = None,
    max_time: a.MaxTime = 2.0,
    roles: Roles = None,
    solver: a.Solver = "newton",
    seed: a.Seed = 0,
    output: a.Output = Path("calibration"),
    as_json: a.AsJson = False,
) -> None:
    """Calibrate cameras in place: interior parameters, poses and marker coordinates with their uncertainties.

    Needed: many pictures of the same markers from different directions, some of them rolled, at one focus setting.
    Rough coordinates may be off by some percent of the model; no poses and no focal length are needed. For pictures of
    a regular board of dots its pitch is enough.
    """
    with console.errors(as_json):
        from windmark.app import calibrate_options as typed
        from windmark.app.calibrate_verb import Files, run
        from windmark.app.convert_verb import parse_size
        from windmark.pipeline.calibrate import CalibrateSettings, MatchOptions

        dots = typed.parse_board(board, board_marks, board_size, board_layout)
        model, wanted = typed.parse_lens(lens, free)
        settings = CalibrateSettings(
            typed.parse_datum(datum, needed=dots is None), wanted,
            typed.parse_distances(distance or ()), rig, tuple(free_focal or ()), typed.parse_priors(prior_sigma or ()),
            eccentricity, reject, max_sigma0, seed, solver, model,
        )  # fmt: skip
        match = MatchOptions(
            tuple(radius or ()), polarity, merit_max, channel, bayer, mask, typed.parse_labels(label or (), labels),
            tolerance_px, max_time, seed,
        )  # fmt: skip
        files = Files(
            typed.expanded(inputs), markers, dots, tuple(roles or ()), typed.read_cameras(camera or ()),
            typed.parse_patterns(images_of or ()), parse_size(size), focal, unit, sigma_px, against, output,
            control_cov,
        )  # fmt: skip
        run(files, settings, match, as_json)
