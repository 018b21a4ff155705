"""Nouns only: frozen columns of arrays, no algorithms."""

from windmark.scene.detections import FLAGS, Detections, Matching
from windmark.scene.doubt import Doubt
from windmark.scene.marker_covariance import MarkerCovariance
from windmark.scene.markers import ROLES, MarkerSet
from windmark.scene.mesh import Block, Mesh, structured_triangles
from windmark.scene.observations import Observations, Tracks, View

__all__ = [
    "FLAGS", "ROLES", "Block", "Detections", "Doubt", "MarkerCovariance", "MarkerSet", "Matching", "Mesh",
    "Observations", "Tracks", "View", "structured_triangles",
]  # fmt: skip
