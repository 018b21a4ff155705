"""The fit to the taps: generalised least squares with shared errors, blocked taps by a family-wise test.

Blocked taps come in groups (a tube, a scanner), so they can pull the fit to themselves and look right in its residuals.
The search therefore goes forward (Hadi, J. R. Stat. Soc. B 54, 1992): it starts from the half of the taps that agree
best with a fit through as few taps as there are unknowns, takes in the next best one after another, and ends where the
next one would be left out by a test that is wrong once in twenty for all taps together (Pope 1976; Heck 1981).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations, islice
from math import comb

import numpy as np
from numpy.typing import NDArray

from windmark.errors import g3
from windmark.paint.modes import NodeField

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FALSE = 0.05
"""Probability that any tap at all is left out where none is wrong."""
STARTS = 3000
"""Fits through as few taps as there are unknowns that are tried; of more there are evenly chosen ones."""
_ROUNDS = 4


@dataclass(frozen=True, eq=False)
class TapFit:
    """Of M taps: see `InSitu`; ``response`` (P, U), ``slope`` (U,) and ``total`` are of the U taps that count."""

    coefficients: Array
    cov: Array
    used: Mask
    residuals: Array
    reasons: Mapping[int, str]
    scatter: float
    response: Array
    slope: Array
    design: Array
    total: Array
    noise: float


@dataclass(frozen=True, eq=False)
class _Taps:
    """What is fitted: readings (M,), their variances, x with its modes, and the powers of u (M, P)."""

    p: Array
    variance: Array
    x: NodeField
    powers: Array
    scale: float
    free: str

    def slope(self, coefficients: Array) -> Array:
        k = np.arange(1, len(coefficients))
        return np.asarray(self.powers[:, :-1] @ (coefficients[1:] * k) / self.scale)

    def covariance(self, of: NDArray[np.int64], coefficients: Array, scatter: float) -> Array:
        """(U, U) of readings less fit: sigma, noise of x, scatter, and the errors that taps share."""
        s = self.slope(coefficients)[of]
        m = s[:, None] * self.x.modes[of]
        return np.asarray(np.diag(self.variance[of] + s**2 * self.x.white[of] + scatter**2) + m @ m.T)

    def solve(self, of: NDArray[np.int64], total: Array) -> tuple[Array, Array, Array]:
        """Coefficients (P,), their response (P, U) to the readings, and covariance, for readings' covariance."""
        from scipy.linalg import cho_factor, cho_solve

        design = self.powers[of] if self.free == "both" else self.powers[of, :1]
        y = self.p[of] - (0.0 if self.free == "both" else self.scale * self.powers[of, 1])
        factor = cho_factor(total)
        inverse = np.linalg.pinv(design.T @ cho_solve(factor, design), hermitian=True)
        own = inverse @ cho_solve(factor, design).T
        n = self.powers.shape[1]
        response = np.zeros((n, len(of)))
        response[: len(own)] = own
        coefficients = np.zeros(n)
        coefficients[: len(own)] = own @ y
        if self.free == "offset":
            coefficients[1] = self.scale
        return coefficients, response, np.asarray(response @ total @ response.T)


def fit_taps(p: Array, sigma: Array, x: NodeField, have: Mask, centre: float, scale: float, order: int, free: str
             ) -> TapFit:  # fmt: skip
    """The fit of readings ``p`` (M,) with ``sigma`` (M,) to x; taps beside ``have`` (M,) take no part."""
    powers = ((np.where(have, x.value, centre) - centre) / scale)[:, None] ** np.arange(order + 1)
    taps = _Taps(p, sigma**2, x, powers, scale, free)
    candidates = np.flatnonzero(have)
    of, tests = _forward(taps, candidates)
    scatter, coefficients = 0.0, _start(taps, of)
    for _ in range(_ROUNDS):
        scatter = _scatter(taps, of, coefficients)
        total = taps.covariance(of, coefficients, scatter)
        coefficients, response, _ = taps.solve(of, total)
    scatter *= _student(len(of) - (order + 1 if free == "both" else 1))
    # Errors that the taps share with the nodes are modes; the fit's own covariance is of the rest.
    own = taps.covariance(of, coefficients, scatter)
    m = taps.slope(coefficients)[of, None] * x.modes[of]
    cov = response @ (own - m @ m.T) @ response.T
    design = powers[of] if free == "both" else powers[of, :1]
    if np.linalg.matrix_rank(design, tol=1e-6 * np.sqrt(len(of))) < design.shape[1]:
        cov = np.full(cov.shape, np.inf)
    residuals = np.where(have, p - powers @ coefficients, np.nan)
    used = np.zeros(len(p), bool)
    used[of] = True
    reasons = {int(k): f"{residuals[k]:+.4g} off, by {g3(tests[k])} sigma" for k in candidates.tolist() if not used[k]}
    return TapFit(coefficients, cov, used, residuals, reasons, scatter, response, taps.slope(coefficients)[of],
                  design, total, float(np.sqrt(np.mean(np.diag(taps.covariance(of, coefficients, 0.0))))))  # fmt: skip


