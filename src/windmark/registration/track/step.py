"""One frame from the motion so far: call the kernel, judge its answer, and move the state on."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from windmark.adjust import SolveReport
from windmark.errors import g2
from windmark.geometry import Pose
from windmark.registration import rules
from windmark.registration.result import Cause, NotRegistered, Registration, RunnerUp, Unchecked
from windmark.registration.search.layout import Frame
from windmark.registration.task import Limits
from windmark.registration.track._kernels import step as at
from windmark.registration.track._kernels.motion import Estimate
from windmark.registration.track.carried import ABRUPT, predicted_pose, restart
from windmark.registration.track.discs import with_discs
from windmark.registration.track.prepared import Prepared
from windmark.registration.track.state import Motion, TrackState
from windmark.scene import Detections, Matching
from windmark.scene.units import CommonRatio, radii_told

Array = NDArray[np.float64]

FEWER, LEAST_SEEN = 0.75, 0.35
"""Where single pairs had to be supposed, a labelling with less than this part of the markers matched before, or of
those in view, may be right in parts only: a search must confirm it."""
OUTCOMES = {at.UNSURE: "too long without a pose to predict one", at.LOST: "no labelling near the prediction holds"}


class Stepped(NamedTuple):
    """What became of a frame, see `step_kernel`; of the solution and its rival only where it was labelled."""

    frame: Frame  # of the unit model, whose all poses are
    numbers: Array  # see the kernel's `OUTCOME` and the names beside it
    rotation: Array  # (3, 3)
    translation: Array  # (3,)
    cov: Array  # (6, 6) of [rotation, translation]
    marker: NDArray[np.int64]  # (K,)
    spot: NDArray[np.int64]  # (K,)
    residual: Array  # (K, 2) projected - seen in the image
    distance: Array  # (K,) their length
    rival_rotation: Array  # there is a rival if the lead over it is finite
    rival_translation: Array
    new_rotation: Array  # `Estimate` after this frame
    new_translation: Array
    new_velocity: Array
    new_cov: Array
    change: Array  # (2,) of the motion, adapted

    @property
    def pose(self) -> Pose:
        """Of the model."""
        return self.frame.pose(self.rotation, self.translation)


def step(
    state: TrackState, detections: Detections, dt: float, motion: Motion, limits: Limits, options: dict[str, Any],
    least_density: float,
) -> tuple[Registration | NotRegistered, TrackState]:  # fmt: skip
    """Follow one frame; a falsy answer, and the state as it was, where the prediction does not lead to a labelling.

    Where only the rigid model is in doubt, its labels go to the judge.
    """
    assert state.estimate is not None, "step: a first frame is registered"
    prepared, layout, before = state.prepared, state.prepared.layout, state.estimate
    if len(detections) < at.MIN_COUNT:
        return NotRegistered(f"{len(detections)} spots: too few", "too_few", options=options), state
    xy, cov = np.ascontiguousarray(detections.xy), np.ascontiguousarray(detections.cov)

    def run(eccentricity: Array) -> Stepped:
        fields = at.step_kernel(
            layout.model.xyz, layout.model.normal, prepared.sigma, prepared.modes, layout.model.near,
            *layout.symmetries, prepared.packed, prepared.loose, prepared.size, xy, cov, detections.radius_px,
            *before, state.change, motion.change, dt + state.missed, options["tolerance_px"] or 0.0,
            prepared.rough, least_density, limits.margin, eccentricity,
        )  # fmt: skip
        return Stepped(layout.frame, *fields)

    more, sized = np.zeros((6, 6)), None
    if prepared.discs is None:
        done = run(np.zeros((len(layout.markers), 2)))
    else:
        ahead = predicted_pose(state, dt)[0]
        done, more, sized = with_discs(run, prepared.discs, prepared.camera, ahead, detections)
    n = done.numbers.tolist()  # plain floats are faster
    if n[at.OUTCOME] == at.NOT_FINITE:
        raise ValueError("track: detections.cov must be finite")
    if n[at.OUTCOME] != at.LABELLED:
        return NotRegistered(OUTCOMES[n[at.OUTCOME]], "nothing", options=options), state
    if (refusal := _refusal(n, done, limits, len(state.marker))) is not None:
        return replace(refusal, options=options), state
    # Evidence adds up over frames; against it, none is kept for later (Page's cumulative sum, 1954).
    bends, options = max(0.0, state.bends + n[at.BENDING]), {**options, "dt": dt}
    if max(n[at.BENDING], bends) > rules.DOUBT:
        return _doubted(replace(state, bends=bends), detections, done, n, dt, motion, limits, options)
    answer = _registration(prepared, done, n, options)
    if sized is not None and more.any():
        answer = _of_any_size(answer, done, more, sized, layout.markers.length_unit)
    estimate = Estimate(done.new_rotation, done.new_translation, done.new_velocity, done.new_cov)
    new = TrackState(
        "tracked", "", estimate, done.change, done.marker, state.n_frames + 1, 0.0, prepared, bends
    )  # fmt: skip
    return answer, new


def _of_any_size(answer: Registration, done: Stepped, more: Array, size: CommonRatio, unit: str) -> Registration:
    """The answer with what discs of the imaged size change in its covariance, ``more`` of the unit model."""
    change = done.frame.change(done.translation)
    sigmas = math.sqrt(max(np.trace(np.linalg.solve(done.cov, more)), 0.0))  # of one way
    said = (Unchecked("radii", radii_told(size.ratio, unit)),) if size.matters(sigmas) else ()
    return replace(answer, cov=answer.cov + change @ more @ change.T, unchecked=(*answer.unchecked, *said))


def _doubted(
    state: TrackState, detections: Detections, done: Stepped, n: list[float], dt: float, motion: Motion,
    limits: Limits, options: dict[str, Any],
) -> tuple[Registration | NotRegistered, TrackState]:  # fmt: skip
    """The answer where the model may be bent: what the judge says if this frame shows it."""
    from windmark.registration.track.doubted import covered, judged  # seldom needed, and it brings more of numba

    match = np.full(len(state.prepared.layout.markers), -1, np.int32)
    match[done.marker] = done.spot
    pose, what, beside = done.pose, (state.prepared, detections), _runner_up(n, done)
    if n[at.BENDING] > rules.DOUBT:
        answer = judged(*what, pose, match, n[at.WORTH], n[at.TOLERANCE], limits, state.bends, options)
    else:
        answer = covered(*what, pose, match, n[at.TOLERANCE], limits, state.bends, options)
    if not isinstance(answer, Registration):
        reason = answer or OUTCOMES[at.LOST]
        return NotRegistered(reason, "misfit", int(n[at.COUNT]), pose, beside, options=options), state
    answer = replace(answer, runner_up=beside)
    return answer, restart(state, answer, dt, motion, "tracked", "")


def _refusal(n: list[float], done: Stepped, limits: Limits, before: int) -> NotRegistered | None:
    """Why the labelling is not accepted: the tests of the judge (`judge.own`), and the motion; None if it is.

    ``before`` markers were matched in the last good frame.
    """
    count, expected = int(n[at.COUNT]), int(n[at.SEEN])
    loose = _is_loose(n)
    least = limits.score
    if loose:  # it may be right in parts only: being near the prediction says nothing for it
        least += rules.MISSED * (expected - count) + (rules.SPARSE if 2 * count <= expected else 0.0)
    else:
        least += math.log(n[at.SHARE])
    excess = n[at.EXCESS_PX] * (1 + 1 / math.sqrt(2 * max(n[at.REDUNDANCY], 1.0)))
    allowed = math.hypot(limits.table_error * n[at.SPACING], rules.DOUBLED * n[at.SIGMA])
    cause: Cause
    if not (n[at.LOG10_NFA] < limits.log10_nfa and n[at.WORTH] > least):
        cause, but = "weak", (
            f"which could be chance: false-alarm number 1e{n[at.LOG10_NFA]:+.1f}, evidence {n[at.WORTH]:.0f} nats (at "
            f"least {least:.0f})"
        )  # fmt: skip
    elif rules.MISFIT * n[at.MISFIT_PX] > n[at.TOLERANCE] or excess > allowed:
        cause, but = "misfit", f"but with a misfit of {g2(n[at.MISFIT_PX])} px (1 sigma per coordinate)"
    elif n[at.DISTANCE2] > ABRUPT:
        cause, but = "nothing", f"but the motion was abrupt ({n[at.DISTANCE2] ** 0.5:.0f} sigma)"
    elif n[at.SUPPOSED] and (count < FEWER * before or count < LEAST_SEEN * expected):
        cause, but = "weak", "too few for a prediction that is not sharp enough to choose the labels"
    elif n[at.LEAD] < limits.margin:
        rival = f"a labelling of {n[at.RIVAL_COUNT]:.0f} is about as good (lead {n[at.LEAD]:.1f} nats, with the motion)"
        cause, but = "ambiguous", f"but {rival}"
    elif n[at.HELD_PX] > n[at.TOLERANCE] or not n[at.OPEN_PX] < n[at.TOLERANCE]:
        cause, but = "one_pair", (
            f"but they leave the place of others open by {g2(n[at.OPEN_PX])} px, and of one of them all others by "
            f"{g2(n[at.HELD_PX])} px"
        )  # fmt: skip
    else:
        return None
    reason = f"the prediction matches {count} of {expected} markers in view, {but}"
    return NotRegistered(reason, cause, count, runner_up=_runner_up(n, done))


def _is_loose(n: list[float]) -> bool:
    """See `judge.own.is_loose`."""
    return n[at.MISFIT_PX] > rules.LOOSE * n[at.SIGMA] and n[at.EXCESS_PX] > n[at.SIGMA]


def _runner_up(n: list[float], done: Stepped) -> RunnerUp | None:
    if not math.isfinite(n[at.LEAD]):
        return None
    pose = done.frame.pose(done.rival_rotation, done.rival_translation)
    shared = 2 * n[at.RIVAL_SHARED] > n[at.RIVAL_COUNT]
    return RunnerUp(n[at.WORTH] - n[at.LEAD], pose, int(n[at.RIVAL_COUNT]), shared)


def _registration(prepared: Prepared, done: Stepped, n: list[float], options: dict[str, Any]) -> Registration:
    steps, change = int(n[at.STEPS]), done.frame.change(done.translation)
    return Registration(
        cam_from_model=done.pose,
        camera=prepared.camera,
        matching=Matching(done.spot, done.marker, done.distance),
        rms_px=n[at.RMS_PX],
        residuals=done.residual,
        cov=change @ done.cov @ change.T,
        excess_px=n[at.EXCESS_PX],
        score=n[at.WORTH],
        log10_nfa=n[at.LOG10_NFA],
        runner_up=_runner_up(n, done),
        n_expected=int(n[at.SEEN]),
        n_hypotheses=1,
        report=SolveReport("converged_gradient", True, steps, steps, n[at.FIRST_COST], n[at.LAST_COST]),
        xyz=prepared.layout.markers.xyz,
        options=options,
    )
