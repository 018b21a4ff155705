"""An infrared run: pictures with poses and deformations to temperatures on the model, and these to heat flux."""

from windmark.tasks.infrared.flags import (
    BEFORE,
    BEYOND,
    BRIDGED,
    CURVED,
    FLAGS,
    GAP,
    LATE,
    LATERAL,
    MARKER,
    NO_EMISSIVITY,
    NO_START,
    NO_WALL,
    SATURATED,
    UNSEEN,
    flag_words,
)
from windmark.tasks.infrared.histories import HistoryFlux, behind_gaps, history_flux
from windmark.tasks.infrared.temperatures import (
    CameraTemperature,
    SurfaceLight,
    frame_temperatures,
    merged_temperature,
)

__all__ = [
    "BEFORE", "BEYOND", "BRIDGED", "CURVED", "FLAGS", "GAP", "LATE", "LATERAL", "MARKER", "NO_EMISSIVITY", "NO_START",
    "NO_WALL", "SATURATED", "UNSEEN", "CameraTemperature", "HistoryFlux", "SurfaceLight", "behind_gaps",
    "flag_words", "frame_temperatures", "history_flux", "merged_temperature",
]  # fmt: skip
