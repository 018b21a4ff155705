"""Find markers in an image: the paper's SPOT detector."""

from windmark.detection.detect import detect
from windmark.detection.merit import merit_map

__all__ = ["detect", "merit_map"]
