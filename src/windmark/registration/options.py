"""Options of `register` and `track`: their ranges, and the neighbourhood that the search takes by default."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.errors import UsageError
from windmark.geometry import Camera, Pose
from windmark.geometry.order import median
from windmark.options.registration import MAX_DEFORMATION, METHOD
from windmark.registration.task import near_px
from windmark.scene import MarkerSet

Array = NDArray[np.float64]

METHODS = METHOD.choices
MOST_DEFORMATION = MAX_DEFORMATION.most
DEFAULT_TOLERANCE, MAX_SPACING, TABLE_SIGMAS = 0.004, 0.2, 5.0
"""Neighbourhood: part of the image's diagonal or, where that is more, so many sigma of the table; and at most this part
of the spots' spacing."""


def check_options(verb: str, options: dict[str, Any], prior: Pose | None) -> None:
    """Raise for a method that does not exist, a prior that is a batch, and numbers out of range."""
    if options["method"] not in METHODS:
        raise UsageError(f"{verb}: method must be one of {', '.join(METHODS)}, got {options['method']!r}")
    if prior is not None and prior.rotation.ndim != 2:
        raise ValueError(f"{verb}: prior must be a single pose, got a batch {prior.rotation.shape[:-2]}")
    positive = ("prior_max_angle_deg", "max_focal_sigma", "max_hypotheses", "max_time_s", "max_table_error")
    above_one = ("prior_max_scale", "focal_range")
    for name in positive:
        if options[name] is not None and not options[name] > 0:
            raise UsageError(f"{verb}: {name} must be > 0, got {options[name]}")
    for name in above_one:
        if not options[name] > 1:
            raise UsageError(f"{verb}: {name} is a ratio and must be > 1, got {options[name]}")
    tolerance = options["tolerance_px"]
    if tolerance is not None and not (np.isfinite(tolerance) and tolerance > 0):
        raise UsageError(f"{verb}: tolerance_px must be > 0 and finite, or None, got {tolerance}")
    if not 0 <= options["max_deformation"] <= MOST_DEFORMATION:
        raise UsageError(
            f"{verb}: max_deformation must be from 0 to {MOST_DEFORMATION} of the model's size, "
            f"got {options['max_deformation']}"
        )
    for name in ("min_margin", "seed"):
        if options[name] < 0:
            raise UsageError(f"{verb}: {name} must be >= 0, got {options[name]}")


def default_tolerance(xy: Array, camera: Camera, markers: MarkerSet, near: Array | None = None) -> float:
    """Neighbourhood for table errors and a rough pose, small enough to tell neighbouring spots apart.

    How large the table's errors are in the picture is not known before the pose is, but how large they are beside the
    spacing of the markers is that of the spots: to the fourth neighbour, since an oblique view shortens one direction.
    ``near`` is `near_px` of the spots, if it is known.
    """
    wanted = DEFAULT_TOLERANCE * math.hypot(*camera.size_px)
    near = near_px(xy) if near is None else near
    if not near.size:
        return max(0.5, wanted)
    if (rough := roughness(markers)) > 0:
        wanted = max(wanted, rough * median(near[:, -1]))
    return max(0.5, min(wanted, MAX_SPACING * median(near[:, 0])))


def roughness(markers: MarkerSet) -> float:
    """How far off its table a marker may be, as part of the distance to the fourth neighbour; 0 without sigmas."""
    sigma = np.where(np.isfinite(markers.sigma), markers.sigma, 0.0)
    if not sigma.any() or not (apart := median(near_px(markers.xyz)[:, -1])) > 0:
        return 0.0
    return TABLE_SIGMAS * median(sigma.ravel()) / apart
