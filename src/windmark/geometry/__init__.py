"""Pure maths on arrays: rotations, poses, cameras and the solvers built from them. Knows no marker."""

from windmark.geometry.camera import PARAMETERS, Camera
from windmark.geometry.curvature import surface_curvature
from windmark.geometry.discs import ImagedEllipse, imaged_ellipse
from windmark.geometry.errors import DegenerateGeometry
from windmark.geometry.p3p import P3PSolutions, p3p
from windmark.geometry.p4pf import FocalPose, p4pf
from windmark.geometry.pose import Pose, PoV
from windmark.geometry.similarity import Similarity, align
from windmark.geometry.triangulation import Triangulation, triangulate
from windmark.geometry.two_view import (
    TwoView,
    epipolar_curve,
    epipolar_distance,
    epipolar_lines,
    essential_from_poses,
    estimate_two_view,
    fundamental_from_poses,
    relative_pose_refine,
    sampson_distance,
)

__all__ = [
    "PARAMETERS",
    "Camera",
    "DegenerateGeometry",
    "FocalPose",
    "ImagedEllipse",
    "P3PSolutions",
    "PoV",
    "Pose",
    "Similarity",
    "Triangulation",
    "TwoView",
    "align",
    "epipolar_curve",
    "epipolar_distance",
    "epipolar_lines",
    "essential_from_poses",
    "estimate_two_view",
    "fundamental_from_poses",
    "imaged_ellipse",
    "p3p",
    "p4pf",
    "relative_pose_refine",
    "sampson_distance",
    "surface_curvature",
    "triangulate",
]
