"""How an attack's answer is judged; the words and causes of a refusal that count as the right reason are here alone."""

from __future__ import annotations

import re
import time
from collections import Counter
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from _attack_pictures import RigTrial, SequenceTrial, Trial, Truth
from windmark.geometry import Pose
from windmark.registration import Registration, RigRegistration, TrackState, register, register_rig, track
from windmark.scene import Matching

Array = NDArray[np.float64]

WRONG_SIGMA = 5.0
"""Root of chi-square over six degrees of freedom beyond which a stated covariance does not own up to an error."""
NEAR_SIGMA = 3.0
"""A spot so near to where a marker truly is counts as its own."""
LEAST_COPY = re.compile(r"fewer than (\d+) markers")
"""How much of a second copy a result says that it would have noticed."""
KINDS = ("right", "said", "reason", "refused", "WRONG")

SPARSE = ({"too_few", "degenerate", "weak", "nothing", "ambiguous"}, ())
TIE = ({"ambiguous", "weak", "degenerate"}, ("symmetric", "regular"))
CAMERA = ({"wrong_focal", "misfit", "focal"}, ("principal point", "lens", "aspect"))
REASONS: dict[str, tuple[set[str], tuple[str, ...]]] = {
    "one-pair": SPARSE,
    "ties": TIE,
    "grid": TIE,
    "mirror": ({"misfit", "nothing", "ambiguous", "weak"}, ("mirror", "behind", "symmetric")),
    "board": TIE,
    "camera": CAMERA,
    "copy": ({"ambiguous", "misfit"}, ("second", "copy", "twice", "ghost")),
    "covariance": ({"ambiguous"}, ()),
    "bent": ({"misfit", "ambiguous"}, ("bent", "deform")),
    "track": ({"misfit", "ambiguous"}, ("bent", "deform")),
    "sparse": (set(), ()),
    "rig": ({"misfit"}, ("cam_from_rig",)),
    "mixed": (TIE[0] | CAMERA[0], TIE[1] + CAMERA[1]),
}
"""Attack -> causes, and words of the reason (lower case), of a refusal for the right reason.

Words that stand in a list of guesses ("likely a wrong focal length") are no reason.
"""


@dataclass(frozen=True)
class Outcome:
    """One answer, judged.

    Parameters
    ----------
    kind : one of `KINDS`
    error_px, sigmas : of the pose, against the nearest right one; inf where none is right, NaN of a refusal
    wrong, matched : labels
    milliseconds : thread CPU time
    word : cause and reason of a refusal, or what was wrong
    """

    kind: str
    error_px: float
    sigmas: float
    wrong: int
    matched: int
    milliseconds: float
    word: str


def pose_error(truth: Truth, pose: Pose, cov: Array) -> tuple[float, float]:
    """Mean displacement in px and root of chi-square over six, against the right pose that is nearest.

    A right pose within `WRONG_SIGMA` goes before one that is nearer in the picture.
    """
    all_of = [(np.inf, np.inf)]
    for right in truth.poses:
        xyz = truth.xyz[truth.counted]
        true, _ = truth.camera.project(right.apply(xyz))
        found, _ = truth.camera.project(pose.apply(xyz))
        offset = np.linalg.norm(found - true, axis=1)
        off = np.inf if np.isnan(offset).any() else float(offset.mean())
        delta = (right @ pose.inverse()).log()
        all_of.append((off, float(np.sqrt(max(delta @ np.linalg.solve(cov[:6, :6], delta), 0.0) / 6))))
    return min(all_of, key=lambda error: (is_off(truth, *error), error[0]))


def is_off(truth: Truth, pixels: float, sigmas: float) -> bool:
    """Whether a pose is wrong, and surer of itself than it may be."""
    return pixels > truth.within_px and sigmas > WRONG_SIGMA


def wrong_labels(trial: Trial, matching: Matching) -> int:
    """Labels that are another marker's, or nobody's; but those that no eye could tell from the right ones."""
    truth, spots = trial.truth, trial.detections
    wrong = truth.label[matching.detection] != matching.marker
    if truth.poses:
        where, _ = truth.camera.project(truth.poses[0].apply(truth.xyz[matching.marker]))
        offset = np.linalg.norm(spots.xy[matching.detection] - where, axis=1)
        sigma = np.sqrt(spots.cov[matching.detection, 0, 0])
        wrong &= ~(offset < NEAR_SIGMA * sigma)
    return int(wrong.sum())


