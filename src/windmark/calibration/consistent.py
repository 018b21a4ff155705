"""An adjustment whose control has been tested: first the pictures alone, then with what is known beforehand.

In the pictures' own network wrong control bends nothing and throws out no right mark; what of it contradicts the rest
is left out and named, and the network is adjusted again with what is right.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.adjust.network import NetworkState
from windmark.calibration.agreement import Control
from windmark.calibration.control import Verdict, control_of, hold_frame, judge
from windmark.calibration.datum import Fixed, Free, Weighted
from windmark.calibration.eccentric import fitting, with_eccentricity
from windmark.calibration.finish import refuse_weak, transformed
from windmark.calibration.hypotheses import contradicted
from windmark.calibration.setup import Job, frames_of, taking_part, views_of
from windmark.calibration.solve import Solved
from windmark.errors import WindmarkError, g2, g3
from windmark.geometry import Pose, triangulate
from windmark.geometry.similarity import Similarity, align
from windmark.scene import Doubt

Mask = NDArray[np.bool_]

UNTOUCHED = "the sigmas do not contain that"


@dataclass(frozen=True)
class Held:
    """An adjusted network, and what its control was found to be.

    Parameters
    ----------
    job : with the control that is right
    solved : adjusted with that
    doubts : what of the control was left out or contradicts
    unclear : why the control cannot be used: which of it is wrong cannot be told; None if it can
    alone : the pictures without known markers, where there are some: what single pictures ask for is asked there, too
    misfit : whether all of the control fits badly, and none of it worse than the others
    """

    job: Job
    solved: Solved
    doubts: tuple[Doubt, ...] = ()
    unclear: Doubt | None = None
    alone: Solved | None = None
    misfit: bool = False


def with_control(job: Job, state: NetworkState, good: Mask, options: dict[str, Any]) -> Held:
    """Adjust the pictures alone, test the control, adjust with it.

    Where the pictures alone do not determine everything (one view of a known target) the control goes in untested, and
    marks tell.

    Raises
    ------
    DegenerateGeometry, ValueError
        As of `solve`.
    """
    alone = _alone(job, state, good, options)
    if alone is None:
        return _with_priors(Held(job, every_mark(job, state, good, options)), good, options)
    obs = job.observations
    seen = np.zeros(len(job.markers), dtype=np.bool_)
    seen[obs.point[alone.taken]] = True
    control = control_of(job, seen)
    if not len(control) or (len(control.point) and not hold_frame(control.xyz)):
        return Held(job, every_mark(job, state, good, options))  # which refuses the datum
    rough = align(alone.state.points[seen], job.markers.xyz[seen], scale=alone.covariance.motions.shape[1] == 7)
    verdict = judge(control, alone, rough)
    doubts = _said(job, control, verdict, alone, cleaned=options["reject"])
    if verdict.unclear:
        return Held(job, alone, unclear=doubts[0])
    if options["reject"]:
        job = _cleaned(job, control, verdict)
    start = _together(job, state, alone, verdict.fit, seen)
    fits = fitting(alone)
    fits |= good & ~alone.taken
    solved = with_eccentricity(job, start, good, options, fits)
    held = Held(job, solved, doubts, None, alone if len(control.point) else None, verdict.factor > 1)
    return _with_priors(held, good, options)


def _with_priors(held: Held, good: Mask, options: dict[str, Any]) -> Held:
    """Without priors of interior parameters that the pictures contradict."""
    job, solved = held.job, held.solved
    if not (job.prior_sigma and solved.report.converged and solved.redundancy > 0):
        return held
    wrong = contradicted(job, solved)
    if not wrong:
        return held
    if options["reject"]:
        job = replace(job, prior_sigma={k: v for k, v in job.prior_sigma.items() if k not in wrong})
        solved = with_eccentricity(job, solved.state, good, options, fitting(solved))
    how = "was left out" if options["reject"] else "is contradicted"
    doubts = [
        Doubt((name,), f"the prior of {{}} {how}: {off:.4g} from what the pictures say ({sigmas:.0f} sigma)", "camera")
        for name, (off, sigmas) in wrong.items()
    ]
    return replace(held, job=job, solved=solved, doubts=(*held.doubts, *doubts))


def _alone(job: Job, state: NetworkState, good: Mask, options: dict[str, Any]) -> Solved | None:
    """The network of the pictures without any control; None where there is no control, or they do not determine it."""
    if isinstance(job.datum, Free) and not job.distances:
        return None
    job = replace(job, datum=Free(), distances=(), solver="newton")
    if not taking_part(job, good)[0].any():
        return None  # a single picture of a known target
    try:
        solved = every_mark(job, state, good, options)
        if not (solved.report.converged and solved.redundancy > 0 and solved.sigma0 <= options["max_sigma0"]):
            return None
        refuse_weak(job, solved)
    except WindmarkError:
        return None
    return solved


def _cleaned(job: Job, control: Control, verdict: Verdict) -> Job:
    """The job with the right control, its sigmas enlarged where all of it fits worse than they say.

    Held markers are known as well as they fit, then: held where they are not, they would bend the network, or lose
    their marks, until too few are left to hold it.
    """
    points = len(control.point)
    bad = {str(job.markers.name[control.point[b]]) for b in verdict.wrong if b < points}
    gone = {int(control.distance[b - points]) for b in verdict.wrong if b >= points}
    datum, markers, factor = job.datum, job.markers, verdict.factor
    if isinstance(datum, Fixed | Weighted) and bad:
        names = datum.markers if datum.markers is not None else markers.name.tolist()
        datum = replace(datum, markers=[n for n in names if n not in bad])
    if isinstance(datum, Fixed) and factor > 1 and verdict.off > 0:
        datum = Weighted(datum.markers if datum.markers is not None else markers.name.tolist(), verdict.off)
    elif isinstance(datum, Weighted) and factor > 1:
        together = None if datum.covariance is None else datum.covariance.scaled(factor)
        datum = replace(datum, sigma=None if datum.sigma is None else datum.sigma * factor, covariance=together)
        markers = replace(markers, sigma=markers.sigma * factor)
    distances = tuple(replace(d, sigma=d.sigma * factor) for n, d in enumerate(job.distances) if n not in gone)
    return replace(job, datum=datum, markers=markers, distances=distances)


def _together(job: Job, start: NetworkState, alone: Solved, fit: Similarity, seen: Mask) -> NetworkState:
    """The pictures' network in the frame of its control; what took no part in it stays where it was."""
    state = transformed(alone.state, fit)
    points = np.where(seen[:, None], state.points, start.points)
    points = np.where(job.held[:, None], job.markers.xyz, points)
    frames = frames_of(job)[1]
    moved = np.isin(np.arange(len(start.frames.translation)), frames[job.observations.view[alone.taken]])
    rotation = np.where(moved[:, None, None], state.frames.rotation, start.frames.rotation)
    translation = np.where(moved[:, None], state.frames.translation, start.frames.translation)
    return replace(state, points=points, frames=Pose(rotation, translation))


