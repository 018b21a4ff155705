"""Find markers in an image: the paper's SPOT detector."""

from windmark.detection.dead import dead_pixels
from windmark.detection.detect import detect, explain
from windmark.detection.either import AUTO, FEW, Look, find_markers
from windmark.detection.guided import Guided, detect_at
from windmark.detection.guided_judge import ANSWERS
from windmark.detection.hints import hint
from windmark.detection.merit import merit_map
from windmark.detection.radius import RadiusEstimate, estimate_radius
from windmark.detection.rejected import REASONS, Rejected
from windmark.detection.why_none import why_none

__all__ = [
    "ANSWERS", "AUTO", "FEW", "REASONS", "Guided", "Look", "RadiusEstimate", "Rejected", "dead_pixels", "detect",
    "detect_at", "estimate_radius", "explain", "find_markers", "hint", "merit_map", "why_none",
]  # fmt: skip
