"""The fundamental matrix of pictures without camera parameters: refined, with covariance, wrong pairs named.

F = U diag(1, s, 0) V' has seven parameters: two rotations and s. The sum of squared Sampson distances is minimised over
them. Sources: Hartley and Zisserman, Multiple View Geometry (2nd ed.), sections 11.4 and 11.6; Bartoli and Sturm,
Nonlinear estimation of the fundamental matrix with minimal parameters, PAMI 2004 (the parameters).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import chdtri

from windmark.geometry.two_view.distances import sampson_distance
from windmark.geometry.two_view.fundamental_fit import PARAMETERS, fits, spread_of
from windmark.geometry.two_view.fundamental_plane import OFF_PLANE, off_plane, on_line

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FEWEST = 8
LEVEL = 1e-3
"""Probability that right pairs are taken for wrong ones."""
LEFT = 2
"""What is left out is only believed if so many more pairs than parameters remain."""
MOST_SETS = 300


@dataclass(frozen=True)
class Fundamental:
    """Result of `refine_fundamental`; false where F is not determined, with its ``reason``.

    Parameters
    ----------
    matrix : (3, 3) of norm 1, ``x_b^T F x_a = 0``; NaN without a result
    cov : (9, 9) covariance of its elements, row by row, of rank 7
    used : (N,) pairs that agree
    distance_px : (N,) signed Sampson distance of every pair; NaN without a result
    epipole_a, epipole_b : (2,) where each picture sees the other camera; infinite for a direction
    cov_a, cov_b : (2, 2) of the epipoles
    sigma_px : 1 sigma per coordinate that was used
    sigma0 : residuals over it; NaN without redundancy
    reason : why there is no result, "" where there is
    suspects : pairs one of which must be wrong, where the data cannot tell which
    """

    matrix: Array
    cov: Array
    used: Mask
    distance_px: Array
    epipole_a: Array
    epipole_b: Array
    cov_a: Array
    cov_b: Array
    sigma_px: float
    sigma0: float
    reason: str = ""
    suspects: tuple[int, ...] = ()

    def __bool__(self) -> bool:
        return not self.reason


def refine_fundamental(xy_a: ArrayLike, xy_b: ArrayLike, *, sigma_px: float = 1.0, most_wrong: int = 3) -> Fundamental:
    """Fundamental matrix of pairs of which a few may be wrong, and which those are.

    Parameters
    ----------
    xy_a, xy_b : (N, 2) pixels of pictures without lens distortion, row by row one point
    sigma_px : 1 sigma per coordinate, what a lens leaves included
    most_wrong : so many pairs are left out at most

    Returns
    -------
    Fundamental
        False for fewer than eight pairs, points on a plane (a homography explains them), pairs that contradict each
        other without telling which is wrong, or too many wrong ones.

    Raises
    ------
    ValueError
        Shapes that do not fit, numbers that are not finite, a sigma that is not positive.
    """
    a, b = np.asarray(xy_a, dtype=float), np.asarray(xy_b, dtype=float)
    if a.ndim != 2 or a.shape != b.shape or a.shape[-1] != 2:
        raise ValueError(f"refine_fundamental: xy_a and xy_b must both be (N, 2), got {a.shape} and {b.shape}")
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        raise ValueError("refine_fundamental: xy_a and xy_b must be finite")
    if not sigma_px > 0:
        raise ValueError(f"refine_fundamental: sigma_px must be positive, got {sigma_px}")
    n = len(a)
    if n < FEWEST:
        return _nothing(n, sigma_px, f"{n} matches; a fundamental matrix needs {FEWEST} (with a camera seven will do)")
    if on_line(a, sigma_px) or on_line(b, sigma_px):
        return _nothing(n, sigma_px, "all matches are on a line: no epipolar geometry is determined")
    if (planar := _planar(a, b, np.ones(n, dtype=np.bool_), sigma_px)) is not None:
        return planar
    for wrong in range(most_wrong + 1):
        if wrong and n - wrong < PARAMETERS + LEFT:
            break
        tried = (_attempt(a, b, kept, sigma_px) for kept in _subsets(a, b, wrong, sigma_px))
        good = sorted((r for r in tried if r is not None), key=lambda r: r[1])
        if not good:
            continue
        (matrix, cost, kept), others = good[0], good[1:]
        if others and others[0][1] < cost + chdtri(1, LEVEL):
            doubtful = sorted({int(i) for r in (good[0], *others) for i in np.flatnonzero(~r[2])
                               if r[1] < cost + chdtri(1, LEVEL)})  # fmt: skip
            which = ", ".join(str(i + 1) for i in doubtful)
            return _nothing(n, sigma_px, f"{wrong} of the matches {which} must be wrong, but {n} matches do not tell "
                            "which; add matches", tuple(doubtful))  # fmt: skip
        if (planar := _planar(a, b, kept, sigma_px)) is not None:
            return planar
        return _result(matrix, cost, kept, a, b, sigma_px)
    more = "; with more matches a wrong one can be named" if n < PARAMETERS + LEFT + 1 else ""
    tries = min(most_wrong, max(n - PARAMETERS - LEFT, 0))
    left = f", and leaving out up to {tries} does not help" if tries else ""
    return _nothing(
        n, sigma_px, f"{n} matches contradict each other by more than {sigma_px:g} px (1 sigma){left}{more}"
    )


def _subsets(a: Array, b: Array, wrong: int, sigma: float) -> Iterator[Mask]:
    """Which pairs are kept where ``wrong`` are left out: all ways, or those of the largest contradictions."""
    n = len(a)
    among = np.arange(n)
    while _count(len(among), wrong) > MOST_SETS:
        among = among[:-1]
    if len(among) < n:  # the pairs that a fit of all says least of come last
        first = fits(a, b, sigma)
        size = np.abs(sampson_distance(first[0][0], a, b)) if first else np.zeros(n)
        among = np.argsort(-size, kind="stable")[: len(among)]
    for out in combinations(among.tolist(), wrong):
        kept = np.ones(n, dtype=np.bool_)
        kept[list(out)] = False
        yield kept


def _count(n: int, k: int) -> float:
    return float(np.prod([(n - i) / (i + 1) for i in range(k)]))


def _attempt(a: Array, b: Array, kept: Mask, sigma: float) -> tuple[Array, float, Mask] | None:
    """F of the kept pairs with its cost where they agree and every other pair does not; None elsewhere."""
    found = fits(a[kept], b[kept], sigma)
    if not found:
        return None
    matrix, cost = found[0]
    dof = int(kept.sum()) - PARAMETERS
    if cost > chdtri(dof, LEVEL):
        return None
    return matrix, cost, kept


def _result(matrix: Array, cost: float, kept: Mask, a: Array, b: Array, sigma: float) -> Fundamental:
    """With covariance: that of the seven parameters, carried on."""
    cov7, slope = spread_of(matrix, a[kept], b[kept], sigma)
    dof = int(kept.sum()) - PARAMETERS
    by_f = slope(lambda f: f.ravel())
    by_a, by_b = slope(lambda f: _epipole(f, 0)), slope(lambda f: _epipole(f, 1))
    return Fundamental(
        matrix, by_f @ cov7 @ by_f.T, kept, sampson_distance(matrix, a, b), _epipole(matrix, 0), _epipole(matrix, 1),
        by_a @ cov7 @ by_a.T, by_b @ cov7 @ by_b.T, sigma, float(np.sqrt(cost / dof)) if dof > 0 else float("nan"),
    )  # fmt: skip


def _epipole(matrix: Array, side: int) -> Array:
    """In picture a (side 0) or b (1), pixels; infinite where the lines are parallel."""
    null = np.linalg.svd(matrix if side == 0 else matrix.T)[2][2]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(null[:2] / null[2])


def _planar(a: Array, b: Array, kept: Mask, sigma: float) -> Fundamental | None:
    """The refusal of points on a plane; None where enough are off every plane."""
    off = off_plane(a, b, kept, sigma)
    if off is None:
        return None
    but = f"all but the matches {', '.join(str(i + 1) for i in off)}" if len(off) else "all matches"
    return _nothing(
        len(a), sigma, f"a homography explains {but}: points on a plane, or no baseline, and fewer than {OFF_PLANE} "
        "off it do not determine and check a fundamental matrix" + ("; those may as well be wrong" if len(off) else "")
        + ". Match points off that plane, or give the camera", tuple(off),
    )  # fmt: skip


def _nothing(n: int, sigma: float, reason: str, suspects: tuple[int, ...] = ()) -> Fundamental:
    two, four = np.full(2, np.nan), np.full((2, 2), np.nan)
    return Fundamental(
        np.full((3, 3), np.nan), np.full((9, 9), np.nan), np.zeros(n, dtype=np.bool_), np.full(n, np.nan), two, two,
        four, four, sigma, float("nan"), reason, suspects,
    )  # fmt: skip
