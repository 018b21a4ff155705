"""Options of how spots are matched to markers."""

from __future__ import annotations

from typing import Literal, get_args

from windmark.options.option import Option

Method = Literal["hash", "ransac"]

METHOD: Option[Method] = Option(
    "method", "hash", "hash (a table of how four neighbours can look), or ransac: the paper's search, slower.",
    choices=get_args(Method),
)  # fmt: skip
PRIOR_MAX_ANGLE_DEG = Option(
    "prior_max_angle_deg", 30.0, "Largest angle between solution and prior, degrees.", "degrees", above=0.0, most=180.0,
    flag="--prior-max-angle",
)  # fmt: skip
PRIOR_MAX_SCALE = Option("prior_max_scale", 1.3, "Largest ratio of the scales of solution and prior; > 1.", above=1.0)
TOLERANCE_PX: Option[None] = Option(
    "tolerance_px", None, "Largest distance of a spot to its marker.", "px", above=0.0,
    otherwise="from the picture's size and the markers' spacing",
)  # fmt: skip
FREE_FOCAL = Option(
    "free_focal", False, "The focal length is only roughly known: find it too.",
    flag="--free-focal/--no-free-focal",
)  # fmt: skip
MAX_TIME_S: Option[None] = Option(
    "max_time_s", None, "Seconds of CPU time per image, then a refusal.", "s", above=0.0, flag="--max-time",
    otherwise="no limit but that of the work",
)  # fmt: skip
MAX_TABLE_ERROR = Option(
    "max_table_error", 0.025, "How far markers may be off their table, as part of the distance between them.",
    above=0.0, flag=None,
)  # fmt: skip
MAX_DEFORMATION = Option(
    "max_deformation", 0.05, "How far the model may be deformed, as part of its size.", least=0.0, most=0.1, flag=None
)
LABEL_DISTANCE_PX = Option(
    "label_distance_px", 10.0, "A label means the nearest spot within so many pixels.", "px", above=0.0, flag=None
)
BINDING = Option(
    "binding", False, "Given labels are facts: no solution without them is compared, and nothing overrules them."
)
OCCLUSION = Option(
    "occlusion", True, "Markers that the grid hides are neither expected nor matched.", flag="--no-occlusion"
)
SEED = Option("seed", 0, "Seed of every random choice: same seed, same result.", least=0)

OPTIONS = (
    METHOD, PRIOR_MAX_ANGLE_DEG, PRIOR_MAX_SCALE, TOLERANCE_PX, FREE_FOCAL, MAX_TIME_S, MAX_TABLE_ERROR,
    MAX_DEFORMATION, LABEL_DISTANCE_PX, BINDING, OCCLUSION, SEED,
)  # fmt: skip
