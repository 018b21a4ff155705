"""In-situ self-calibration: cameras, poses and marker coordinates from pictures of markers."""

from windmark.calibration.datum import Distance, Fixed, Free, Weighted
from windmark.calibration.result import CAUSES, Calibration, NotCalibrated
from windmark.calibration.self_calibrate import self_calibrate
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
    "CAUSES", "KEEP", "Calibration", "CorrectedImage", "Distance", "Fixed", "Free", "NotCalibrated",
    "Weighted", "corrected_camera", "magnified_camera", "magnify_distortion", "redraw",
    "self_calibrate", "undistort",
]  # fmt: skip
