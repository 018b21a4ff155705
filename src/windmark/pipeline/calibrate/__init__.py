"""From matched marks, or pictures of markers or of a dot board, to a calibration with its quality, and its files."""

from windmark.pipeline.calibrate.from_board import calibrate_board
from windmark.pipeline.calibrate.from_pictures import calibrate_pictures
from windmark.pipeline.calibrate.outputs import read_known, record, write_calibration
from windmark.pipeline.calibrate.read import MatchOptions
from windmark.pipeline.calibrate.table import from_table
from windmark.tasks.calibrate.board_picture import Board, BoardPicture
from windmark.tasks.calibrate.marks import Marks, Taken, taken_by
from windmark.tasks.calibrate.picture import Picture
from windmark.tasks.calibrate.pictures import MatchedPicture
from windmark.tasks.calibrate.run import Calibrated, CalibrateSettings, calibrate_marks

__all__ = [
    "Board", "BoardPicture", "CalibrateSettings", "Calibrated", "Marks", "MatchOptions", "MatchedPicture", "Picture",
    "Taken", "calibrate_board", "calibrate_marks", "calibrate_pictures", "from_table", "read_known", "record",
    "taken_by", "write_calibration",
]  # fmt: skip
