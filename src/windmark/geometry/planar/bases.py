"""What each kind of transformation says of a place, and how that changes with its parameters and with the place.

Places ``u`` (N, 2) are in normalised coordinates (zero mean, unit spread), so that the powers of a polynomial are of
one size. A similarity has the parameters (a, b, x, y): (a u - b v + x, b u + a v + y).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ORDER = {"affine": 1, "poly2": 2, "poly3": 3}
"""Kinds that are polynomials, one for each coordinate."""
PARAMETERS = {"similarity": 4, "affine": 6, "projective": 8, "poly2": 12, "poly3": 20}


def exponents(order: int) -> list[tuple[int, int]]:
    """Powers of u and v of the monomials up to an order: 1, u, v, u^2, u v, v^2, ..."""
    return [(total - j, j) for total in range(order + 1) for j in range(total + 1)]


def monomials(order: int, u: Array) -> Array:
    """(N, M) values of the monomials."""
    return np.stack([u[:, 0] ** i * u[:, 1] ** j for i, j in exponents(order)], axis=1)


def evaluate(kind: str, u: Array, p: Array) -> Array:
    """(N, 2) places that parameters ``p`` give."""
    if kind == "projective":
        low = 1 + u @ p[6:]
        return (p[:6].reshape(2, 3) @ np.column_stack([np.ones(len(u)), u]).T).T / low[:, None]
    return np.einsum("nkp,p->nk", design(kind, u, p), p)


def design(kind: str, u: Array, p: Array) -> Array:
    """(N, 2, P) derivatives of the places with respect to the parameters."""
    one, zero = np.ones(len(u)), np.zeros(len(u))
    if kind == "similarity":
        x = np.stack([u[:, 0], -u[:, 1], one, zero], axis=1)
        y = np.stack([u[:, 1], u[:, 0], zero, one], axis=1)
        return np.stack([x, y], axis=1)
    if kind == "projective":
        low = 1 + u @ p[6:]
        place = evaluate(kind, u, p)
        out = np.zeros((len(u), 2, 8))
        out[:, 0, :3] = out[:, 1, 3:6] = np.column_stack([one, u]) / low[:, None]
        out[:, :, 6:] = -place[:, :, None] * u[:, None, :] / low[:, None, None]
        return out
    return _of_both(monomials(ORDER[kind], u))


def slope(kind: str, u: Array, p: Array) -> Array:
    """(N, 2, 2) derivatives of the places with respect to u and v."""
    if kind == "similarity":
        return np.broadcast_to(np.array([[p[0], -p[1]], [p[1], p[0]]]), (len(u), 2, 2))
    if kind == "projective":
        low = 1 + u @ p[6:]
        return (p[:6].reshape(2, 3)[:, 1:] - evaluate(kind, u, p)[:, :, None] * p[6:]) / low[:, None, None]
    powers = exponents(ORDER[kind])
    coefficients = p.reshape(2, -1)
    out = np.zeros((len(u), 2, 2))
    for m, (i, j) in enumerate(powers):
        by_u = i * u[:, 0] ** max(i - 1, 0) * u[:, 1] ** j
        by_v = j * u[:, 0] ** i * u[:, 1] ** max(j - 1, 0)
        out += coefficients[:, m][None, :, None] * np.stack([by_u, by_v], axis=1)[:, None, :]
    return out


def next_terms(kind: str, u: Array) -> Array:
    """(N, 2, Q) the terms of the next order that a kind lacks, one at a time, x's first."""
    order = ORDER.get(kind, 1)
    return _of_both(monomials(order + 1, u)[:, 1 if kind == "similarity" else len(exponents(order)) :])


def _of_both(powers: Array) -> Array:
    """(N, 2, 2 M) derivatives of both coordinates by factors of terms (N, M) of their own, x's first."""
    count = powers.shape[1]
    out = np.zeros((len(powers), 2, 2 * count))
    out[:, 0, :count] = out[:, 1, count:] = powers
    return out


def plate(u: Array, nodes: Array) -> Array:
    """(N, M) the thin plate's kernel r^2 ln r between places and nodes."""
    square = ((u[:, None, :] - nodes[None]) ** 2).sum(axis=2)
    return 0.5 * square * np.log(np.maximum(square, 1e-300))


def plate_slope(u: Array, nodes: Array) -> Array:
    """(N, M, 2) derivative of `plate` with respect to u: (2 ln r + 1) (u - node)."""
    off = u[:, None, :] - nodes[None]
    square = (off**2).sum(axis=2)
    return off * (np.log(np.maximum(square, 1e-300)) + 1)[:, :, None]
