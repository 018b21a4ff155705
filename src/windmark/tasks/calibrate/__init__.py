"""Calibrating from marks, from spots and rough markers, or from the spots of a dot board."""

from windmark.tasks.calibrate.board import calibrate_dots
from windmark.tasks.calibrate.board_picture import Board, BoardPicture
from windmark.tasks.calibrate.marks import Marks, Taken, taken_by
from windmark.tasks.calibrate.picture import Picture
from windmark.tasks.calibrate.pictures import MatchedPicture, MatchSettings, calibrate_matching
from windmark.tasks.calibrate.run import Calibrated, CalibrateSettings, calibrate_marks

__all__ = [
    "Board", "BoardPicture", "CalibrateSettings", "Calibrated", "Marks", "MatchSettings", "MatchedPicture", "Picture",
    "Taken", "calibrate_dots", "calibrate_marks", "calibrate_matching", "taken_by",
]  # fmt: skip