def _said(job: Job, control: Control, verdict: Verdict, alone: Solved, *, cleaned: bool) -> tuple[Doubt, ...]:
    """What the test of the control found, in words; only one where it cannot be told what is wrong.

    ``cleaned``: what is wrong is left out (`_cleaned`), and not only said.
    """
    points, moved = len(control.point), verdict.fit.apply(alone.state.points)

    def names(block: int) -> tuple[str, ...]:
        index = control.point[block : block + 1] if block < points else control.bar[block - points]
        return tuple(str(n) for n in job.markers.name[index])

    def what(block: int) -> str:
        if block >= points:
            return "distance {} to {}"
        return "held marker {}" if isinstance(job.datum, Fixed) else "control point {}"

    def off(block: int) -> str:
        if block < points:
            known = np.isfinite(control.sigma[block])
            away = float(np.linalg.norm((control.xyz[block] - moved[control.point[block]])[known]))
        else:
            a, b = control.bar[block - points]
            away = float(control.length[block - points] - np.linalg.norm(moved[a] - moved[b]))
        return f"{g3(away)} {job.markers.length_unit or ''}".rstrip()

    if verdict.exchanged:
        pair = [what(b) for b in verdict.exchanged]
        left_out = "" if verdict.unclear or not cleaned else "both were left out; "
        return (Doubt(
            tuple(n for b in verdict.exchanged for n in names(b)),
            f"{pair[0]} and {pair[1]} are in each other's place in the table: {left_out}exchange their rows", "control",
        ),)  # fmt: skip
    if verdict.unclear:
        listed = ", ".join(f"{what(b)} ({off(b)})" for b in verdict.unclear)
        return (Doubt(
            tuple(n for b in verdict.unclear for n in names(b)),
            f"what is known contradicts itself; without any one of these the rest would fit: {listed}. Measure them "
            "again, leave the wrong one out, or give more control", "control",
        ),)  # fmt: skip
    how = "was left out" if cleaned else "is contradicted"
    out = [
        Doubt(names(b), f"{what(b)} {how}: {off(b)} from where the pictures and the other control put it "
                        f"({np.sqrt(t):.0f} sigma)", "control")
        for b, t in verdict.wrong.items()
    ]  # fmt: skip
    if verdict.factor > 1:
        bars = tuple(n for b in range(points, len(control)) for n in names(b))
        out.append(_two_families(verdict.ratio, bars, cleaned) if verdict.ratio else _misfit(job, verdict, cleaned))
    return tuple(out)


