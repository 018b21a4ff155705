"""Fits of a fundamental matrix by its seven parameters, and their covariance: see `fundamental` for the sources."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from windmark.geometry.errors import DegenerateGeometry
from windmark.geometry.rotations import exp_so3
from windmark.geometry.two_view.distances import sampson_distance
from windmark.geometry.two_view.linear import fundamental_eight_point, fundamental_seven_point

Array = NDArray[np.float64]

Slope = Callable[[Callable[[Array], Array]], Array]

PARAMETERS = 7
STEP = 1e-6
"""Of differences by the parameters, which are of size one."""


def fits(a: Array, b: Array, sigma: float, *more: Array) -> list[tuple[Array, float]]:
    """F and its cost in sigma^2 from linear starts and some more, the best first; none where there is no start."""
    starts = list(more)
    with suppress(DegenerateGeometry, ValueError):
        starts.append(fundamental_eight_point(a, b))
    spread = np.unique(np.linspace(0, len(a) - 1, PARAMETERS).round().astype(int))
    if len(spread) == PARAMETERS:
        starts += [f for f in fundamental_seven_point(a[spread], b[spread]) if np.isfinite(f).all()]
    found = [_minimise(start, a, b, sigma) for start in starts]
    return sorted((f for f in found if np.isfinite(f[1])), key=lambda f: f[1])


def _minimise(start: Array, a: Array, b: Array, sigma: float) -> tuple[Array, float]:
    """Levenberg-Marquardt over the seven parameters, in coordinates of unit size."""
    moved = _moved(start, a, b)
    from scipy.optimize import least_squares

    done = least_squares(lambda p: sampson_distance(moved(p), a, b) / sigma, np.zeros(PARAMETERS), method="lm"
                         if len(a) >= PARAMETERS else "trf", max_nfev=200)  # fmt: skip
    return moved(done.x), float(2 * done.cost)


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


def _moved(matrix: Array, a: Array, b: Array) -> Callable[[Array], Array]:
    """F, of norm 1 and with the sign of ``matrix``, as a function of changes (7,) of its parameters."""
    scale = _scaled(a, b)
    u, s, v = _factors(np.linalg.inv(scale[1]).T @ matrix @ np.linalg.inv(scale[0]))

    def raw(p: Array) -> Array:
        f = scale[1].T @ (u @ exp_so3(p[:3])) @ np.diag([1.0, s + p[6], 0.0]) @ (v @ exp_so3(p[3:6])).T @ scale[0]
        return np.asarray(f / np.linalg.norm(f))

    sign = 1.0 if (raw(np.zeros(PARAMETERS)) * matrix).sum() > 0 else -1.0
    return lambda p: sign * raw(p)


def spread_of(matrix: Array, a: Array, b: Array, sigma: float) -> tuple[Array, Slope]:
    """Covariance (7, 7) of the parameters, and the derivative (..., 7) by them of any function of F."""
    moved = _moved(matrix, a, b)
    steps = STEP * np.eye(PARAMETERS)

    def slope(of: Callable[[Array], Array]) -> Array:
        return np.stack([(of(moved(h)) - of(moved(-h))) / (2 * STEP) for h in steps], axis=-1)

    rows = slope(lambda f: sampson_distance(f, a, b)) / sigma
    return np.asarray(np.linalg.pinv(rows.T @ rows, rcond=1e-14), dtype=np.float64), slope
