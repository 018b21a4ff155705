"""The verb `track`: labels and pose of the next frame from the motion so far."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from windmark.errors import UsageError
from windmark.geometry import Camera, Pose
from windmark.options.registration import MAX_TABLE_ERROR
from windmark.registration.register import register
from windmark.registration.result import NotRegistered, Registration
from windmark.registration.task import Limits
from windmark.registration.track.state import Motion, Status, TrackState
from windmark.scene import Detections, MarkerSet
from windmark.scene.shown import check_kinds, optional

if TYPE_CHECKING:
    from windmark.registration.search.layout import Layout

Array = NDArray[np.float64]

DEFAULT_MOTION = Motion()


def track(
    previous: TrackState | None,
    detections: Detections,
    markers: MarkerSet,
    camera: Camera,
    *,
    dt: float = 1.0,
    motion: Motion | None = None,
    prior: Pose | None = None,
    layout: Layout | None = None,
    tolerance_px: float | None = None,
    least_density: float = 0.0,
    search: bool = True,
    max_time_s: float | None = None,
    max_log10_nfa: float = -9.0,
    min_score: float = 60.0,
    min_margin: float = 10.0,
    max_table_error: float = MAX_TABLE_ERROR.default,
    seed: int = 0,
) -> tuple[Registration | NotRegistered, TrackState]:
    """Label the spots of the next frame and find its pose; nothing is changed, the new state is returned.

    The pose is predicted with constant velocity. Every marker looks for its spot in a gate as wide as the uncertainty
    of the prediction; where gates overlap, single pairs are supposed and the others decide. The labelling is refined
    and accepted by the tests of `register`: false-alarm number, evidence, misfit, no pair that holds the pose alone,
    and a lead over the labellings that the near-symmetries of the model offer, in which picture and motion count
    together. Where the residuals look like those of a bent model, the judge of `register` is asked, which takes some
    20 ms. A model that has been seen to bend may do so in frames that do not show it: their sigmas have that (5 ms).
    The pose of a bent model is that of its root, as in `register`. What fails, or contradicts the motion, goes to
    `register` with the prediction as prior, and then without one;
    its answer is then the frame's.

    Each frame's pose is its own: the motion chooses the labels but does not pull the pose. The state's pose is that
    of all frames so far (Kalman). A frame without a pose changes nothing but the time that has passed, so the next
    one is looked for where the motion would have brought the model.

    Parameters
    ----------
    previous : state after the frame before; None for the first one
    detections, markers, camera : as in `register`; a better table or camera may come in between, given the same
        model frame
    dt : time since the frame of ``previous``, in frames; 2 if one was dropped
    motion : expected change of the motion; None takes `Motion`'s defaults
    prior : expected pose of the first frame, as in `register`; regular layouts need one
    layout : `prepare(markers)`; used for the first frame only, the state hands it on
    tolerance_px, max_time_s, max_log10_nfa, min_score, min_margin, max_table_error, seed : see `register`. What the
        prediction rules out lowers ``min_score`` as a prior does
    least_density : spots per px^2 that are expected by chance at least; set it to one over the area that was looked
        through for each marker where spots were only looked for near predictions

    search : False leaves `register` out: a frame that cannot be followed is lost

    Returns
    -------
    The `Registration`, or a falsy `NotRegistered` with its reason, and the state for the next frame.

    Raises
    ------
    ValueError
        For options out of range.

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> rng = np.random.default_rng(1)
    >>> markers = wm.MarkerSet.make([f"m{i}" for i in range(20)], rng.uniform(-1.0, 1.0, (20, 3)) * [2.0, 1.0, 0.2])
    >>> camera, state = wm.Camera((640, 480), 800.0), None
    >>> for x in (0.50, 0.52, 0.54):
    ...     pose = wm.Pose.look_at([x, 0.3, 6.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    ...     spots = wm.Detections.make(camera.project(pose.apply(markers.xyz))[0].round(1))
    ...     answer, state = wm.track(state, spots, markers, camera)
    ...     print(state.status, len(answer.matching))
    cold 20
    tracked 20
    tracked 20
    """
    check_kinds(
        "track", previous=(previous, optional(TrackState)), detections=(detections, Detections),
        markers=(markers, MarkerSet), camera=(camera, Camera),
    )  # fmt: skip
    if not (math.isfinite(dt) and dt > 0):
        raise UsageError(f"track: dt must be > 0 and finite, got {dt}")
    if not (math.isfinite(least_density) and least_density >= 0):
        raise UsageError(f"track: least_density must be >= 0 and finite, got {least_density}")
    motion = motion or DEFAULT_MOTION
    limits = Limits(max_log10_nfa, min_score, min_margin, 1.0, max_table_error)
    options: dict[str, Any] = {
        "tolerance_px": tolerance_px, "max_time_s": max_time_s, "max_log10_nfa": max_log10_nfa, "min_score": min_score,
        "min_margin": min_margin, "max_table_error": max_table_error, "seed": seed,
    }  # fmt: skip
    state = previous if previous is not None else _fresh(markers, camera, motion, layout)
    if previous is not None and not state.prepared.fits(markers, camera):
        if layout is None and state.prepared.layout.is_of(markers):
            layout = state.prepared.layout
        from windmark.registration.track.carried import carried_over

        state = carried_over(state, _prepared(markers, camera, layout))
    why = ""
    if state.estimate is not None:
        from windmark.registration.track.step import step

        answer, new = step(state, detections, dt, motion, limits, options, least_density)
        if isinstance(answer, Registration):
            return answer, new
        why = answer.reason
        if not search:
            return answer, state.without(why, dt)
    return _search(state, detections, dt, motion, prior, why, options)


def predict(state: TrackState, dt: float = 1.0) -> tuple[Pose, Array]:
    """Where the model is expected ``dt`` frames after the last call, and the (6, 6) covariance of that.

    Of [rotation, translation] for ``exp(delta) @ pose``, as `Registration.cov`.

    Raises
    ------
    ValueError
        Where the state has no pose yet.
    """
    if state.estimate is None:
        raise ValueError("predict: the state has no pose yet; register a first frame")
    from windmark.registration.track.carried import predicted_pose

    return predicted_pose(state, dt)


def _prepared(markers: MarkerSet, camera: Camera, layout: Layout | None) -> Any:
    from windmark.registration.track.prepared import Prepared  # this brings numba

    if layout is not None and not layout.is_of(markers):
        raise ValueError("track: layout must be prepared from the same markers; their coordinates or normals differ")
    return Prepared.of(markers, camera, layout)


def _fresh(markers: MarkerSet, camera: Camera, motion: Motion, layout: Layout | None) -> TrackState:
    return TrackState(
        "lost", "", None, motion.change, np.zeros(0, np.int64), 0, 0.0,
        _prepared(markers, camera, layout),
    )  # fmt: skip


def _search(
    state: TrackState, detections: Detections, dt: float, motion: Motion, prior: Pose | None, why: str,
    options: dict[str, Any],
) -> tuple[Registration | NotRegistered, TrackState]:  # fmt: skip
    """Register near what is expected, and where a prediction is left without a labelling, anywhere.

    A layout that repeats itself is never searched near the prediction only: what lies beyond may be as good.
    """
    layout, camera = state.prepared.layout, state.prepared.camera
    expected = prior
    if state.estimate is not None:
        expected = None if len(layout.symmetries[0]) else predict(state, dt)[0]
    answer = register(detections, layout.markers, camera, prior=expected, layout=layout, **options)
    if not answer and state.estimate is not None and expected is not None:
        answer = register(detections, layout.markers, camera, layout=layout, **options)
    if not isinstance(answer, Registration):
        reason = f"{why}; searched for: {answer.reason}" if why else answer.reason
        return replace(answer, reason=reason), state.without(reason, dt)
    from windmark.registration.track.carried import restart

    status: Status = "cold" if state.estimate is None else "reacquired"
    return answer, restart(state, answer, dt, motion, status, why)
