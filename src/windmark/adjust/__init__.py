"""The one adjustment: non-linear least squares over cameras, poses and points.

Jobs differ only in what is free. `refine_pose` is the first; others are further blocks and terms of the same
`Problem`, solved by the same `minimise`.
"""

from windmark.adjust.blocks import POSE_PARAMETERS, CameraBlock, PoseBlock, VectorBlock
from windmark.adjust.chance import chance, log_tail
from windmark.adjust.determinacy import covariance, weak_parameters
from windmark.adjust.exchanged import exchanged_pairs
from windmark.adjust.levenberg_marquardt import SolveOptions, minimise
from windmark.adjust.loss import Loss
from windmark.adjust.paper_engine import PaperOptions, minimise_by_steps
from windmark.adjust.pose import pose_problem, refine_pose
from windmark.adjust.pose_estimate import PoseEstimate
from windmark.adjust.problem import NormalEquations, Problem
from windmark.adjust.report import REASONS, SolveReport
from windmark.adjust.terms import JointPrior, Linearised, Prior, Reprojection

__all__ = [
    "refine_pose", "PoseEstimate", "SolveReport", "REASONS",
    "pose_problem", "minimise", "SolveOptions", "minimise_by_steps", "PaperOptions",
    "Problem", "NormalEquations", "PoseBlock", "CameraBlock", "VectorBlock", "Reprojection", "Linearised", "Prior",
    "JointPrior", "Loss", "POSE_PARAMETERS", "chance", "log_tail", "covariance", "exchanged_pairs", "weak_parameters",
]  # fmt: skip
