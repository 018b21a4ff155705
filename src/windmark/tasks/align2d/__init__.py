"""2D alignment: a picture recomputed on another one by their markers, without a grid and without a camera."""

from windmark.tasks.align2d.align import align_images
from windmark.tasks.align2d.matching import NoMatching, SpotMatching, match_spots
from windmark.tasks.align2d.result import ImageAlignment, NotAligned

__all__ = ["ImageAlignment", "NoMatching", "NotAligned", "SpotMatching", "align_images", "match_spots"]
