"""Two views: essential and fundamental matrices, homographies, and the relative pose of two pictures."""

from windmark.geometry.two_view.curve import epipolar_curve
from windmark.geometry.two_view.decompose import (
    PlanePose,
    cheirality,
    decompose_essential,
    decompose_homography,
    homography_from_plane,
    pose_from_essential,
    ray_depths,
)
from windmark.geometry.two_view.distances import (
    EpipolarDistance,
    epipolar_distance,
    epipolar_lines,
    sampson_distance,
    symmetric_epipolar_distance,
)
from windmark.geometry.two_view.estimate import estimate_two_view
from windmark.geometry.two_view.five_point import essential_five_point
from windmark.geometry.two_view.fundamental import Fundamental, refine_fundamental
from windmark.geometry.two_view.homography import fit_homography, robust_homography, transfer
from windmark.geometry.two_view.homography_refine import Homography, refine_homography
from windmark.geometry.two_view.linear import fundamental_eight_point, fundamental_seven_point
from windmark.geometry.two_view.matrices import (
    epipoles,
    essential_from_fundamental,
    essential_from_poses,
    fundamental_from_essential,
    fundamental_from_poses,
    ideal_pixels,
)
from windmark.geometry.two_view.others import ByOthers, fundamental_by_others, pose_by_others
from windmark.geometry.two_view.pairs import rays_with_cov
from windmark.geometry.two_view.refine import RelativePose, refine_essential, relative_pose_refine
from windmark.geometry.two_view.result import TwoView

__all__ = [
    "ByOthers",
    "EpipolarDistance",
    "Fundamental",
    "Homography",
    "PlanePose",
    "RelativePose",
    "TwoView",
    "cheirality",
    "decompose_essential",
    "decompose_homography",
    "epipolar_curve",
    "epipolar_distance",
    "epipolar_lines",
    "epipoles",
    "essential_five_point",
    "essential_from_fundamental",
    "essential_from_poses",
    "estimate_two_view",
    "fit_homography",
    "fundamental_eight_point",
    "fundamental_by_others",
    "fundamental_from_essential",
    "fundamental_from_poses",
    "fundamental_seven_point",
    "homography_from_plane",
    "ideal_pixels",
    "pose_from_essential",
    "pose_by_others",
    "ray_depths",
    "rays_with_cov",
    "refine_essential",
    "refine_fundamental",
    "refine_homography",
    "relative_pose_refine",
    "robust_homography",
    "sampson_distance",
    "symmetric_epipolar_distance",
    "transfer",
]
