"""Fundamental matrices by linear algebra: the normalised eight-point and the seven-point method.

Sources: Hartley, In defense of the eight-point algorithm, PAMI 1997; Hartley and Zisserman, Multiple View Geometry
(2nd ed.), algorithm 11.1 and section 11.1.2.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.geometry.errors import DegenerateGeometry

Array = NDArray[np.float64]

_FLAT = 1e-7  # ratio of singular values of the design matrix below which F is not determined


def fundamental_eight_point(xy_a: ArrayLike, xy_b: ArrayLike) -> Array:
    """Fundamental matrix of N >= 8 pairs, least squares on normalised points, rank two enforced; norm 1.

    Parameters
    ----------
    xy_a, xy_b : (N, 2) ideal pixels (or normalised coordinates) of the same points

    Raises
    ------
    ValueError
        Shapes that do not fit, values that are not finite, fewer than eight pairs.
    DegenerateGeometry
        Several F fit: the points lie on a plane, on a line or on another critical surface through both stations, or
        the cameras are at one place. The test is against rounding; with noise, `estimate_two_view` names such cases.
    """
    a, b = _points("fundamental_eight_point", xy_a, xy_b)
    if a.ndim != 2 or len(a) < 8:
        raise ValueError(f"fundamental_eight_point: at least eight pairs (N, 2) are needed, got {a.shape}")
    t_a, p = _normalised(a)
    t_b, q = _normalised(b)
    _, s, vt = np.linalg.svd(_design(p, q), full_matrices=False) if len(a) > 8 else np.linalg.svd(_design(p, q))
    if not s[7] > _FLAT * s[0]:
        raise DegenerateGeometry("fundamental_eight_point: several F fit (plane, line or no baseline)", ("F",))
    u, w, vt = np.linalg.svd(vt[8].reshape(3, 3))
    f = t_b.T @ (u[:, :2] * w[:2] @ vt[:2]) @ t_a
    return np.asarray(f / np.linalg.norm(f))


def fundamental_seven_point(xy_a: ArrayLike, xy_b: ArrayLike) -> Array:
    """The one or three fundamental matrices of seven pairs, for one set or for a batch (...).

    Parameters
    ----------
    xy_a, xy_b : (..., 7, 2) ideal pixels (or normalised coordinates)

    Returns
    -------
    (..., 3, 3, 3) : up to three matrices of norm 1, NaN where there are fewer; also where the pairs are degenerate
    """
    a, b = _points("fundamental_seven_point", xy_a, xy_b)
    if a.shape[-2] != 7:
        raise ValueError(f"fundamental_seven_point: seven pairs (..., 7, 2) are needed, got {a.shape}")
    shape = a.shape[:-2]
    a, b = a.reshape(-1, 7, 2), b.reshape(-1, 7, 2)
    t_a, p = _normalised(a)
    t_b, q = _normalised(b)
    _, s, vt = np.linalg.svd(_design(p, q))
    f1, f2 = vt[:, 7].reshape(-1, 3, 3), vt[:, 8].reshape(-1, 3, 3)
    # det(f1 + x f2) by its values at four places, a cubic in x; the larger of both ends leads.
    swap = (np.abs(np.linalg.det(f1)) > np.abs(np.linalg.det(f2)))[:, None, None]
    f1, f2 = np.where(swap, f2, f1), np.where(swap, f1, f2)
    c0, c3, plus, minus = (np.linalg.det(m) for m in (f1, f2, f1 + f2, f1 - f2))
    c2, c1 = (plus + minus) / 2 - c0, (plus - minus) / 2 - c3
    x = _real_cubic_roots(c0, c1, c2, c3)
    x[~(s[:, 6] > _FLAT * s[:, 0])] = np.nan
    f = np.swapaxes(t_b, -1, -2)[:, None] @ (f1[:, None] + x[..., None, None] * f2[:, None]) @ t_a[:, None]
    f = f / np.linalg.norm(f, axis=(-2, -1), keepdims=True)
    return np.asarray(f.reshape(*shape, 3, 3, 3))


def _real_cubic_roots(c0: Array, c1: Array, c2: Array, c3: Array) -> Array:
    """Real roots (B, 3) of c3 x^3 + c2 x^2 + c1 x + c0, NaN for complex ones; c3 = 0 has none."""
    companion = np.zeros((len(c0), 3, 3))
    with np.errstate(divide="ignore", invalid="ignore"):
        last = -np.stack([c0, c1, c2], axis=-1) / c3[:, None]
    solvable = np.asarray(np.isfinite(last).all(axis=1))
    companion[:, :, 2] = np.where(solvable[:, None], last, 0.0)
    companion[:, 1, 0] = companion[:, 2, 1] = 1.0
    roots = np.linalg.eigvals(companion)
    real = np.asarray(np.abs(roots.imag) <= 1e-9 * (1 + np.abs(roots.real))) & solvable[:, None]
    return np.where(real, roots.real, np.nan)


def _points(name: str, xy_a: ArrayLike, xy_b: ArrayLike) -> tuple[Array, Array]:
    a, b = np.asarray(xy_a, dtype=float), np.asarray(xy_b, dtype=float)
    if a.ndim < 2 or a.shape[-1] != 2 or a.shape != b.shape:
        raise ValueError(f"{name}: xy_a and xy_b must both be (..., N, 2), got {a.shape} and {b.shape}")
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        raise ValueError(f"{name}: xy_a and xy_b must be finite")
    return a, b


def _normalised(p: Array) -> tuple[Array, Array]:
    """Hartley's normalisation: the (..., 3, 3) transformation and the points with mean 0 and RMS length sqrt(2)."""
    middle = p.mean(axis=-2, keepdims=True)
    size = np.sqrt(((p - middle) ** 2).sum(axis=-1).mean(axis=-1) / 2)
    size = np.where(size > 0, size, 1.0)
    t = np.zeros((*p.shape[:-2], 3, 3))
    t[..., 0, 0] = t[..., 1, 1] = 1 / size
    t[..., :2, 2] = -middle[..., 0, :] / size[..., None]
    t[..., 2, 2] = 1.0
    return t, (p - middle) / size[..., None, None]


def _design(a: Array, b: Array) -> Array:
    """Rows (..., N, 9) with ``row @ F.ravel() = x_b^T F x_a``."""
    one = np.ones((*a.shape[:-1], 1))
    h_a, h_b = np.concatenate([a, one], axis=-1), np.concatenate([b, one], axis=-1)
    return np.asarray((h_b[..., :, None] * h_a[..., None, :]).reshape(*a.shape[:-1], 9))
