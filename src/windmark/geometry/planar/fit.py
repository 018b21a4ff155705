"""Weighted least-squares fit of a planar transformation, with its held-out residuals in closed form.

The noise of a pair is that of its two marks, ``cov_image + J cov_reference J'``, and what the kind of transformation
cannot follow: one variance for all pairs, as large as the residuals ask for (their weighted sum of squares becomes its
expectation, as in a random-effects model). So a kind that fits badly does not live on its few best-measured marks, and
its covariance is not that of noise alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError, g2
from windmark.geometry.errors import DegenerateGeometry
from windmark.geometry.planar import bases
from windmark.geometry.planar.spline import fit_spline
from windmark.geometry.planar.transform import KINDS, NEEDED, PlanarTransform

Array = NDArray[np.float64]

FLAT = 0.02
"""Width over length of the marks below which they are a line: nothing is known across it."""
HANGS = 1e-3
"""Part of its own residual that a mark must show: below it the fit goes through this mark whatever it says."""
UNTOLD = 4e-4
"""Mean square that terms of the next order must leave at the markers: of less, they tell next to nothing."""
UNKNOWN_PX = 0.1
"""1 sigma of a mark without a covariance."""
_ROUNDS, _SETTLED = 40, 1e-10


@dataclass(frozen=True)
class PlanarFit:
    """A transformation and how well it explains its pairs.

    Parameters
    ----------
    transform : reference -> image
    residual : (N, 2) mapped - seen, image pixels
    held_out : (N, 2) the same for each pair from a fit without it, in closed form
    freedom : effective number of parameters (that of a spline lies between 6 and 2 N)
    evidence : (N,) by how much the weighted sum of squares falls when a pair is left out
    weighted : weighted sum of squares of all pairs
    """

    transform: PlanarTransform
    residual: Array
    held_out: Array
    freedom: float
    evidence: Array
    weighted: float

    @property
    def rms_px(self) -> float:
        """Root mean square length of the residuals, pixels (2-D)."""
        return float(np.sqrt((self.residual**2).sum(axis=1).mean()))

    @property
    def held_out_px(self) -> float:
        """Root mean square length of the held-out residuals, pixels (2-D)."""
        return float(np.sqrt((self.held_out**2).sum(axis=1).mean()))


def fit_planar(
    kind: str, reference_xy: ArrayLike, image_xy: ArrayLike, cov_reference: ArrayLike | None = None,
    cov_image: ArrayLike | None = None,
) -> PlanarFit:  # fmt: skip
    """Fit one kind of transformation to pairs of places.

    Parameters
    ----------
    kind : one of `KINDS`
    reference_xy, image_xy : (N, 2) pixels
    cov_reference, cov_image : (N, 2, 2) px^2; None or NaN counts as 0.1 px per coordinate

    Raises
    ------
    ValueError
        Unknown kind, wrong shapes.
    DegenerateGeometry
        Too few pairs (`NEEDED`), marks on a line (a similarity bears that), or a fit that hangs on one mark.

    Notes
    -----
    Held-out: without mark i its residual is ``(I - H_i)^-1 r_i`` with its block of the hat matrix (for the projective
    kind to first order). Judging a transformation on marks that it has not seen: Bell, NTRS 20020034950.
    """
    x, y = np.asarray(reference_xy, dtype=float), np.asarray(image_xy, dtype=float)
    if kind not in KINDS:
        raise UsageError(f"fit_planar: kind must be one of {', '.join(KINDS)}, got {kind!r}")
    if x.ndim != 2 or x.shape[1] != 2 or x.shape != y.shape or not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise ValueError(f"fit_planar: places must both be finite (N, 2), got {x.shape} and {y.shape}")
    if len(x) < NEEDED[kind]:
        raise DegenerateGeometry(f"{kind} needs at least {NEEDED[kind]} pairs of markers, there are {len(x)}")
    cov_x, cov_y = _covariances(cov_reference, len(x)), _covariances(cov_image, len(x))
    centre, origin = x.mean(axis=0), y.mean(axis=0)
    length = float(np.sqrt(((x - centre) ** 2).sum(axis=1).mean()))
    if not length > 0:
        raise DegenerateGeometry(f"{kind}: all markers are in one place")
    u = (x - centre) / length
    _check_spread(kind, u, length)
    if kind == "spline":
        slope = bases.slope("affine", u, np.linalg.lstsq(bases.monomials(1, u), y - origin, rcond=None)[0].T.ravel())
        spread = cov_y + slope @ cov_x @ np.swapaxes(slope, 1, 2) / length**2
        got = fit_spline(u, y - origin, np.trace(spread, axis1=1, axis2=2) / 2)
        transform = PlanarTransform(kind, centre, length, origin, got.parameters, got.cov, got.misfit_px, u)
        return PlanarFit(transform, got.residual, got.held_out, got.freedom, got.evidence, got.weighted)
    return _fit_parameters(kind, u, y - origin, cov_x / length**2, cov_y, centre, length, origin)


def _fit_parameters(
    kind: str, u: Array, goal: Array, cov_u: Array, cov_y: Array, centre: Array, length: float, origin: Array
) -> PlanarFit:  # fmt: skip
    """Gauss-Newton; what the kind cannot follow is estimated along with it."""
    p = _start(kind, u, goal)
    misfit = 0.0
    free = 2 * len(u) - len(p)
    for _ in range(_ROUNDS):
        j = bases.slope(kind, u, p)
        spread = cov_y + j @ cov_u @ np.swapaxes(j, 1, 2)
        residual = bases.evaluate(kind, u, p) - goal
        misfit = _misfit(residual, spread, free)
        weight = np.linalg.inv(spread + misfit * np.eye(2))
        a = bases.design(kind, u, p)
        aw = np.swapaxes(a, 1, 2) @ weight
        step, cov = _solve(kind, (aw @ a).sum(axis=0), np.einsum("npk,nk->p", aw, residual))
        p = p - step
        if np.abs(step).max() < _SETTLED * max(float(np.abs(p).max()), 1.0):
            break
    residual = bases.evaluate(kind, u, p) - goal
    rest = np.eye(2) - a @ cov @ aw
    weakest = np.linalg.eigvals(rest).real.min(axis=1)
    if weakest.min() < HANGS:
        raise DegenerateGeometry(
            f"{kind} hangs on the marker at x {centre[0] + length * u[weakest.argmin(), 0]:.0f}, y "
            f"{centre[1] + length * u[weakest.argmin(), 1]:.0f} px of the reference alone: no other marker checks it"
        )
    held = np.asarray(np.linalg.solve(rest, residual[:, :, None])[:, :, 0], dtype=float)
    beyond = _left_out(kind, u, a, cov @ aw.transpose(1, 0, 2).reshape(len(p), -1), misfit, spread)
    transform = PlanarTransform(kind, centre, length, origin, p, cov, float(np.sqrt(misfit)), np.zeros((0, 2)), *beyond)
    pulled = np.einsum("ni,nij,nj->n", residual, weight, residual)
    evidence = np.einsum("ni,nij,nj->n", residual, weight, held)
    return PlanarFit(transform, residual, held, float(len(p)), evidence, float(pulled.sum()))


def _left_out(
    kind: str, u: Array, a: Array, solve: Array, misfit: float, spread: Array
) -> tuple[float, Array, float]:  # fmt: skip
    """1 sigma of a term of the next order, px; what such terms look like to the parameters (P, Q); the rest's largest.

    At the markers, less what the parameters take up (``solve`` (P, 2 N)), they have the misfit's size, and that of a
    fit of them to the noise: less is not seen. Beyond the markers they are what an extrapolation lacks.
    """
    terms = bases.next_terms(kind, u)
    hidden = solve @ terms.reshape(-1, terms.shape[2])
    rest = ((terms - a @ hidden) ** 2).sum(axis=(1, 2))
    square = float(rest.mean()) / 2
    noise = float(np.trace(spread, axis1=1, axis2=2).mean()) / 2 * terms.shape[2] / (2 * len(u))
    return float(np.sqrt((misfit + noise) / max(square, UNTOLD))), hidden, float(rest.max())


def _start(kind: str, u: Array, goal: Array) -> Array:
    """Unweighted fit; a projective one starts as an affine one."""
    linear = "affine" if kind == "projective" else kind
    a = bases.design(linear, u, np.zeros(0))
    p = np.linalg.lstsq(a.reshape(-1, a.shape[2]), goal.ravel(), rcond=None)[0]
    return np.concatenate([p, np.zeros(2 if kind == "projective" else 0)])


def _solve(kind: str, normal: Array, right: Array) -> tuple[Array, Array]:
    """Step and covariance from normal equations, columns scaled to one."""
    size = np.sqrt(np.maximum(np.diagonal(normal), 1e-300))
    scaled = normal / np.outer(size, size)
    if np.linalg.eigvalsh(scaled)[0] < 1e-9:
        raise DegenerateGeometry(f"{kind} is not determined: the markers lie on a line or a conic, or in few places")
    inverse = np.asarray(np.linalg.inv(scaled) / np.outer(size, size), dtype=float)
    return np.asarray(inverse @ right, dtype=float), inverse


def _misfit(residual: Array, spread: Array, free: int) -> float:
    """Variance (px^2) to add to every pair so that the weighted sum of squares is its expectation; 0 if it is less."""

    def excess(variance: float) -> float:
        weight = np.linalg.inv(spread + variance * np.eye(2))
        return float(np.einsum("ni,nij,nj->", residual, weight, residual)) - free

    low, high = 0.0, float((residual**2).sum() / max(free, 1))
    if excess(0.0) <= 0 or high <= 0:
        return 0.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) > 0 else (low, middle)
        if high - low < 1e-6 * high:
            break
    return high


def _covariances(cov: ArrayLike | None, count: int) -> Array:
    if cov is None:
        return np.broadcast_to(UNKNOWN_PX**2 * np.eye(2), (count, 2, 2))
    got = np.array(cov, dtype=float)
    if got.shape != (count, 2, 2):
        raise ValueError(f"fit_planar: covariances must be ({count}, 2, 2), got {got.shape}")
    got[~np.isfinite(got).all(axis=(1, 2))] = UNKNOWN_PX**2 * np.eye(2)
    return got


def _check_spread(kind: str, u: Array, length: float) -> None:
    size = np.linalg.svd(u - u.mean(axis=0), compute_uv=False) / np.sqrt(len(u))
    if kind != "similarity" and size[1] < FLAT * size[0]:
        raise DegenerateGeometry(
            f"{kind} is not determined: the markers lie within {g2(size[1] * length)} px (1 sigma) of a line, "
            f"{size[0] * length:.0f} px long; markers off that line are needed"
        )
