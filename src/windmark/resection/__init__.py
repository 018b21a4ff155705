"""Image to model surface and back: pixel maps, visibility, virtual images, values on nodes."""

from windmark.resection.footprints import (
    FootprintPlanes,
    Footprints,
    FootprintValues,
    PlaneBend,
    footprint_values,
    footprints,
    plane_bend,
)
from windmark.resection.gains import Gains
from windmark.resection.merged_views import MergedValues, MergedViews, NotMerged
from windmark.resection.merging import merge_views
from windmark.resection.nearest import SurfacePoints, nearest_on_surface
from windmark.resection.noise import NoiseLaw, noise_law
from windmark.resection.orientation import orient_outward, sides_in_doubt, wound_both_ways
from windmark.resection.outlines import inside_px, outline_distance
from windmark.resection.pixelmap import PixelMap, map_pixels
from windmark.resection.point_values import (
    POINT_REASONS,
    PointValues,
    point_reasons,
    point_values,
    reason_words,
    sample_points,
)
from windmark.resection.profiles import LineProfile, SurfaceLine, sample_line, surface_line
from windmark.resection.reasons import REASONS
from windmark.resection.sampling import INTERPOLATIONS, interpolate_image, node_values, sample
from windmark.resection.seams import Seams
from windmark.resection.sections import Section, section
from windmark.resection.silhouettes import silhouette
from windmark.resection.sources import Picture
from windmark.resection.surface_view import see_surface
from windmark.resection.virtual import see_pixels, virtual_image
from windmark.resection.visibility import NodeView, see_nodes, see_points
from windmark.resection.warping import warp_image

__all__ = [
    "INTERPOLATIONS", "POINT_REASONS", "REASONS", "FootprintPlanes", "FootprintValues", "Footprints", "Gains",
    "LineProfile", "MergedValues", "MergedViews", "NodeView", "NoiseLaw", "NotMerged", "Picture", "PixelMap",
    "PlaneBend", "PointValues", "Seams", "Section", "SurfaceLine", "SurfacePoints", "footprint_values", "footprints",
    "inside_px", "interpolate_image", "map_pixels", "merge_views", "nearest_on_surface", "node_values", "noise_law",
    "orient_outward", "outline_distance", "plane_bend", "point_reasons", "point_values", "reason_words", "sample",
    "sample_line", "sample_points", "section", "see_nodes", "see_pixels", "see_points", "see_surface",
    "sides_in_doubt", "silhouette", "surface_line", "virtual_image", "warp_image", "wound_both_ways",
]  # fmt: skip