def _two_families(ratio: float, bars: tuple[str, ...], cleaned: bool) -> Doubt:
    """Known places and distances that contradict each other, and each agree."""
    listed = ", ".join(["{} to {}"] * (len(bars) // 2))
    return Doubt(bars, f"the known distances {listed} agree with each other, and so do the known places, but the "
                       f"distances are {ratio:.6g} times what the places make them: one kind is wrong, or in "
                       f"another unit; {'both sigmas were enlarged' if cleaned else UNTOUCHED}", "control")  # fmt: skip


def _misfit(job: Job, verdict: Verdict, cleaned: bool) -> Doubt:
    """All of the control fits badly, none of it worse than the others."""
    times, far = f"{verdict.factor:.1f} times worse", f"{g2(verdict.off)} {job.markers.length_unit or ''}".rstrip()
    if isinstance(job.datum, Fixed) and not job.distances:
        return Doubt((), f"held markers are off their table by some {far} (they fit {times} than the pictures know "
                         f"them); {'they were taken as known to that' if cleaned else UNTOUCHED}", "table")  # fmt: skip
    besides = f", as if known places were off by {far} more" if verdict.off > 0 else ""
    return Doubt((), f"the control fits {times} than its sigmas say{besides}, no single one is at fault; "
                     f"{'its sigmas were enlarged' if cleaned else UNTOUCHED}", "control")  # fmt: skip


def every_mark(job: Job, state: NetworkState, good: Mask, options: dict[str, Any]) -> Solved:
    """Adjust the good marks; markers that no camera could see where they started join once the others are adjusted."""
    solved, point = with_eccentricity(job, state, good, options), job.observations.point
    lost = np.setdiff1d(point[taking_part(job, good)[0]], point[solved.taken])
    if not len(lost) or not solved.report.converged:
        return solved
    return with_eccentricity(job, _placed(job, solved, good, lost), good, options)


def _placed(job: Job, solved: Solved, good: Mask, lost: NDArray[np.int64]) -> NetworkState:
    """Markers that took no part, for no camera could see them at their rough place, go where their marks say."""
    obs, state = job.observations, solved.state
    xy = np.full((len(job.views), len(lost), 2), np.nan)
    mine = good & np.isin(obs.point, lost)
    xy[obs.view[mine], np.searchsorted(lost, obs.point[mine])] = obs.xy[mine]
    cameras, poses = zip(*views_of(job, state), strict=True)
    found = triangulate(cameras, poses, xy)
    points = state.points.copy()
    points[lost[found.valid]] = found.xyz[found.valid]
    return replace(state, points=points)

