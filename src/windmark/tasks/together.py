"""Images of one instant by cameras with known places to each other: registered together, and as each camera has it."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Camera, Pose
from windmark.geometry.rotations import hat
from windmark.registration import NotRegistered, Registration, RigRegistration, Unchecked, register
from windmark.scene import Detections, MarkerSet

Array = NDArray[np.float64]

CONTRADICTED = ("nothing", "weak", "misfit", "wrong_camera", "wrong_focal")
"""Causes of a refusal that a single camera of several can bring about: one that has moved, is another one, or sees
something else."""
LEAD = 10.0
"""Nats by which one camera must be likelier to be the wrong one than any other, odds of 22,000 to 1."""
CHECKED = 2
"""So many markers of its own show that a camera is where the rig says; a single one may be there by chance."""
OF_ALL = ("scale", "mirror", "copy", "bending")
"""What is unchecked of the model, not of one camera."""

EACH = ("fixed", "excluded", "tolerance_px")
"""Options that a rig's registration tells of each camera."""


@dataclass(frozen=True)
class RigView:
    """What one camera of a rig saw.

    Parameters
    ----------
    name : of the camera
    spots, camera : of the image; without a spot the camera has its place from the others
    cam_from_rig : where the camera is
    fixed, excluded : see `register`
    cov : (6, 6) of ``exp(delta) @ cam_from_rig``; None where that is exact
    """

    name: str
    spots: Detections
    camera: Camera
    cam_from_rig: Pose
    fixed: Mapping[int, str] = field(default_factory=dict)
    excluded: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    cov: Array | None = None


@dataclass(frozen=True)
class Together:
    """What came of several cameras.

    Parameters
    ----------
    answer : of those that took part; its reason has their names
    names : of those that took part, in the answer's order
    left_out : name -> why, of a camera that contradicted the others
    disputed : where there is no answer, cameras that contradict each other, of which nobody knows which is wrong
    """

    answer: RigRegistration | NotRegistered
    names: tuple[str, ...]
    left_out: Mapping[str, str] = field(default_factory=dict)
    disputed: tuple[str, ...] = ()

    def of(self, name: str) -> Registration | None:
        """The registration as one camera has it; None where there is none, or the camera took no part."""
        if not isinstance(self.answer, RigRegistration) or name not in self.names:
            return None
        return of_camera(self.answer, self.names.index(name))


def register_together(
    views: Sequence[RigView], markers: MarkerSet, *, priors: Sequence[Pose | None] = (None,), **options: Any
) -> Together:
    """`register` of all cameras of an instant; without the one that contradicts the others, where that is clear.

    Where all together are refused, each camera is left out once. If the others then are registered for one of them
    only, that is the one which has moved, or shows something else; it is named with the reason. If they are for
    several, the evidence of the others together and that of the camera by itself decide, summed. Where that is no clear
    lead, as of two cameras always, the refusal stands.

    Parameters
    ----------
    views : at least one
    priors : where the model is expected (rig_from_model), tried one after the other; None is anywhere
    options : of `register`, for all cameras
    """
    views = sorted(views, key=lambda v: len(v.spots) == 0)  # those without a spot last
    every = tuple(v.name for v in views)
    answer = _registered(views, markers, priors, options)
    seeing = [v for v in views if len(v.spots)]
    if isinstance(answer, RigRegistration):
        return Together(answer, every)
    if answer.cause not in CONTRADICTED or len(seeing) < 2:
        return Together(answer, every)
    without = []
    for view in seeing:
        rest = [v for v in views if v is not view]
        if isinstance(found := _registered(rest, markers, priors, options), RigRegistration):
            without.append(Together(found, tuple(v.name for v in rest), {view.name: answer.reason}))
    if (chosen := _likeliest(without, seeing, markers, options)) is not None:
        return chosen
    disputed = tuple(name for one in without for name in one.left_out)
    if disputed:
        either = " or ".join(disputed)
        reason = f"{answer.reason}; without {either} the rest is registered, so which of them is wrong is not clear"
        answer = replace(answer, reason=reason)
    return Together(answer, every, disputed=disputed)