def _start(taps: _Taps, of: NDArray[np.int64]) -> Array:
    """A first fit: readings' own sigmas, x as it is."""
    slope_one = np.zeros(taps.powers.shape[1])
    slope_one[1] = taps.scale
    first = taps.solve(of, np.diag(taps.variance[of]))[0]
    return taps.solve(of, taps.covariance(of, first if first[1] > 0 else slope_one, 0.0))[0]


def _forward(taps: _Taps, candidates: NDArray[np.int64]) -> tuple[NDArray[np.int64], dict[int, float]]:
    """The taps that count, and how far the others are from them in sigmas."""
    unknowns = taps.powers.shape[1] if taps.free == "both" else 1
    count = len(candidates)
    of = _best_half(taps, candidates, unknowns)
    while True:
        inside, outside = _tests(taps, of, candidates)
        rest = np.setdiff1d(candidates, of)
        if not len(rest):
            of = _backward(taps, of, candidates, unknowns)
            return of, _sizes(taps, of, candidates)
        nearest = rest[np.argsort(outside[rest], kind="stable")]
        if outside[nearest[0]] > _critical(count, len(of) - unknowns):
            of = _backward(taps, of, candidates, unknowns)
            return of, _sizes(taps, of, candidates)
        # The best ones of all that were looked at, one more than before: those taken early may go out again.
        distance = np.where(np.isin(candidates, of), inside[candidates], outside[candidates])
        of = np.sort(candidates[np.argsort(distance, kind="stable")[: len(of) + 1]])


def _backward(taps: _Taps, of: NDArray[np.int64], candidates: NDArray[np.int64], unknowns: int) -> NDArray[np.int64]:
    """Without taps that stand out of all others that count: on the way forward the scale is a guess."""
    while len(of) > unknowns + 2:
        inside, _ = _tests(taps, of, candidates, trimmed=False)
        worst = int(of[np.argmax(inside[of])])
        others = of[of != worst]
        outside = _tests(taps, others, candidates, trimmed=False)[1][worst]
        if not outside > _critical(len(candidates), len(others) - unknowns):
            break
        of = others
    return of


def _sizes(taps: _Taps, of: NDArray[np.int64], candidates: NDArray[np.int64]) -> dict[int, float]:
    """How far the taps that do not count are from the others, in sigmas."""
    outside = _tests(taps, of, candidates, trimmed=False)[1]
    return {int(k): float(outside[k]) for k in np.setdiff1d(candidates, of)}


