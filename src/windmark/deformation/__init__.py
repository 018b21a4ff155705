"""Model deformation: laws per volume, identified together with rigid motion and camera poses."""

from windmark.deformation.check import check_law
from windmark.deformation.held import Held, with_parameters
from windmark.deformation.identify import identify
from windmark.deformation.law import BoundLaw, FunctionLaw, Law, LawError, Linear, Numeric, function_law, law
from windmark.deformation.parameter import Parameter
from windmark.deformation.result import Deformation, NotIdentified, vertex_volumes
from windmark.deformation.user import UserLaw, laws_of_source
from windmark.deformation.volumes import Placed, Volume, Volumes

__all__ = [
    "BoundLaw", "Deformation", "FunctionLaw", "Held", "Law", "LawError", "Linear", "NotIdentified", "Numeric",
    "Parameter", "Placed", "UserLaw", "Volume", "Volumes", "check_law", "function_law", "identify", "law",
    "laws_of_source", "vertex_volumes", "with_parameters",
]  # fmt: skip
