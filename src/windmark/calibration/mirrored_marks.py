"""Marks of mirrored pictures, or with y counted upward: no pose explains them, and their mirror image is explained."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from windmark.calibration.result import Calibration, NotCalibrated
from windmark.calibration.setup import Job
from windmark.calibration.start import start_poses
from windmark.scene import Observations

BETTER = 0.7
"""Residuals of a mirrored picture, as part of those of the picture as it is, from which it may be one: flat markers
have the same."""
FITS = 2.0
"""Residuals over the marks' own sigmas up to which what is not determined is not for want of a fit."""
NAMED = 5
"""Pictures that are named."""


def mirrored_refusal(
    job: Job, refusal: NotCalibrated, again: Callable[[Job], Calibration | NotCalibrated], seed: int
) -> NotCalibrated:
    """The refusal of marks that fit no solution; where they do with some pictures mirrored, with that as its reason.

    Parameters
    ----------
    again : calibrates a job from the beginning

    Notes
    -----
    By their rough markers alone the pictures are told that have a better pose mirrored; that they are is said only
    where the whole network agrees with these mirrored, and they do not fit it as they are: of flat markers the mirror
    image is as good, and another start may have found what the first one missed. y counted upward is a mirror image,
    too, turned by half a turn.
    """
    fits = refusal.sigma0 <= FITS
    misfit = refusal.cause in ("misfit", "not_converged") or (refusal.cause == "degenerate" and not fits)
    if not misfit or any(v.cam_from_model is not None for v in job.views):
        return refusal
    turned = _better_mirrored(job, seed)
    if not turned:
        return refusal
    # The ellipses of discs would only say the same.
    found = again(replace(job, observations=_mirrored(job, turned), ellipses=None))
    if not isinstance(found, Calibration) or not _mirrored_only(job, found, turned, seed):
        return refusal
    names = [job.views[v].name for v in sorted(turned)]
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    which = f"the marks of {', '.join(names[:NAMED])}{more}"
    if len(names) == len(job.views):
        which = "the marks of all pictures, or the table of markers,"
    reason = (
        f"{which} are mirrored (left and right exchanged, or y counted upward): with them mirrored all "
        "pictures agree, as they are no solution explains them"
    )
    return replace(refusal, reason=reason, cause="mirrored_marks")


def _better_mirrored(job: Job, seed: int) -> set[int]:
    """Views that have a pose with smaller residuals when their marks are mirrored."""
    obs, out = job.observations, set()
    for name, camera in job.cameras.items():
        mine = [v for v, view in enumerate(job.views) if view.camera == name and (obs.view == v).any()]
        turned = _mirrored(job, set(mine))
        scan, off = "focal_px" in job.free, []
        # A scan of the focal length that serves mirrored and right pictures together serves neither: each by itself.
        for xy in (obs.xy, turned.xy):
            marks = [(xy[obs.view == v], job.markers.xyz[obs.point[obs.view == v]]) for v in mine]
            rng = np.random.default_rng(seed)
            off.append(np.array([start_poses(camera, [m], scan_focal=scan, rng=rng)[2][0] for m in marks]))
        out |= {v for v, a, b in zip(mine, *off, strict=True) if b < BETTER * a}
    return out


def _mirrored_only(job: Job, found: Calibration, views: set[int], seed: int) -> bool:
    """Whether no view fits the network that was found with them mirrored about as well as it is."""
    known = {str(name): xyz for name, xyz in zip(found.markers.name, found.markers.xyz, strict=True)}
    there = np.array([str(name) in known for name in job.markers.name])
    xyz = np.array([known.get(str(name), np.full(3, np.nan)) for name in job.markers.name])
    obs, used = job.observations, there[job.observations.point]
    for v in views:
        mine, camera = used & (obs.view == v), found.cameras[job.views[v].camera]
        as_is, turned = (
            start_poses(camera, [(xy[mine], xyz[obs.point[mine]])], scan_focal=False, rng=np.random.default_rng(seed))
            for xy in (obs.xy, _mirrored(job, {v}).xy)
        )
        if not turned[2][0] < BETTER * as_is[2][0]:
            return False
    return True


def _mirrored(job: Job, views: set[int]) -> Observations:
    """The marks, those of some views mirrored left to right."""
    obs = job.observations
    mine = np.isin(obs.view, list(views))
    width = np.array([job.cameras[v.camera].size_px[0] for v in job.views])[obs.view]
    xy, cov = obs.xy.copy(), obs.cov.copy()
    xy[mine, 0] = width[mine] - 1 - xy[mine, 0]
    cov[mine, 0, 1] *= -1
    cov[mine, 1, 0] *= -1
    return replace(obs, xy=xy, cov=cov)
