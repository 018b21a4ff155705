"""The motion carried on: past a frame that was searched for, to another table or camera, and ahead in time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Pose
from windmark.geometry.rotations import hat
from windmark.registration import rules
from windmark.registration.result import Registration
from windmark.registration.track._kernels.motion import (
    MOST_CHANGE,
    Estimate,
    adapted,
    difference,
    distance2_of,
    predict_kernel,
    update_kernel,
)
from windmark.registration.track.prepared import Prepared
from windmark.registration.track.state import Motion, Status, TrackState

Array = NDArray[np.float64]

ABRUPT = 40.0
"""A squared Mahalanobis distance (six degrees of freedom) beyond which the motion was no continuation (1e-6)."""


def restart(
    state: TrackState, answer: Registration, dt: float, motion: Motion, status: Status, reason: str
) -> TrackState:
    """The state after a frame that was searched for.

    Where its pose goes on with the motion, it is a frame like others. Where it does not, the motion is as good as
    unknown. The velocity before stays the best guess after a single jump. Where the frame before had to be searched
    for, too, the motion is too fast for what was known of it: then the difference of the two poses is the better guess.
    """
    if answer.deformation is not None:
        state = replace(state, bends=state.bends + rules.BENT_LEAD)
    frame, cov, velocity = state.prepared.layout.frame, np.zeros((12, 12)), np.zeros(6)
    rotation, translation = (np.ascontiguousarray(v) for v in frame.unit(answer.cam_from_model))
    back = np.linalg.inv(frame.change(translation))
    measured = back @ answer.cov[:6, :6] @ back.T
    marker, now = answer.matching.marker, Estimate(rotation, translation, velocity, cov)
    if state.estimate is not None and (new := _continued(state, now, measured, dt, motion)) is not None:
        return replace(new, status=status, reason=reason, marker=marker)
    cov[:6, :6] = measured
    first = np.repeat(motion.change * motion.first, 3) ** 2
    first[3:] *= translation @ translation
    cov[6:, 6:] = np.diag(first)
    if state.estimate is not None:
        velocity[:] = state.estimate.velocity
        if state.n_frames == 1 and state.missed == 0:
            difference(rotation, translation, state.estimate.rotation, state.estimate.translation, velocity)
            velocity /= dt
    change = np.clip(state.change, motion.change, MOST_CHANGE * motion.change)
    return TrackState(status, reason, now, change, marker, 1, 0.0, state.prepared, state.bends)


def _continued(state: TrackState, now: Estimate, measured: Array, dt: float, motion: Motion) -> TrackState | None:
    """The state after a pose that was searched for, but that goes on with the motion; None if it does not."""
    assert state.estimate is not None, "carried: nothing to continue"
    dt, innovation = dt + state.missed, np.empty(6)
    then = predict_kernel(state.estimate, state.change, dt)
    difference(now.rotation, now.translation, then.rotation, then.translation, innovation)
    if not distance2_of(innovation, then.cov, measured) < ABRUPT:
        return None
    known = np.diag(then.cov)[:6] + np.diag(measured)
    distance2 = float(then.translation @ then.translation)
    change = adapted(state.change, motion.change, innovation, known, distance2, dt)
    after = update_kernel(then, innovation, measured)
    return replace(state, estimate=after, change=change, n_frames=state.n_frames + 1, missed=0.0)


def carried_over(state: TrackState, prepared: Prepared) -> TrackState:
    """The state for another table or camera: the motion is that of the markers' centre, which may be elsewhere."""
    if state.estimate is None:
        return replace(state, prepared=prepared)
    old, new = state.prepared.layout.frame, prepared.layout.frame
    r, t, velocity, cov = state.estimate
    lever = r @ (new.centre - old.centre)
    change = np.eye(6)
    change[3:, :3] = -hat(lever) / new.scale
    change[3:, 3:] *= old.scale / new.scale
    both = np.kron(np.eye(2), change)
    estimate = Estimate(r, (old.scale * t + lever) / new.scale, change @ velocity, both @ cov @ both.T)
    return replace(state, estimate=estimate, prepared=prepared, bends=0.0)


def predicted_pose(state: TrackState, dt: float) -> tuple[Pose, Array]:
    """See `track.predict`."""
    frame = state.prepared.layout.frame
    then = predict_kernel(state.estimate, state.change, dt + state.missed)
    change = frame.change(then.translation)
    return frame.pose(then.rotation, then.translation), change @ then.cov[:6, :6] @ change.T
