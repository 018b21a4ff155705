"""From matched marks, or pictures of markers or of a dot board, to a calibration with its quality, and its files."""

from windmark.pipeline.calibrate.board import Board, BoardPicture, calibrate_board
from windmark.pipeline.calibrate.marks import Marks, Taken, from_table, taken_by
from windmark.pipeline.calibrate.outputs import read_known, record, write_calibration
from windmark.pipeline.calibrate.pictures import MatchedPicture, calibrate_pictures
from windmark.pipeline.calibrate.read import MatchOptions, Picture
from windmark.pipeline.calibrate.run import Calibrated, CalibrateSettings, calibrate_marks

__all__ = [
    "Board", "BoardPicture", "CalibrateSettings", "Calibrated", "Marks", "MatchOptions", "MatchedPicture", "Picture",
    "Taken", "calibrate_board", "calibrate_marks", "calibrate_pictures", "from_table", "read_known", "record",
    "taken_by", "write_calibration",
]  # fmt: skip
