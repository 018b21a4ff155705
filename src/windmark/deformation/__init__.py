"""Model deformation: laws per volume, identified together with rigid motion and camera poses."""

from windmark.deformation.check import check_law
from windmark.deformation.compare import LawChoice, compare_laws
from windmark.deformation.held import Held, with_parameters
from windmark.deformation.identify import identify
from windmark.deformation.law import BoundLaw, FunctionLaw, Law, LawError, Linear, Numeric, function_law, law
from windmark.deformation.parameter import Parameter
from windmark.deformation.result import Deformation, NotIdentified, bound_vertices, vertex_volumes
from windmark.deformation.stations import SpanValues, Stations, span_values
from windmark.deformation.stereo import Displacements, MarkerPlaces, displacements, marker_places
from windmark.deformation.user import UserLaw, laws_of_source
from windmark.deformation.volumes import Placed, Volume, Volumes
from windmark.deformation.weakness import weak_directions
from windmark.deformation.zero import ZeroMarkers, zero_markers

__all__ = [
    "BoundLaw", "Deformation", "Displacements", "FunctionLaw", "Held", "Law", "LawChoice", "LawError", "Linear",
    "MarkerPlaces", "NotIdentified", "Numeric", "Parameter", "Placed", "SpanValues", "Stations", "UserLaw", "Volume",
    "Volumes", "ZeroMarkers", "bound_vertices", "check_law", "compare_laws", "displacements", "function_law",
    "identify", "law", "laws_of_source", "marker_places", "span_values", "vertex_volumes", "weak_directions",
    "with_parameters", "zero_markers",
]  # fmt: skip
