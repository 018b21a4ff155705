"""Image to model surface and back: pixel maps, visibility, virtual images, values on nodes."""

from windmark.resection.orientation import orient_outward
from windmark.resection.pixelmap import PixelMap, map_pixels
from windmark.resection.profiles import LineProfile, sample_line
from windmark.resection.reasons import REASONS
from windmark.resection.sampling import INTERPOLATIONS, interpolate_image, node_values, sample
from windmark.resection.sections import Section, section
from windmark.resection.silhouettes import silhouette
from windmark.resection.virtual import see_pixels, virtual_image
from windmark.resection.visibility import NodeView, see_nodes, see_points
from windmark.resection.warping import warp_image

__all__ = [
    "INTERPOLATIONS", "REASONS", "LineProfile", "NodeView", "PixelMap", "Section", "interpolate_image", "map_pixels",
    "node_values", "orient_outward", "sample", "sample_line", "section", "see_nodes", "see_pixels", "see_points",
    "silhouette", "virtual_image", "warp_image",
]  # fmt: skip
