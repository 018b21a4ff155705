"""The command ``windmark calibrate``. Heavy imports wait until it runs."""

from __future__ import annotations

from pathlib import Path

from windmark.app import console
from windmark.app.commands import calibrate_arguments as a
from windmark.app.commands.matching_options import Mask, Roles
from windmark.app.commands.options import Bayer, Channel, Json, MarkersGrid, MeritMax, OnePolarity, Radius, Seed
from windmark.options.calibration import (
    ECCENTRICITY,
    MATCH_TIME_S,
    MATCH_TOLERANCE_PX,
    MAX_SIGMA0,
    REJECT,
    RIG,
    SIGMA_PX,
    SOLVER,
)
from windmark.options.detection import BAYER, CHANNEL, MERIT_MAX, POLARITY
from windmark.options.registration import SEED


def calibrate(
    inputs: a.Inputs,
    unit: a.Unit,
    markers: a.Markers = None,
    grid: MarkersGrid = None,
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
    free_principal: a.FreePrincipal = None,
    distance: a.Distances = None,
    rig: a.Rig = RIG.default,
    eccentricity: a.Eccentricity = ECCENTRICITY.default,
    reject: a.Reject = REJECT.default,
    max_sigma0: a.MaxSigma0 = MAX_SIGMA0.default,
    sigma_px: a.SigmaPx = SIGMA_PX.default,
    against: a.Against = None,
    board: a.BoardPitch = None,
    board_marks: a.BoardMarks = None,
    board_size: a.BoardSize = None,
    board_layout: a.BoardLayout = "square",
    radius: Radius = None,
    polarity: OnePolarity = POLARITY.default,
    merit_max: MeritMax = MERIT_MAX.default,
    channel: Channel = CHANNEL.default,
    bayer: Bayer = BAYER.default,
    mask: Mask = None,
    label: a.Label = None,
    labels: a.Labels = None,
    tolerance_px: a.Tolerance = MATCH_TOLERANCE_PX.default,
    max_time: a.MaxTime = MATCH_TIME_S.default,
    roles: Roles = None,
    solver: a.Solver = SOLVER.default,
    seed: Seed = SEED.default,
    output: a.Output = Path("calibration"),
    as_json: Json = False,
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

        dots = typed.parse_board(board, board_marks, board_size, board_layout, unit)
        model, wanted = typed.parse_lens(lens, free)
        settings = CalibrateSettings(
            typed.parse_datum(datum, needed=dots is None), wanted,
            typed.parse_distances(distance or ()), rig, tuple(free_focal or ()), tuple(free_principal or ()),
            typed.parse_priors(
                prior_sigma or (), {"--free-focal": free_focal, "--free-principal": free_principal}
            ), eccentricity, reject, max_sigma0, seed, solver, model,
        )  # fmt: skip
        match = MatchOptions(
            tuple(radius or ()), polarity, merit_max, channel, bayer, mask, typed.parse_labels(label or (), labels),
            tolerance_px, max_time, seed,
        )  # fmt: skip
        files = Files(
            typed.expanded(inputs), markers, dots, tuple(roles or ()), typed.read_cameras(camera or ()),
            typed.parse_patterns(images_of or ()), parse_size(size), focal, unit, sigma_px, against, output,
            control_cov, grid,
        )  # fmt: skip
        run(files, settings, match, as_json)