def _best_half(taps: _Taps, candidates: NDArray[np.int64], unknowns: int) -> NDArray[np.int64]:
    """The taps next to the fit through a few of them to which half of all come nearest."""
    count = len(candidates)
    half = min(max((count + unknowns + 1) // 2, unknowns + 1), count)
    design = taps.powers[candidates][:, :unknowns]
    y = taps.p[candidates] - (0.0 if taps.free == "both" else taps.scale * taps.powers[candidates, 1])
    sigma = np.sqrt(taps.variance[candidates] + taps.x.white[candidates])
    step = max(1, -(-comb(count, unknowns) // STARTS))
    best, chosen = np.inf, np.arange(half)
    for few in islice(combinations(range(count), unknowns), 0, None, step):
        a = design[list(few)]
        if np.linalg.cond(a) > 1e6:
            continue
        off = np.abs(y - design @ np.linalg.solve(a, y[list(few)])) / sigma
        order = np.argsort(off, kind="stable")[:half]
        size = float((off[order] ** 2).sum())
        if size < best:
            best, chosen = size, order
    return np.asarray(np.sort(candidates[chosen]))


def _tests(taps: _Taps, of: NDArray[np.int64], candidates: NDArray[np.int64], *, trimmed: bool = True
           ) -> tuple[Array, Array]:  # fmt: skip
    """Sizes (M,) of residuals in sigmas: of taps that count, and of predictions of the others. NaN elsewhere.

    The scale is that of the residuals, or 1 where these are smaller than stated; ``trimmed``: of taps that were chosen
    for fitting best.
    """
    coefficients = _start(taps, of)
    total = taps.covariance(of, coefficients, 0.0)
    coefficients, response, _ = taps.solve(of, total)
    residual = taps.p - taps.powers @ coefficients
    projector = np.eye(len(of)) - taps.powers[of] @ response
    left = projector @ total @ projector.T
    inverse = np.linalg.inv(total)
    dof = len(of) - int(np.linalg.matrix_rank(response))
    squares = float(residual[of] @ inverse @ residual[of])
    scale = max(squares / dof / (_of_best(len(of) / len(candidates)) if trimmed else 1.0), 1.0) if dof > 0 else 1.0
    inside, outside = np.full(len(taps.p), np.nan), np.full(len(taps.p), np.nan)
    e = inverse @ residual[of]
    spread = np.diagonal(inverse @ left @ inverse)
    inside[of] = np.where(spread > 1e-12 / np.diagonal(total), np.abs(e) / np.sqrt(np.maximum(spread, 1e-300)), 0.0)
    rest = np.setdiff1d(candidates, of)
    if len(rest):
        both = np.concatenate([of, rest])
        joint = taps.covariance(both, coefficients, 0.0)
        cross, own = joint[len(of) :, : len(of)], joint[len(of) :, len(of) :]
        row = taps.powers[rest] @ response
        var = np.diagonal(own) - 2 * np.einsum("nk,nk->n", row, cross) + np.einsum("nk,kl,nl->n", row, total, row)
        outside[rest] = np.abs(residual[rest]) / np.sqrt(np.maximum(var, 1e-300))
    return inside / np.sqrt(scale), outside / np.sqrt(scale)


def _of_best(share: float) -> float:
    """Mean square of the smallest ``share`` of normal deviates: what fits best by choice scatters too little."""
    from scipy.special import ndtri

    if share >= 1:
        return 1.0
    q = float(ndtri(0.5 + 0.5 * share))
    return 1 - 2 * q * float(np.exp(-0.5 * q * q)) / np.sqrt(2 * np.pi) / share


def _critical(count: int, dof: int) -> float:
    """Size in sigmas that any of ``count`` good taps exceeds with the probability `FALSE` (Student, two-sided)."""
    from scipy.special import stdtrit

    return float(stdtrit(max(dof, 1), 1 - 0.5 * FALSE / max(count, 1)))


def _student(dof: int) -> float:
    """By which a scatter that comes from so few residuals must be larger for 1.96 of it to hold 95 %."""
    from scipy.special import stdtrit

    return float(stdtrit(max(dof, 1), 0.975)) / 1.959964


def _scatter(taps: _Taps, of: NDArray[np.int64], coefficients: Array) -> float:
    """The scatter for which the squared residuals are what they should be (Paule and Mandel, 1982); 0 if they are."""
    unknowns = taps.powers.shape[1] if taps.free == "both" else 1
    dof = len(of) - unknowns

    def excess(scatter: float) -> float:
        total = taps.covariance(of, coefficients, scatter)
        r = taps.p[of] - taps.powers[of] @ taps.solve(of, total)[0]
        return float(r @ np.linalg.solve(total, r)) - dof

    if dof < 1 or excess(0.0) <= 0:
        return 0.0
    low, high = 0.0, float(np.sqrt(taps.variance[of].max()))
    while excess(high) > 0 and high < 1e6 * float(np.sqrt(taps.variance[of].max())):
        low, high = high, 2 * high
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) > 0 else (low, middle)
    return 0.5 * (low + high)


def leave_one_out(fit: TapFit) -> Array:
    """(U,) residual of each tap that counts against the fit of the others, by the projector of the fit itself."""
    inverse = np.linalg.inv(fit.total)
    r = fit.residuals[fit.used]
    projector = inverse - inverse @ fit.design @ np.linalg.pinv(fit.design.T @ inverse @ fit.design) @ (
        inverse @ fit.design
    ).T
    own = np.diagonal(projector)
    return np.asarray(np.where(own > 1e-12 * np.diagonal(inverse), projector @ r / np.maximum(own, 1e-300), np.nan))