def refusal(attack: str, answer: Any, milliseconds: float, must_name: str | None = "") -> Outcome:
    """A refusal, for the right reason or another; the right one has the words ``must_name``, and None has none."""
    causes, words = REASONS[attack]
    right = answer.cause in causes or any(word in answer.reason.lower() for word in words)
    right &= must_name is not None and must_name in answer.reason.lower()
    word = f"{answer.cause}: {answer.reason}"
    return Outcome("reason" if right else "refused", np.nan, np.nan, 0, 0, milliseconds, word)


def judged(attack: str, trial: Trial, answer: Any, milliseconds: float) -> Outcome:
    """The answer to one picture."""
    if not isinstance(answer, Registration):
        return refusal(attack, answer, milliseconds, None if trial.must else "")
    error, sigmas = pose_error(trial.truth, answer.cam_from_model, answer.cov)
    wrong, matched = wrong_labels(trial, answer.matching), len(answer.matching.marker)
    faults = []
    if is_off(trial.truth, error, sigmas):
        faults.append("pose" if trial.truth.poses else "no pose is right")
    if 2 * wrong > matched:
        faults.append("labels")
    said = any(_says(item, trial) for item in getattr(answer, "unchecked", ()))
    kind = "right" if not faults else "said" if said else "WRONG"
    return Outcome(kind, error, sigmas, wrong, matched, milliseconds, " and ".join(faults))


def _says(item: Any, trial: Trial) -> bool:
    """Whether an unchecked thing is the fault of this trial; a copy only where the model shows less than it names."""
    if item.what not in trial.unseen:
        return False
    least = LEAST_COPY.search(getattr(item, "words", ""))
    return item.what != "copy" or (least is not None and int((trial.truth.label >= 0).sum()) < int(least[1]))


def answered(trial: Trial) -> tuple[Any, float]:
    """The answer of `register`, and the milliseconds it took (CPU time of this thread)."""
    start = time.thread_time()
    answer = register(trial.detections, trial.markers, trial.camera, **trial.options)
    return answer, 1e3 * (time.thread_time() - start)


def told(trial: Trial, answer: Any, outcome: Outcome) -> str:
    """Both poses, labels, sigmas and result of one trial in words."""
    lines = [f"{outcome.kind}: {outcome.word}", f"given: {trial.camera}", f"true:  {trial.truth.camera}"]
    lines += [f"{len(trial.markers)} markers, {len(trial.detections)} spots, {(trial.truth.label >= 0).sum()} true"]
    lines += [f"options: {trial.options}"]
    lines += [f"right pose: {p.rotvec.round(5)} {p.translation.round(5)}" for p in trial.truth.poses]
    if not isinstance(answer, Registration):
        return "\n".join([*lines, f"best count {answer.best_count}, candidate {answer.best_candidate}"])
    pose, match = answer.cam_from_model, answer.matching
    lines += [f"found pose: {pose.rotvec.round(5)} {pose.translation.round(5)}"]
    lines += [f"off by {outcome.error_px:.2f} px mean, {outcome.sigmas:.1f} sigma"]
    lines += [f"1 sigma: {np.sqrt(np.diag(answer.cov)).round(6)}"]
    lines += [
        f"{outcome.matched} of {answer.n_expected} matched, {outcome.wrong} wrong; rms {answer.rms_px:.2f} px, excess "
        f"{answer.excess_px:.2f} px, score {answer.score:.0f}, log10 nfa {answer.log10_nfa:.1f}, runner-up "
        f"{answer.runner_up and (round(answer.runner_up.score), answer.runner_up.count, answer.runner_up.same_labels)}"
    ]
    bend = answer.deformation
    lines += [f"deformation: {'none' if bend is None else f'{bend.largest:.2%}, {bend.parameters:.1f} parameters'}"]
    lines += [f"unchecked: {[item.what for item in getattr(answer, 'unchecked', ())]}"]
    pairs = zip(match.detection.tolist(), match.marker.tolist(), strict=True)
    lines += ["spot:found(true) " + " ".join(f"{d}:{m}({trial.truth.label[d]})" for d, m in pairs)]
    return "\n".join(lines)


@dataclass(frozen=True, eq=False)
class Frame:
    """One frame of a sequence: what it was, what came, and how that is judged."""

    trial: Trial
    answer: Any
    outcome: Outcome


