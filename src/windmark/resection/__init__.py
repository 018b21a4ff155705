"""Image to model surface and back: pixel maps, visibility, virtual images, values on nodes."""

from windmark.resection.pixelmap import PixelMap, map_pixels
from windmark.resection.sampling import INTERPOLATIONS, interpolate_image, node_values, sample
from windmark.resection.virtual import see_pixels, virtual_image
from windmark.resection.visibility import REASONS, NodeView, see_nodes, see_points

__all__ = [
    "INTERPOLATIONS", "REASONS", "NodeView", "PixelMap", "interpolate_image", "map_pixels", "node_values", "sample",
    "see_nodes", "see_pixels", "see_points", "virtual_image",
]  # fmt: skip
