"""Pictures of two cameras under one name: two groups, each with a focal length and principal point of its own.

No single picture is foreign then, and marks of either group are left out as if they were wrong; of a flat board the
poses take most of a focal length, and what is left looks like a shear, or like a board that changed. To first order
every group has what its pictures' marks ask for together (`changed_views`), and the division that explains most of the
residuals is looked for. It counts only where the network with two cameras agrees in itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.calibration.changed_scene import SURE
from windmark.calibration.result import Calibration, NotCalibrated
from windmark.calibration.setup import Job
from windmark.calibration.solve import Solved
from windmark.calibration.view_changes import ANEW, DISTORTION, FOCAL, PRINCIPAL_POINT, equations_of
from windmark.errors import plus_minus
from windmark.scene import Doubt

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

LEAST_VIEWS = 2
"""Pictures of each camera: a single one is `foreign`."""
DIFFER, REFOCUSED = 6.0, 3.0
"""Their focal lengths, principal points or distortions differ by so many sigmas, and the former by so many times what a
camera's do that focuses anew (`ANEW`), or as only two groups do (`_divided`): pictures of such a one fall into two by
chance."""
NAMED = 8
"""Pictures that are named at most."""
INTERIOR = ("focal_px", "cx", "cy", "k1")
KINDS = np.r_[FOCAL, PRINCIPAL_POINT, DISTORTION]
"""Of the changes of a view, those that tell two cameras: a shear is of single pictures."""
SCATTERED = ((0,), (1, 2), (0, 1, 2), (3,))
"""Of these, what may scatter from picture to picture in a lens that is loose or focuses by itself."""
SCATTER = np.geomspace(1e-6, 0.1, 61)
"""1 sigma of such a scatter: of focal lengths and principal points as parts of the focal length, of k1."""
OTHER = "another camera"
PATTERNS = ("focal", "principal", "distorted", "sheared", "scene")
"""Causes of doubts about what looks, in single pictures or many, like what two cameras make."""
CONSEQUENCES = ("picture", "marker", "focus", *PATTERNS)
"""Causes of doubts that two cameras under one name bring about."""
ASKING = ("picture", *PATTERNS)
"""Those of pictures that contradict the others of their camera."""


def likely_mixed(result: Calibration) -> bool:
    """Whether pictures differ in a way that two cameras may explain as well; one alone may be but the worst of them."""
    return any(d.cause in PATTERNS for d in result.doubts)


def two_cameras(job: Job, solved: Solved, again: Callable[[Job], Calibration | NotCalibrated]) -> Doubt | None:
    """What is said of pictures that are of two cameras; None where they are not, or it cannot be told.

    Parameters
    ----------
    job, solved : with one camera for all pictures
    again : calibrates a job from the beginning
    """
    if len(job.cameras) > 1 or job.rig or job.free_focal or job.free_principal or len(job.views) < 2 * LEAST_VIEWS:
        return None
    views, second = _division(solved)
    if min(second.sum(), (~second).sum()) < LEAST_VIEWS:
        return None
    ((name, camera),) = job.cameras.items()
    other = {v for v, mine in zip(views.tolist(), second.tolist(), strict=True) if mine}
    parted = replace(
        job, cameras={name: camera, OTHER: camera},
        views=tuple(replace(view, camera=OTHER if v in other else name) for v, view in enumerate(job.views)),
    )  # fmt: skip
    found = again(parted)
    if not isinstance(found, Calibration) or len(found.cameras) < 2:
        return None
    if any(d.cause in ASKING for d in found.doubts):
        return None  # of a lens that focuses by itself pictures ask for a focal length of their own still
    apart = [p for p in INTERIOR if _differ(found, name, p)]
    one, two = found.cameras[name], found.cameras[OTHER]
    far = any(abs(getattr(two, p) - getattr(one, p)) > REFOCUSED * ANEW * one.focal_px for p in apart if p != "k1")
    if not apart or not (far or _divided(solved, second, max(1.0, found.sigma0) ** 2)):
        return None
    fewer, more = sorted((OTHER, name), key=lambda n: sum(v.camera == n for v in found.views))
    names = tuple(v.name for v in found.views if v.camera == fewer)
    listed = ", ".join(["{}"] * min(len(names), NAMED)) + (f" and {len(names) - NAMED} more" * (len(names) > NAMED))
    what = "at another zoom or focus" if apart == ["focal_px"] else "of another camera"
    words = (
        f"{listed} look like pictures {what} than the other {len(found.views) - len(names)}: "
        f"{_interior(found, fewer)}, against {_interior(found, more)}; with a camera for each all agree"
    )
    return Doubt(names[:NAMED], words, "mixed")


def with_mixed(result: Calibration | NotCalibrated, doubt: Doubt) -> Calibration | NotCalibrated:
    """The outcome with one camera, with its reason in place of what follows from it."""
    if isinstance(result, NotCalibrated):
        return replace(result, reason=str(doubt))
    rest = tuple(d for d in result.doubts if d.cause not in CONSEQUENCES)
    names = dict.fromkeys(name for said in (doubt, *rest) for name in said.names)
    return replace(result, doubts=(doubt, *rest), suspect=tuple(names))


def _differ(found: Calibration, name: str, p: str) -> bool:
    """Whether a parameter differs surely."""
    sigma = np.hypot(found.sigma(OTHER, p), found.sigma(name, p))
    off = abs(getattr(found.cameras[OTHER], p) - getattr(found.cameras[name], p))
    return bool(found.sigma(name, p) and off > DIFFER * sigma)


def _divided(solved: Solved, second: Mask, scale: float) -> bool:
    """Whether two groups explain the marks clearly better than changes that scatter normally from view to view.

    Scattered by s, the changes of all views have the likelihood ln L = sum (s^2 c^2 / (1 + s^2 v) - ln(1 + s^2 v)) / 2
    beside none, with v and c the eigenvalues of b^T Q b and the score along its axes; two groups have that of their
    difference alone, less what as many idle unknowns are worth (BIC), and 1 / 2^V of it, for each view may be of
    either. Where changes do scatter, a ratio of `SURE` is met with a probability below `FALSE` (Ville's inequality).

    Parameters
    ----------
    second : (V,) views of the second camera
    scale : variance of unit weight, where each group has a camera
    """
    equations = equations_of(solved)
    every, score = equations.every[:, KINDS][..., KINDS] / scale, equations.score[:, KINDS] / scale
    idle = len(KINDS) * np.log(2 * solved.used.sum())
    groups = (_explained(every, score, second) - idle) / 2 - len(second) * np.log(2.0)
    focal = float(np.median([c.focal_px for c in solved.state.cameras]))
    unit, scattered = np.array([1.0, focal, focal, 1.0]), 0.0
    for kinds in map(list, SCATTERED):
        power = every[:, kinds][..., kinds] * unit[kinds][:, None, None] * unit[kinds]
        value, axes = np.linalg.eigh(power.reshape(len(second) * len(kinds), -1))
        along = (score[:, kinds] * unit[kinds]).ravel() @ axes
        each = SCATTER[:, None] ** 2
        beside = 1 + each * np.maximum(value, 0.0)
        scattered = max(scattered, float((each * along**2 / beside - np.log(beside)).sum(axis=1).max()) / 2)
    return groups - scattered > SURE / 2


def _interior(found: Calibration, name: str) -> str:
    camera = found.cameras[name]
    focal, x, y = (plus_minus(getattr(camera, p), found.sigma(name, p)) for p in ("focal_px", "cx", "cy"))
    return f"focal length {focal} px, principal point {x}, {y} px"


def _division(solved: Solved) -> tuple[NDArray[np.int64], Mask]:
    """Views (V,), and which of them (V,) are of a second camera, so that most of the residuals is explained."""
    equations = equations_of(solved)
    count = len(equations.views)
    every, score = equations.every[:, KINDS][..., KINDS], equations.score[:, KINDS]
    best, most = np.zeros(count, dtype=bool), 0.0
    for start in _starts(every, score):
        second, now = start, _explained(every, score, start)
        for _ in range(count):  # one view at a time changes sides, as long as that explains more
            tried = [_explained(every, score, second ^ (np.arange(count) == n)) for n in range(count)]
            n = int(np.argmax(tried))
            if not tried[n] > now:
                break
            second, now = second ^ (np.arange(count) == n), tried[n]
        if now > most:
            best, most = second, now
    return equations.views, best


def _explained(every: Array, score: Array, second: Mask) -> float:
    """By how much the sum of squares falls with changes that the ``second`` (V,) views have together."""
    own = every[second][:, :, second].sum(axis=(0, 2))
    pull = score[second].sum(axis=0)
    return float(pull @ np.linalg.pinv(own, hermitian=True) @ pull)


def _starts(every: Array, score: Array) -> list[Mask]:
    """Divisions of the views along what each asks for alone: of its focal length, its principal point, ..."""
    blocks = every[np.arange(len(score)), :, np.arange(len(score))]
    asked = np.einsum("vkl,vl->vk", np.linalg.pinv(blocks, hermitian=True), score)
    return [column > cut for column in asked.T for cut in np.unique(np.quantile(column, (0.25, 0.5, 0.75)))]