def _tracked(attack: str, trial: SequenceTrial) -> list[Frame]:
    """The answers to a sequence, frame by frame."""
    state: TrackState | None = None
    frames = []
    for one in trial.frames:
        start = time.thread_time()
        answer, state = track(state, one.detections, one.markers, one.camera, **one.options)
        frames.append(Frame(one, answer, judged(attack, one, answer, 1e3 * (time.thread_time() - start))))
    return frames


def _worst(frames: list[Frame]) -> Frame:
    """The frame that stands for a sequence: the worst wrong one if there is any, else the worst of the usual kind."""
    kinds = Counter(f.outcome.kind for f in frames)
    kind = next((k for k in ("WRONG", "said") if kinds[k]), kinds.most_common(1)[0][0])
    return max((f for f in frames if f.outcome.kind == kind), key=lambda f: float(np.nan_to_num(f.outcome.sigmas)))


def _of_sequence(frames: list[Frame]) -> Outcome:
    """A sequence is wrong where one of its frames is, and right where most of them are followed."""
    outcomes = [f.outcome for f in frames]
    wrong, matched = sum(o.wrong for o in outcomes), sum(o.matched for o in outcomes)
    ms = float(np.median([o.milliseconds for o in outcomes]))
    return replace(_worst(frames).outcome, wrong=wrong, matched=matched, milliseconds=ms)


def _rig_error(trial: RigTrial, answer: RigRegistration, k: int) -> tuple[float, float]:
    """The worst of all cameras that matched markers: displacement in px and root of chi-square over six.

    Against the right pose with the number ``k``. A camera that is elsewhere than the rig has it needs another one.
    """
    errors = [(0.0, 0.0)]
    for i, (one, given) in enumerate(zip(trial.views, trial.cam_from_rig, strict=True)):
        if answer.counts[i]:
            truth = replace(one.truth, poses=one.truth.poses[k : k + 1])
            delta = (given.inverse() @ truth.poses[0] @ answer.rig_from_model.inverse()).log()
            sigmas = float(np.sqrt(delta @ np.linalg.solve(answer.cov, delta) / 6))
            errors.append((pose_error(truth, answer.cam_from_model(i), np.eye(6))[0], sigmas))
    return max(errors, key=lambda error: (is_off(trial.views[0].truth, *error), error[0]))


def _of_rig(attack: str, trial: RigTrial) -> tuple[Any, Outcome]:
    """The answer of a rig; its pose must be right for every camera in which it matched markers."""
    start = time.thread_time()
    answer = register_rig(*trial.arguments(), **trial.options)
    ms = 1e3 * (time.thread_time() - start)
    if not isinstance(answer, RigRegistration):
        # Nothing is wrong about a rig without a displaced camera.
        return answer, refusal(attack, answer, ms, trial.displaced or None)
    truth = trial.views[0].truth
    errors = [_rig_error(trial, answer, k) for k in range(len(truth.poses))]
    error, sigmas = min(errors, key=lambda error: (is_off(truth, *error), error[0]))
    wrong = sum(wrong_labels(*pair) for pair in zip(trial.views, answer.matchings, strict=True))
    faults = ["pose"] if is_off(truth, error, sigmas) else []
    if 2 * wrong > sum(answer.counts):
        faults.append("labels")
    kind = "WRONG" if faults else "right"
    return answer, Outcome(kind, error, sigmas, wrong, sum(answer.counts), ms, " and ".join(faults))


def run(attack: str, trial: Trial | SequenceTrial | RigTrial) -> Outcome:
    """Answer and judge one trial."""
    if isinstance(trial, SequenceTrial):
        return _of_sequence(_tracked(attack, trial))
    if isinstance(trial, RigTrial):
        return _of_rig(attack, trial)[1]
    answer, milliseconds = answered(trial)
    return judged(attack, trial, answer, milliseconds)


def shown(attack: str, trial: Trial | SequenceTrial | RigTrial) -> str:
    """One trial in words."""
    if isinstance(trial, SequenceTrial):
        frames = _tracked(attack, trial)
        worst = _worst(frames)
        kinds = ", ".join(f"{n} {kind}" for kind, n in Counter(f.outcome.kind for f in frames).items())
        return f"{kinds}; frame {frames.index(worst)}:\n{told(worst.trial, worst.answer, worst.outcome)}"
    if isinstance(trial, RigTrial):
        return "\n".join(map(str, _of_rig(attack, trial)))
    answer, milliseconds = answered(trial)
    return told(trial, answer, judged(attack, trial, answer, milliseconds))
