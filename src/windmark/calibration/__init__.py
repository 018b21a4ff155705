"""In-situ self-calibration: cameras, poses and marker coordinates from pictures of markers."""

from windmark.calibration.board import BoardNotFound, BoardView, board_marker_set, find_board, find_boards
from windmark.calibration.datum import Distance, Fixed, Free, Weighted
from windmark.calibration.result import CAUSES, Calibration, NotCalibrated
from windmark.calibration.self_calibrate import self_calibrate
from windmark.calibration.start_focal import FocalNotDetermined, StartFocal, start_focal
from windmark.calibration.transform import in_datum
from windmark.calibration.undistort import (
    KEEP,
    CorrectedImage,
    corrected_camera,
    magnified_camera,
    magnify_distortion,
    redraw,
    undistort,
)

__all__ = [
    "CAUSES", "KEEP", "BoardNotFound", "BoardView", "Calibration", "CorrectedImage", "Distance", "Fixed",
    "FocalNotDetermined", "Free", "NotCalibrated", "StartFocal", "Weighted", "board_marker_set", "corrected_camera",
    "find_board", "find_boards", "in_datum", "magnified_camera", "magnify_distortion", "redraw", "self_calibrate",
    "start_focal", "undistort",
]  # fmt: skip
