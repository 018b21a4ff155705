"""Options of how cameras are calibrated."""

from __future__ import annotations

from windmark.options.option import Option
from windmark.options.registration import TOLERANCE_PX

RIG = Option("rig", False, "Several cameras that do not move against each other; frames are instants.")
ECCENTRICITY = Option(
    "eccentricity", "auto",
    "Of imaged discs: auto (normals from ellipses in pictures, the table or the neighbours), table or off.",
    choices=("auto", "table", "off"),
)  # fmt: skip
REJECT = Option("reject", True, "Leave gross errors out.", flag="--reject/--no-reject")
MAX_SIGMA0 = Option("max_sigma0", 5.0, "Residuals so many times larger than the sigmas are refused.", above=0.0)
SIGMA_PX = Option("sigma_px", 0.1, "Of marks whose table has no sigma, per coordinate.", "px", above=0.0)
SOLVER = Option(
    "solver", "newton",
    "newton, or steps: the paper's own growing and shrinking steps per parameter, to compare; hundreds of times slower,"
    " and a valley of focal length and distance may hold it up.",
    choices=("newton", "steps"),
)  # fmt: skip
MATCH_TOLERANCE_PX = TOLERANCE_PX.but(None, help="How far rough markers may be off.", otherwise="0.3 of their spacing")
MATCH_TIME_S = Option("max_time_s", 2.0, "Seconds of CPU time per matching.", "s", above=0.0, flag="--max-time")

OPTIONS = (RIG, ECCENTRICITY, REJECT, MAX_SIGMA0, SIGMA_PX, SOLVER, MATCH_TOLERANCE_PX, MATCH_TIME_S)
