"""Pure maths on arrays: rotations, poses, cameras and the solvers built from them. Knows no marker."""

from windmark.geometry.camera import PARAMETERS, Camera
from windmark.geometry.errors import DegenerateGeometry
from windmark.geometry.p3p import P3PSolutions, p3p
from windmark.geometry.pose import Pose, PoV

__all__ = ["PARAMETERS", "Camera", "DegenerateGeometry", "P3PSolutions", "PoV", "Pose", "p3p"]
