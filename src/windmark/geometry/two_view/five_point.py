"""Essential matrices of five pairs: up to ten, for many minimal sets at once.

The four-dimensional null space of the five linear equations is searched for the matrices that fulfil the ten cubic
constraints (determinant and trace). Solved by the eigenvectors of the 10 x 10 action matrix and polished by Newton
steps. Sources: Nister, An efficient solution to the five-point relative pose problem, PAMI 2004 (constraints);
Stewenius, Engels and Nister, Recent developments on direct relative orientation, ISPRS J. 2006 (action matrix).
"""

from __future__ import annotations

from itertools import combinations_with_replacement, product

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# Monomials in w = (x, y, z, 1) as sorted triples of indices: ten of degree three first, then ten of lower degree.
_LOWER: list[tuple[int, ...]] = [(*two, 3) for two in combinations_with_replacement(range(3), 2)]
_LOWER += [(k, 3, 3) for k in range(4)]
_MONOMIALS = [*combinations_with_replacement(range(3), 3), *_LOWER]
_PLACE = {m: place for place, m in enumerate(_MONOMIALS)}
_GATHER = np.zeros((64, 20))  # sums the 64 products of three factors into the 20 monomials
_GATHER[range(64), [_PLACE[tuple(sorted(m))] for m in product(range(4), repeat=3)]] = 1.0
_TIMES_X = np.array([_PLACE[tuple(sorted((0, *m[:2])))] for m in _LOWER])  # where x times a lower monomial is found
_TRIPLES = np.array(_MONOMIALS)
_NEWTON_STEPS = 2
_REAL = 1e-6  # imaginary part, of the size of the solution, up to which a (nearly double) root counts as real
_RESIDUAL = 1e-9  # of the constraints, for matrices of norm 1: what is above is no solution


def essential_five_point(rays_a: ArrayLike, rays_b: ArrayLike) -> Array:
    """All essential matrices with ``rays_b^T E rays_a = 0`` for five pairs, for one set or for a batch (...).

    Works for points on a plane too (the true one is among the solutions); for pure rotations every direction of the
    baseline fits, and an arbitrary one comes out.

    Parameters
    ----------
    rays_a, rays_b : (..., 5, 3) directions in the camera frames, of any length, or (..., 5, 2) with z = 1 left out

    Returns
    -------
    (..., 10, 3, 3) : singular values 1, 1, 0; NaN where there are fewer than ten solutions

    Raises
    ------
    ValueError
        Shapes that do not fit.
    """
    a, b = _rays("rays_a", rays_a), _rays("rays_b", rays_b)
    if a.shape != b.shape:
        raise ValueError(f"essential_five_point: rays_a and rays_b must have one shape, got {a.shape} and {b.shape}")
    shape = a.shape[:-2]
    a, b = a.reshape(-1, 5, 3), b.reshape(-1, 5, 3)
    finite = np.asarray(np.isfinite(a).all(axis=(1, 2)) & np.isfinite(b).all(axis=(1, 2)))
    design = (b[..., :, None] * a[..., None, :]).reshape(-1, 5, 9)
    design[~finite] = 0.0
    basis = np.linalg.svd(design)[2][:, 5:].reshape(-1, 4, 3, 3)
    constraints = _constraints(basis)
    w, real = _solve(constraints)
    found = np.full((len(a), 10, 3, 3), np.nan)
    which, place = np.nonzero(real & finite[:, None])
    weights, residual = _polish(constraints[which], w[which, place])
    good = residual < _RESIDUAL
    which, place, weights = which[good], place[good], weights[good]
    found[which, place] = np.sqrt(2) * np.einsum("sk,skij->sij", weights, basis[which])
    return found.reshape(*shape, 10, 3, 3)


def _rays(name: str, rays: ArrayLike) -> Array:
    r = np.asarray(rays, dtype=float)
    if r.ndim < 2 or r.shape[-2] != 5 or r.shape[-1] not in (2, 3):
        raise ValueError(f"essential_five_point: {name} must be (..., 5, 3) or (..., 5, 2), got {r.shape}")
    if r.shape[-1] == 2:
        return np.concatenate([r, np.ones((*r.shape[:-1], 1))], axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(r / np.linalg.norm(r, axis=-1, keepdims=True))


def _constraints(basis: Array) -> Array:
    """Coefficients (B, 10, 20) of ``2 E E^T E - tr(E E^T) E = 0`` and ``det E = 0``, E = w0 E0 + ... + w3 E3."""
    product_ab = np.einsum("naij,nbkj->nabik", basis, basis)
    trace = np.einsum("nabii->nab", product_ab)
    cubic = 2 * np.einsum("nabik,nckj->nabcij", product_ab, basis) - np.einsum("nab,ncij->nabcij", trace, basis)
    normal = np.cross(basis[:, :, None, 1], basis[:, None, :, 2])  # rows two and three of any two of the four
    det = np.einsum("nak,nbck->nabc", basis[:, :, 0], normal)
    every = np.concatenate([cubic.reshape(-1, 64, 9), det.reshape(-1, 64, 1)], axis=2)
    return np.asarray(np.swapaxes(every, 1, 2) @ _GATHER)


def _solve(constraints: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Solutions w (B, 10, 4) with w3 = 1, and which of them are real."""
    lead = constraints[:, :, :10]
    solvable = np.abs(np.linalg.det(lead)) > 0
    lead = np.where(solvable[:, None, None], lead, np.eye(10))
    reduced = -np.linalg.solve(lead, constraints[:, :, 10:])
    action = np.concatenate([reduced, np.broadcast_to(np.eye(10), reduced.shape)], axis=1)[:, _TIMES_X]
    values, vectors = np.linalg.eig(action)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        w = np.swapaxes(vectors[:, 6:] / vectors[:, 9:], 1, 2)
        real = (np.abs(values.imag) <= _REAL * (1 + np.abs(values))) & np.isfinite(w).all(axis=2)
    return np.where(real[..., None], w.real, [0.0, 0.0, 0.0, 1.0]), real & solvable[:, None]


def _polish(constraints: Array, w: Array) -> tuple[Array, Array]:
    """Gauss-Newton on the ten constraints (S, 10, 20) of each w (S, 4): w of length 1 and their remaining size."""
    for _ in range(_NEWTON_STEPS):
        values = w[:, _TRIPLES]  # (S, 20, 3)
        others = np.stack(
            [values[..., 1] * values[..., 2], values[..., 0] * values[..., 2], values[..., 0] * values[..., 1]], -1
        )
        slope = np.stack([(others * (k == _TRIPLES)).sum(axis=-1) for k in range(3)], axis=-1)
        jacobian = constraints @ slope
        residual = constraints @ values.prod(axis=-1)[..., None]
        jt = np.swapaxes(jacobian, -1, -2)
        normal = jt @ jacobian
        size = np.einsum("sii->s", normal)
        normal += (1e-15 * size + 1e-300)[..., None, None] * np.eye(3)  # a double root has no Newton step
        step = np.linalg.solve(normal, jt @ residual)[..., 0]
        w = np.concatenate([w[..., :3] - step, w[..., 3:]], axis=-1)
    w = w / np.linalg.norm(w, axis=-1, keepdims=True)  # the basis is orthonormal: so E has norm 1
    residual = constraints @ w[:, _TRIPLES].prod(axis=-1)[..., None]
    return w, np.asarray(np.abs(residual[..., 0]).max(axis=-1))
