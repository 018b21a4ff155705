"""The verb `register_rig`: one pose and all labels from the spots of several cameras that see the model at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Camera, Pose
from windmark.registration.line import off_line, on_line
from windmark.registration.register import MIN_COUNT, check_ranges, default_tolerance
from windmark.registration.result import Cause, NotRegistered
from windmark.registration.rig.result import RigRegistration
from windmark.registration.task import Limits, Task
from windmark.scene import Detections, MarkerSet

if TYPE_CHECKING:
    from windmark.registration.search.layout import Layout

Ints = NDArray[np.int64]


def register_rig(
    detections: Sequence[Detections],
    markers: MarkerSet,
    cameras: Sequence[Camera],
    cam_from_rig: Sequence[Pose],
    *,
    prior: Pose | None = None,
    prior_max_angle_deg: float = 30.0,
    prior_max_scale: float = 1.3,
    tolerance_px: float | None = None,
    layout: Layout | None = None,
    max_hypotheses: int | None = None,
    max_time_s: float | None = None,
    max_log10_nfa: float = -9.0,
    min_score: float = 60.0,
    min_margin: float = 10.0,
    max_table_error: float = 0.025,
) -> RigRegistration | NotRegistered:
    """Find which spot is which marker in several images taken at once, and where the model was.

    Each camera proposes poses by its own spots. Every proposal, also one that a camera alone would find weak, is
    carried to the other cameras; pose and labels settle in all of them together, and the sum of their evidence
    counts. The rules of acceptance are those of `register`, for all pairs together; an ambiguity of one camera that
    another one resolves is none.

    Parameters
    ----------
    detections : spots of each of C images, best first; false ones and missing markers are expected. A camera without
        spots takes no part
    markers : table of markers. Known normals halve the search and exclude what cannot be seen
    cameras : interior parameters
    cam_from_rig : where each camera is in the frame of the rig (any frame fixed to them, as that of one of them), in
        the markers' length unit. They are taken as exact: the excess shows what small errors they have, a camera
        that contradicts the others is a reason to refuse ("misfit") and named
    prior : expected rig_from_model; solutions too far from it are rejected
    prior_max_angle_deg : largest angle between the solution and the prior
    prior_max_scale : largest ratio of the scales of solution and prior, in every camera, either way; > 1
    tolerance_px : neighbourhood in which a projected marker looks for its spot during the search, of all cameras;
        None takes, for each of them, 0.4 % of the image's diagonal, less where the spots are dense
    layout : `prepare(markers)`, to save its milliseconds when many images are registered with the same markers
    max_hypotheses : links of three markers to three spots to try before giving up, in all cameras; None takes a million
        for each
    max_time_s : CPU time after which the search gives up, without that for the ``layout`` (but with its table of far
        quads, made and kept there when most markers are hidden); None is no limit. In any case it gives up after the
        work that takes 0.2 s for each camera on a quiet machine, or ``max_time_s`` if that is more
    max_log10_nfa, min_score, min_margin : limits of acceptance, see `registration.task.Limits`
    max_table_error : see `register`

    Returns
    -------
    A `RigRegistration`, or a falsy `NotRegistered` with its reason; poses in the latter are as the first camera would
    see them.

    Raises
    ------
    ValueError
        For numbers of images, cameras and poses that differ, and for options out of range.
    """
    _check_rig(detections, cameras, cam_from_rig)
    options: dict[str, Any] = {
        "prior": prior, "prior_max_angle_deg": prior_max_angle_deg, "prior_max_scale": prior_max_scale,
        "tolerance_px": tolerance_px,
        "max_hypotheses": 1_000_000 * len(cameras) if max_hypotheses is None else max_hypotheses,
        "max_time_s": max_time_s,
        "max_log10_nfa": max_log10_nfa, "min_score": min_score, "min_margin": min_margin,
        "max_table_error": max_table_error,
    }  # fmt: skip
    check_ranges("register_rig", options, prior)
    if layout is not None and not layout.is_of(markers):
        raise ValueError("register_rig: layout must be prepared from the same markers; their xyz or normals differ")
    usable = [
        np.flatnonzero(np.isfinite(c.unproject(d.xy)).all(axis=1)) for d, c in zip(detections, cameras, strict=True)
    ]
    refusal = _refuse_early([d.xy[u] for d, u in zip(detections, usable, strict=True)], markers)
    if refusal is not None:
        return NotRegistered(*refusal, options=options)
    tasks = []
    for d, camera, pose, index in zip(detections, cameras, cam_from_rig, usable, strict=True):
        xy = d.xy[index]
        tolerance = tolerance_px or default_tolerance(xy, camera, markers)
        tasks.append(
            Task(
                markers, camera, xy, d.cov[index], tolerance, None if prior is None else pose @ prior,
                float(np.radians(prior_max_angle_deg)), prior_max_scale, radius_px=d.radius_px[index],
            )
        )  # fmt: skip
    options["tolerance_px"] = tuple(task.tolerance_px for task in tasks)
    limits = Limits(max_log10_nfa, min_score, min_margin, np.inf, max_table_error)
    from windmark.registration.rig.solve import solve_rig  # this brings numba

    return solve_rig(tasks, tuple(cam_from_rig), layout, limits, usable, options)


def _check_rig(detections: Sequence[Detections], cameras: Sequence[Camera], poses: Sequence[Pose]) -> None:
    if not len(detections) == len(cameras) == len(poses) or not len(cameras):
        raise ValueError(
            "register_rig: detections, cameras and cam_from_rig must be of the same cameras, one of each at least; "
            f"got {len(detections)}, {len(cameras)} and {len(poses)}"
        )
    for n, (spots, pose) in enumerate(zip(detections, poses, strict=True)):
        if pose.rotation.ndim != 2:
            raise ValueError(
                f"register_rig: cam_from_rig[{n}] must be a single pose, got a batch {pose.rotation.shape[:-2]}"
            )
        if not np.isfinite(spots.cov).all():
            raise ValueError(f"register_rig: detections[{n}].cov must be finite")


def _refuse_early(spots: list[NDArray[np.float64]], markers: MarkerSet) -> tuple[str, Cause] | None:
    """What needs no search to say no: (reason, cause) or None."""
    most = max(len(xy) for xy in spots)
    if most < MIN_COUNT:
        return f"{most} spots in the fullest image: a pose and its check need four in one of them", "too_few"
    if len(markers) < MIN_COUNT:
        return f"{len(markers)} markers: three pairs fix a pose and a fourth is needed to check it", "too_few"
    if all(len(xy) < MIN_COUNT or off_line(xy) < 0.5 for xy in spots):
        return "the spots of every image lie on one line", "degenerate"
    if on_line(markers.xyz):
        return f"all {len(markers)} markers lie on one line", "degenerate"
    return None
