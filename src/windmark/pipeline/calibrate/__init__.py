"""From matched marks, or pictures and rough markers, to a calibration with its quality, and its files."""

from windmark.pipeline.calibrate.marks import Marks, cameras_of, from_table
from windmark.pipeline.calibrate.outputs import read_known, record, write_calibration
from windmark.pipeline.calibrate.pictures import MatchedPicture, MatchOptions, calibrate_pictures
from windmark.pipeline.calibrate.run import Calibrated, CalibrateSettings, calibrate_marks

__all__ = [
    "CalibrateSettings", "Calibrated", "Marks", "MatchOptions", "MatchedPicture", "calibrate_marks",
    "calibrate_pictures", "cameras_of", "from_table", "read_known", "record", "write_calibration",
]  # fmt: skip
