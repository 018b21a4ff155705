"""Wrong pairs: those that the others, taken together, do not bear."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.special import fdtrc

from windmark.geometry.errors import DegenerateGeometry
from windmark.geometry.planar.fit import PlanarFit, fit_planar
from windmark.geometry.planar.transform import NEEDED, PlanarTransform

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Fitter = Callable[[str, NDArray[np.int64]], PlanarFit | None]

CHANCE = 1e-5
"""A good pair looks so wrong as rarely as this."""
GROSS = 80.0
"""And one that is so many times the median is wrong, too: several wrong ones hide each other in the sum."""
LEAST_PX, SIGMAS = 0.1, 5.0
"""By less than this nothing is called wrong, nor within so many sigma of its own marks."""
NOISE_ONLY = 2.0
"""A simple transformation explains pairs if it leaves no more than so many sigma of their marks."""
MOST = 0.3
"""Part of the pairs that may be wrong."""
NEIGHBOURS = 6
DRAWS, GAP, BETTER = 200, 2.0, 0.7
"""Threes of pairs that are tried for the motion of the most; the others of two motions are so much farther off than
what is still taken for noise: a surface that bends has places with every distance between. And two motions predict
pairs that they have not seen so much better than a smooth one does.
"""
STEP = 0.5
"""And they are nowhere between their markers nearer to each other than by this part of what they differ by."""


def sound_pairs(x: Array, y: Array, cov_x: Array, cov_y: Array) -> Mask:
    """Which pairs (N,) of places are sound.

    Judged is by how much the weighted sum of squares falls when a pair is left out (the externally studentised
    residual: a mark with much leverage cannot hide, for its residual is that of a fit without it). A pair is wrong

    - if without it an affine transformation explains all others to their noise: deformation that one mark alone shows
      is a wrong mark;
    - if it stands out from a smoothing spline through the others, so that deformation is not taken for wrong pairs.
      Where one affine transformation explains most of all pairs to their noise, all others are clearly off it by a step
      that no bending makes, and a spline calls several pairs wrong or predicts them worse than two motions do, these
      are the wrong ones: it bends towards both sides of a step.

    Pairs go one after the other, or together where they are no neighbours.
    """
    kept = np.ones(len(x), dtype=bool)
    spread = np.sqrt((np.trace(cov_x, axis1=1, axis2=2) + np.trace(cov_y, axis1=1, axis2=2)) / 2)
    spread = np.nan_to_num(spread, nan=0.0, posinf=0.0)

    def fitted(kind: str, at: NDArray[np.int64]) -> PlanarFit | None:
        if len(at) <= NEEDED[kind]:
            return None
        try:
            return fit_planar(kind, x[at], y[at], cov_x[at], cov_y[at])
        except DegenerateGeometry:
            return None

    bent: list[int] = []
    while kept.sum() > max(3, (1 - MOST) * len(x)):
        at = np.flatnonzero(kept)
        wrong = None
        for kind in ("affine", "similarity"):
            if (fit := fitted(kind, at)) is not None:
                one = _stands_out(fit, spread[at], 0.0) & (np.arange(len(at)) == int(fit.evidence.argmax()))
                rest = fitted(kind, at[~one]) if one.any() else None
                if rest is not None and rest.transform.misfit_px < NOISE_ONLY * float(np.median(spread[at])):
                    wrong = one
                break
        if wrong is None and (fit := fitted("spline", at)) is not None:
            wrong = _local_worst(_stands_out(fit, spread[at], GROSS), fit.evidence, x[at])
            bent += at[wrong].tolist()
        if wrong is None or not wrong.any():
            break
        kept[at[wrong]] = False
    # A pair near a wrong one may have looked wrong with it.
    if bent and (fit := fitted("spline", np.flatnonzero(kept))) is not None:
        off = fit.transform.apply(x[bent]) - y[bent]
        sigma = np.hypot(fit.transform.sigma_px(x[bent]), spread[bent])
        kept[np.array(bent)[np.hypot(*off.T) < SIGMAS * sigma]] = True
    most = _of_one_motion(x, y, cov_x, cov_y, spread)
    several = bool(bent) and int((~kept).sum()) > 1
    return most if most is not None and _two_motions(fitted, x, kept, most, several) else kept


def _two_motions(fitted: Fitter, x: Array, kept: Mask, most: Mask, several: bool) -> bool:
    """Whether the pairs besides ``most`` moved by a step, rather than with a surface that bends, as ``kept`` has it.

    ``several``: a spline called several pairs wrong.
    """
    if most.all():
        return False
    # One column of markers does not tell how the motion goes on from it: it may bend there.
    one, other = fitted("affine", np.flatnonzero(most)), fitted("affine", np.flatnonzero(~most))
    if one is None or other is None or not _is_step(one.transform, other.transform, x[most], x[~most]):
        return False
    if several:
        return True
    # A spline that takes a step for bending predicts the markers at it worse than two motions do.
    smooth, few = fitted("spline", np.flatnonzero(kept)), kept[~most]
    if smooth is None or not few.any():
        return False
    apart = np.vstack([one.held_out[kept[most]], other.held_out[few]])
    return float(np.sqrt((apart**2).sum(axis=1).mean())) < BETTER * smooth.held_out_px


def _is_step(one: PlanarTransform, other: PlanarTransform, x: Array, x_other: Array) -> bool:
    """Whether two motions are apart everywhere between their markers: of what bends, or hangs on a hinge, they meet.

    Between each marker of the second motion and the nearest one of the first their difference goes on straight.
    """
    near = x[cKDTree(x).query(x_other)[1]]
    first, last = (other.apply(at) - one.apply(at) for at in (near, x_other))
    along = last - first
    length = np.maximum((along**2).sum(axis=1), 1e-300)
    t = np.clip(-(first * along).sum(axis=1) / length, 0.0, 1.0)
    least = np.hypot(*(first + t[:, None] * along).T)
    return bool(np.median(least / np.maximum(np.hypot(*last.T), 1e-300)) > STEP)


def _of_one_motion(x: Array, y: Array, cov_x: Array, cov_y: Array, spread: Array) -> Mask | None:
    """The pairs (N,) of one affine transformation, where it explains most to their noise and no other nearly."""
    if len(x) <= 2 * NEEDED["affine"]:  # both motions must have some left over
        return None
    limit, rng = np.maximum(LEAST_PX, SIGMAS * spread), np.random.default_rng(0)
    place = np.column_stack([x - x.mean(axis=0), np.ones(len(x))])
    three = np.stack([rng.choice(len(x), 3, replace=False) for _ in range(DRAWS)])
    apart = np.abs(np.linalg.det(place[three]))
    three = three[apart > 0.1 * apart.max(initial=0.0)]
    if not len(three):
        return None
    off = place @ np.linalg.solve(place[three], y[three]) - y
    one = off[(np.hypot(*np.moveaxis(off, -1, 0)) < limit).sum(axis=1).argmax()]
    most = np.asarray(np.hypot(*one.T) < limit)
    for _ in range(3):
        try:
            fit = fit_planar("affine", x[most], y[most], cov_x[most], cov_y[most])
        except DegenerateGeometry:
            return None
        distance = np.hypot(*(fit.transform.apply(x) - y).T)
        most = distance < limit
    sure = most.mean() >= 1 - MOST and fit.transform.misfit_px < NOISE_ONLY * float(np.median(spread[most]))
    return most if sure and (distance[~most] > GAP * limit[~most]).all() else None


def _stands_out(fit: PlanarFit, spread: Array, gross: float) -> Mask:
    """Pairs that chance does not explain."""
    # Of a spline the weighted sum holds the bending, too, so that only its plane takes degrees of freedom.
    free = 2 * len(spread) - min(fit.freedom, 6.0) - 2
    if free < 1:
        return np.zeros(len(spread), dtype=bool)
    rest = np.maximum(fit.weighted - fit.evidence, 1e-12 * max(fit.weighted, 1e-300))
    out = np.asarray(fdtrc(2, free, fit.evidence / 2 / (rest / free)) < CHANCE)
    if gross:
        out |= fit.evidence > gross * max(float(np.median(fit.evidence)), 1e-300)
    off = np.hypot(*fit.held_out.T)
    return np.asarray(out & (off > LEAST_PX) & (off > SIGMAS * spread))


def _local_worst(wrong: Mask, evidence: Array, x: Array) -> Mask:
    """Of neighbours the worst: what is next to a wrong pair looks wrong, too."""
    if not wrong.any():
        return wrong
    near = cKDTree(x).query(x, min(NEIGHBOURS + 1, len(x)))[1]
    return np.asarray(wrong & (evidence >= evidence[near].max(axis=1)))