def _likeliest(
    without: Sequence[Together], seeing: Sequence[RigView], markers: MarkerSet, options: Mapping[str, Any]
) -> Together | None:
    """The only way, or the clearly likeliest one, to leave a camera out; None where there is none."""
    if len(without) < 2:
        return without[0] if without else None
    if len(seeing) == 2:
        return None
    worth = []
    for one in without:
        assert isinstance(one.answer, RigRegistration)
        alone = _registered([v for v in seeing if v.name in one.left_out], markers, (None,), options)
        worth.append(one.answer.score + (alone.score if isinstance(alone, RigRegistration) else 0.0))
    second, best = sorted(worth)[-2:]
    return without[worth.index(best)] if best > second + LEAD else None


def _registered(
    views: Sequence[RigView], markers: MarkerSet, priors: Sequence[Pose | None], options: Mapping[str, Any]
) -> RigRegistration | NotRegistered:
    """`register` of a rig, its reason with the names of the cameras."""
    refusals = []
    for prior in priors:
        answer = register(
            [v.spots for v in views], markers, [v.camera for v in views], cam_from_rig=[v.cam_from_rig for v in views],
            rig_cov=[v.cov for v in views], prior=prior, fixed=[v.fixed for v in views],
            excluded=[v.excluded for v in views], **options,
        )  # fmt: skip
        if isinstance(answer, RigRegistration):
            return answer
        refusals.append(answer)
    last = refusals[-1]
    reason = with_names(last.reason, [v.name for v in views])
    if len(views) > 1 and last.cause in ("wrong_camera", "wrong_focal"):
        reason = f"a camera is not where it is said to be, or is another one: {reason}"
    return replace(last, reason=reason)


def with_names(reason: str, names: Sequence[str]) -> str:
    """A reason that counts the cameras of a rig (``camera 1``) with their names."""
    return re.sub(r"\bcamera (\d+)\b", lambda m: f"camera {names[int(m[1])]}", reason)


def of_camera(found: RigRegistration, c: int) -> Registration:
    """The registration as camera c has it: its own pairs and residuals, evidence and false-alarm number of all."""
    cam_from_rig, camera = found.cam_from_rig[c], found.cameras[c]
    pose, residuals, runner_up, bent = found.cam_from_model(c), found.residuals[c], found.runner_up, found.deformation
    if runner_up is not None:
        first = found.cam_from_rig[0]
        runner_up = replace(runner_up, cam_from_model=cam_from_rig @ first.inverse() @ runner_up.cam_from_model)
    if bent is not None:
        shift = camera.project(pose.apply(found.xyz + bent.displacement))[0] - camera.project(pose.apply(found.xyz))[0]
        bent = replace(bent, shift_px=shift)
    return Registration(
        cam_from_model=pose,
        camera=camera,
        matching=found.matchings[c],
        rms_px=float(np.sqrt((residuals**2).sum(axis=1).mean())) if len(residuals) else np.nan,
        residuals=residuals,
        cov=_moved(found.cov, cam_from_rig),
        excess_px=float(found.excess_px[c]),
        score=found.score,
        log10_nfa=found.log10_nfa,
        runner_up=runner_up,
        n_expected=found.n_expected[c],
        n_hypotheses=found.n_hypotheses,
        report=found.report,
        xyz=found.xyz,
        deformation=bent,
        unchecked=_unchecked(found, c),
        options={k: v[c] if k in EACH else v for k, v in found.options.items()},
    )


def _moved(cov: Array, cam_from_rig: Pose) -> Array:
    """(6, 6) covariance of ``exp(delta) @ rig_from_model`` as that of a camera's pose."""
    turn, change = cam_from_rig.rotation, np.zeros((6, 6))
    change[:3, :3] = change[3:, 3:] = turn
    change[3:, :3] = hat(cam_from_rig.translation) @ turn
    return np.asarray(change @ cov @ change.T)


def _unchecked(found: RigRegistration, c: int) -> tuple[Unchecked, ...]:
    """What camera c cannot tell; first of all, with fewer than `CHECKED` markers, that it is where the rig says."""
    own = tuple(u for u in found.unchecked if u.camera == c or u.what in OF_ALL)
    if (count := len(found.matchings[c])) >= CHECKED:
        return own
    words = f"whether its camera is where the rig says ({count} of its spots are markers)"
    place = Unchecked("place in the rig", words, c)
    return (place, *(u for u in own if u.what != place.what))
