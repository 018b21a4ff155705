"""From pictures of a dot board to a calibration: read, find the spots; `tasks.calibrate` finds the board in them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from windmark import detection, io
from windmark.calibration import NotCalibrated
from windmark.geometry import Camera
from windmark.pipeline.calibrate.read import MatchOptions, find_spots, read_image, read_pictures
from windmark.pipeline.clock import Clock
from windmark.scene import Detections
from windmark.tasks.blur import spot_blur
from windmark.tasks.calibrate import Board, BoardPicture, Calibrated, CalibrateSettings, calibrate_dots
from windmark.tasks.calibrate.board import check_board
from windmark.tasks.calibrate.marks import Taken

HOLES = (0.25, 0.35, 0.5)
"""Radii of holes that are looked for, as parts of the dots' radius."""
OTHER = {"dark": "bright", "bright": "dark"}


def calibrate_board(
    paths: Sequence[io.PictureFile],
    board: Board,
    cameras: Mapping[str, Camera | None],
    options: MatchOptions,
    settings: CalibrateSettings,
    clock: Clock,
    focal_px: float | None = None,
    patterns: Mapping[str, str] | None = None,
) -> tuple[Calibrated | NotCalibrated, tuple[BoardPicture, ...]]:
    """Find the board in each picture and calibrate.

    Parameters
    ----------
    paths : the pictures
    board : what is known of it
    cameras : by name; None for a camera of which nothing is known
    options : of detection; labels and what else is for matching have no meaning here
    settings : of calibrating. Without a datum: `Free` over all dots where the marks tell them apart (the board is
        measured; on average it is the nominal one), else all dots are held where they should be
    clock : of the stages
    focal_px : rough focal length of unknown cameras; None finds it
    patterns : camera -> pattern of its pictures' names, see `marks.taken_by`

    Returns
    -------
    The calibration, or why there is none; and what became of each picture.

    Raises
    ------
    ValueError
        For fewer than two readable pictures, sizes that differ, a datum or a rig that needs dots that are told apart.
    """
    check_board(board, settings)

    def look(path: io.PictureFile, name: str, taken: Taken) -> BoardPicture:
        return _detect(path, name, taken, board, options)

    with clock("detect"):
        pictures, found = read_pictures(paths, cameras, patterns or {}, focal_px, look, clock.progress)
    return calibrate_dots(
        pictures, board, found, settings, given=cameras,
        unknown_focal=focal_px is None and None in cameras.values(), stage=clock,
    )  # fmt: skip


def _detect(
    path: io.PictureFile, name: str, taken: Taken, board: Board, options: MatchOptions
) -> BoardPicture:
    image, mask = read_image(path, options)
    spots = find_spots(image, mask, options)
    holes = None
    if board.marks and board.mark_kind == "holes":
        radius = float(np.nanmedian(spots.radius_px)) if np.isfinite(spots.radius_px).any() else np.nan
        tried = [r for r in np.multiply(HOLES, radius) if r >= 1.0]
        holes = Detections.make(np.zeros((0, 2)))
        if tried:
            holes = detection.detect(image, radius_px=tried, polarity=OTHER[options.polarity], mask=mask)
    size = (int(image.shape[1]), int(image.shape[0]))
    blur, radius = spot_blur(image, spots, options.polarity)
    return BoardPicture(name, taken.camera, size, spots, taken.frame, blur_px=blur, radius_px=radius, holes=holes)
