"""The fundamental matrix of pictures without camera parameters: refined, with covariance, wrong pairs named.

F = U diag(1, s, 0) V' has seven parameters: two rotations and s. The sum of squared Sampson distances is minimised over
them. Sources: Hartley and Zisserman, Multiple View Geometry (2nd ed.), sections 11.4 and 11.6; Bartoli and Sturm,
Nonlinear estimation of the fundamental matrix with minimal parameters, PAMI 2004 (the parameters).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import chdtri

from windmark.geometry.errors import DegenerateGeometry
from windmark.geometry.rotations import exp_so3
from windmark.geometry.two_view.distances import sampson_distance
from windmark.geometry.two_view.homography import fit_homography, transfer
from windmark.geometry.two_view.linear import fundamental_eight_point, fundamental_seven_point

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Ints = NDArray[np.int64]

PARAMETERS = 7
FEWEST = 8
LEVEL = 1e-3
"""Probability that right pairs are taken for wrong ones, or a true plane is not seen as one."""
LEFT = 2
"""What is left out is only believed if so many more pairs than parameters remain."""
MOST_SETS = 300
SMALL = 14
"""Up to so many pairs, every way to leave some off a plane is tried."""
OFF_PLANE = 3
"""Two points off a plane give the epipole of its homography, whatever they are; a third one checks it."""


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
        return _nothing(n, sigma_px, f"{n} matches; a fundamental matrix needs {FEWEST} (with a camera six will do)")
    if _line(a, sigma_px) or _line(b, sigma_px):
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
        first = _fit(a, b, sigma)
        size = np.zeros(n) if first is None else np.abs(sampson_distance(first[0], a, b))
        among = np.argsort(-size, kind="stable")[: len(among)]
    for out in combinations(among.tolist(), wrong):
        kept = np.ones(n, dtype=np.bool_)
        kept[list(out)] = False
        yield kept


def _count(n: int, k: int) -> float:
    return float(np.prod([(n - i) / (i + 1) for i in range(k)]))


def _attempt(a: Array, b: Array, kept: Mask, sigma: float) -> tuple[Array, float, Mask] | None:
    """F of the kept pairs with its cost where they agree and every other pair does not; None elsewhere."""
    fit = _fit(a[kept], b[kept], sigma)
    if fit is None:
        return None
    matrix, cost = fit
    dof = int(kept.sum()) - PARAMETERS
    if cost > chdtri(dof, LEVEL):
        return None
    return matrix, cost, kept


def _fit(a: Array, b: Array, sigma: float) -> tuple[Array, float] | None:
    """F and its cost in sigma^2 from linear starts; None where there is none."""
    starts: list[Array] = []
    with suppress(DegenerateGeometry, ValueError):
        starts.append(fundamental_eight_point(a, b))
    spread = np.unique(np.linspace(0, len(a) - 1, PARAMETERS).round().astype(int))
    if len(spread) == PARAMETERS:
        starts += [f for f in fundamental_seven_point(a[spread], b[spread]) if np.isfinite(f).all()]
    best: tuple[Array, float] | None = None
    for start in starts:
        matrix, cost = _minimise(start, a, b, sigma)
        if np.isfinite(cost) and (best is None or cost < best[1]):
            best = matrix, cost
    return best


def _minimise(start: Array, a: Array, b: Array, sigma: float) -> tuple[Array, float]:
    """Levenberg-Marquardt over the seven parameters, in coordinates of unit size."""
    scale = _scaled(a, b)
    u, s, v = _factors(np.linalg.inv(scale[1]).T @ start @ np.linalg.inv(scale[0]))

    def moved(p: Array) -> Array:
        middle = np.diag([1.0, s + p[6], 0.0])
        return np.asarray(scale[1].T @ (u @ exp_so3(p[:3])) @ middle @ (v @ exp_so3(p[3:6])).T @ scale[0])

    from scipy.optimize import least_squares

    done = least_squares(lambda p: sampson_distance(moved(p), a, b) / sigma, np.zeros(PARAMETERS), method="lm"
                         if len(a) >= PARAMETERS else "trf", max_nfev=200)  # fmt: skip
    matrix = moved(done.x)
    return matrix / np.linalg.norm(matrix), float(2 * done.cost)


def _factors(f: Array) -> tuple[Array, float, Array]:
    """Rotations U, V and s of the rank-two matrix nearest to f, up to its scale and sign."""
    u, s, vt = np.linalg.svd(f)
    u = u * np.array([1, 1, np.linalg.det(u)])
    v = vt.T * np.array([1, 1, np.linalg.det(vt)])
    return u, float(s[1] / s[0]), v


def _scaled(a: Array, b: Array) -> tuple[Array, Array]:
    out = []
    for p in (a, b):
        middle = p.mean(axis=0)
        size = max(float(np.sqrt(((p - middle) ** 2).sum(axis=1).mean() / 2)), 1e-12)
        out.append(np.array([[1 / size, 0, -middle[0] / size], [0, 1 / size, -middle[1] / size], [0, 0, 1]]))
    return out[0], out[1]


def _result(matrix: Array, cost: float, kept: Mask, a: Array, b: Array, sigma: float) -> Fundamental:
    """With covariance: that of the seven parameters, carried on."""
    scale = _scaled(a[kept], b[kept])
    u, s, v = _factors(np.linalg.inv(scale[1]).T @ matrix @ np.linalg.inv(scale[0]))
    sign = 1.0

    def moved(p: Array) -> Array:
        f = scale[1].T @ (u @ exp_so3(p[:3])) @ np.diag([1.0, s + p[6], 0.0]) @ (v @ exp_so3(p[3:6])).T @ scale[0]
        return np.asarray(sign * f / np.linalg.norm(f))

    sign = 1.0 if (moved(np.zeros(PARAMETERS)) * matrix).sum() > 0 else -1.0
    steps = 1e-6 * np.eye(PARAMETERS)
    slope = np.stack([(sampson_distance(moved(h), a[kept], b[kept]) - sampson_distance(moved(-h), a[kept], b[kept]))
                      / 2e-6 / sigma for h in steps], axis=1)  # fmt: skip
    cov7 = np.linalg.pinv(slope.T @ slope, rcond=1e-14)
    dof = int(kept.sum()) - PARAMETERS
    by_f = np.stack([(moved(h) - moved(-h)).ravel() / 2e-6 for h in steps], axis=1)
    ends, covs = [], []
    for side in (0, 1):
        slope_e = np.stack([(_epipole(moved(h), side) - _epipole(moved(-h), side)) / 2e-6 for h in steps], axis=1)
        ends.append(_epipole(matrix, side))
        covs.append(slope_e @ cov7 @ slope_e.T)
    return Fundamental(
        matrix, by_f @ cov7 @ by_f.T, kept, sampson_distance(matrix, a, b), ends[0], ends[1], covs[0], covs[1], sigma,
        float(np.sqrt(cost / dof)) if dof > 0 else float("nan"),
    )  # fmt: skip


def _epipole(matrix: Array, side: int) -> Array:
    """In picture a (side 0) or b (1), pixels; infinite where the lines are parallel."""
    null = np.linalg.svd(matrix if side == 0 else matrix.T)[2][2]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(null[:2] / null[2])


def _planar(a: Array, b: Array, kept: Mask, sigma: float) -> Fundamental | None:
    """The refusal of points on a plane; None where enough are off every plane."""
    off = _off_plane(a, b, kept, sigma)
    if off is None:
        return None
    but = f"all but the matches {', '.join(str(i + 1) for i in off)}" if len(off) else "all matches"
    return _nothing(
        len(a), sigma, f"a homography explains {but}: points on a plane, or no baseline, and fewer than {OFF_PLANE} "
        "off it do not determine and check a fundamental matrix" + ("; those may as well be wrong" if len(off) else "")
        + ". Match points off that plane, or give the camera", tuple(off),
    )  # fmt: skip


def _off_plane(a: Array, b: Array, kept: Mask, sigma: float) -> list[int] | None:
    """Pairs off a plane that holds all others, fewer than `OFF_PLANE`; None where there is no such plane."""
    rows = np.flatnonzero(kept)
    for count in range(OFF_PLANE):
        for out in combinations(range(len(rows)), count) if len(rows) <= SMALL else _worst(a, b, rows, count):
            if len(rows) - count >= 5 and _on_plane(a, b, np.delete(rows, out), sigma):
                return [int(k) for k in rows[list(out)]]
    return None


def _worst(a: Array, b: Array, rows: Ints, count: int) -> list[tuple[int, ...]]:
    """The pairs that homographies of the others say least of, taken out one after the other."""
    out: list[int] = []
    for _ in range(count):
        rest = [k for k in range(len(rows)) if k not in out]
        h = fit_homography(a[rows[rest]], b[rows[rest]])
        if h is None:
            return []
        off = ((transfer(h, a[rows[rest]]) - b[rows[rest]]) ** 2).sum(axis=1)
        out.append(rest[int(off.argmax())])
    return [tuple(out)]


def _on_plane(a: Array, b: Array, on: Ints, sigma: float) -> bool:
    h, back = fit_homography(a[on], b[on]), fit_homography(b[on], a[on])
    if h is None or back is None:
        return False
    ahead, behind = ((transfer(m, x) - y) ** 2 for m, x, y in ((h, a[on], b[on]), (back, b[on], a[on])))
    square = np.minimum(ahead.sum(axis=1), behind.sum(axis=1)) / (2 * sigma**2)  # noise of both pictures
    limit = chdtri(2, LEVEL / len(on))
    return bool(square.sum() <= chdtri(2 * len(on) - 8, LEVEL) and (square <= limit).all())


def _line(p: Array, sigma: float) -> bool:
    return bool(np.linalg.svd(p - p.mean(axis=0), compute_uv=False)[1] <= 3 * sigma * np.sqrt(len(p)))


def _nothing(n: int, sigma: float, reason: str, suspects: tuple[int, ...] = ()) -> Fundamental:
    two, four = np.full(2, np.nan), np.full((2, 2), np.nan)
    return Fundamental(
        np.full((3, 3), np.nan), np.full((9, 9), np.nan), np.zeros(n, dtype=np.bool_), np.full(n, np.nan), two, two,
        four, four, sigma, float("nan"), reason, suspects,
    )  # fmt: skip
