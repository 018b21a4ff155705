"""In-situ self-calibration: cameras, poses and marker coordinates from pictures of markers."""

from windmark.calibration.datum import Distance, Fixed, Free, Weighted
from windmark.calibration.result import CAUSES, Calibration, NotCalibrated
from windmark.calibration.self_calibrate import self_calibrate

__all__ = ["CAUSES", "Calibration", "Distance", "Fixed", "Free", "NotCalibrated", "Weighted", "self_calibrate"]
