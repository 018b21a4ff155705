"""Find markers in an image: the paper's SPOT detector."""

from windmark.detection.detect import detect, explain
from windmark.detection.merit import merit_map
from windmark.detection.radius import RadiusEstimate, estimate_radius
from windmark.detection.rejected import REASONS, Rejected

__all__ = ["REASONS", "RadiusEstimate", "Rejected", "detect", "estimate_radius", "explain", "merit_map"]
