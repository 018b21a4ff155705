"""What a deformation that the picture does not show would do to the pose, to first order, as a numba kernel."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._cholesky_kernels import cholesky, inverse_factor
from windmark.geometry._jit import nb
from windmark.registration.settle._kernels.slopes import slopes_kernel
from windmark.registration.settle._kernels.state import Mask, Sights, State

Array = NDArray[np.float64]

LEAST = 1e-14
"""Part of itself that an unknown must add to those before."""
SWEEPS = 30
"""Most rounds in which the widest direction is turned to; each squares what is left beside it."""


@nb.njit(cache=True, nogil=True, error_model="numpy")
def unseen_bend(
    sights: Sights, state: State, modes: Array, motions: Array, walls: Mask, size: float, reach: float, most: float
) -> tuple[float, float]:  # fmt: skip
    """Largest displacement of a matched marker beyond a rigid motion, and largest turn of a root against the pose.

    Parameters
    ----------
    modes : (N, 3, K) deformations, each with a prior of ``size``
    motions : (N, 3, K) turns in the model with which a root at each marker goes with them
    walls : (N,) markers that do not move; where any is matched the root is one of them, else it may be any that is
    reach : how many sigmas what stays open of the coefficients may be
    most : largest displacement beyond a rigid motion; the turn is one of a deformation that is no larger

    Returns
    -------
    Half a turn and the largest displacement where the pose is singular: then the picture tells nothing.
    """
    taken, open_, good = _left_open(slopes_kernel(sights, state, modes, size)[0], state.factor.shape[0])
    if not good:
        return most, math.pi
    rotation, bends, at, roots = state.rotation, modes.shape[2], 0, _roots(state.match, walls)
    own, row, gram, widest = np.zeros((3, bends)), np.empty(bends), np.zeros((3, 3)), -1.0
    for a in range(3):  # what the rigid fit takes up, in the model's own axes
        for b in range(3):
            for k in range(bends):
                own[a, k] += rotation[b, a] * taken[b, k]
    rows = np.empty((3 * roots.sum(), bends))
    for m in range(roots.shape[0]):
        if roots[m]:
            for a in range(3):
                for k in range(bends):
                    rows[at, k] = size * motions[m, a, k] - own[a, k]
                at += 1
    products, turned = rows @ open_, np.zeros((3, bends))
    for root in range(0, at, 3):
        total = 0.0
        for a in range(3):
            for k in range(bends):
                total += products[root + a, k] * products[root + a, k]
        if total > widest:
            widest = total
            turned[:] = products[root : root + 3]
    for a in range(3):
        for b in range(3):
            for k in range(bends):
                gram[a, b] += turned[a, k] * turned[b, k]
    way, sigma = _along(gram), 0.0
    for k in range(bends):
        row[k] = way[0] * turned[0, k] + way[1] * turned[1, k] + way[2] * turned[2, k]
        sigma += row[k] * row[k]
    sigma = math.sqrt(sigma)
    if not sigma > 0.0:
        return 0.0, 0.0
    for k in range(bends):
        row[k] /= sigma
    farthest, along = _farthest(sights.xyz, state.match, modes, size * reach, open_, row)
    return min(farthest, most), (most / along if along > most else 1.0) * reach * sigma


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _roots(match: NDArray[np.int32], walls: Mask) -> Mask:
    """(N,) matched markers that may be the root: walls if there are any."""
    matched, still = np.zeros(walls.shape[0], np.bool_), False
    for m in range(walls.shape[0]):
        for c in range(match.shape[0]):
            matched[m] = matched[m] or match[c, m] >= 0
        still = still or (walls[m] and matched[m])
    return matched & walls if still else matched


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _left_open(slopes: Array, rigid: int) -> tuple[Array, Array, bool]:
    """What the rigid fit takes (P, K) of the deformations, a root (K, K) of what stays open of their coefficients; and
    whether that is so.
    """  # fmt: skip
    normal = slopes.T @ slopes
    size = normal.shape[0]
    bends = size - rigid
    for i in range(6, size):
        normal[i, i] += 1.0
    taken, inverse = np.zeros((rigid, bends)), np.zeros((bends, bends))
    if not cholesky(normal, size, LEAST):
        return taken, inverse, False
    # The factor of all of them has the rigid one's, and that of what is left of the deformations beside it.
    for k in range(bends):
        for i in range(rigid - 1, -1, -1):
            total = normal[rigid + k, i]
            for j in range(i + 1, rigid):
                total -= normal[j, i] * taken[j, k]
            taken[i, k] = total / normal[i, i]
    inverse[:] = inverse_factor(np.ascontiguousarray(normal[rigid:, rigid:]), bends).T
    return taken, inverse, True


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _along(gram: Array) -> Array:
    """(3,) unit vector of the largest eigenvalue of a symmetric positive matrix: its square, squared, and so on."""
    power, other, way = gram.copy(), np.empty((3, 3)), np.zeros(3)
    for _ in range(SWEEPS):
        trace = power[0, 0] + power[1, 1] + power[2, 2]
        if not trace > 0.0:
            break
        for a in range(3):
            for b in range(3):
                other[a, b] = 0.0
                for k in range(3):
                    other[a, b] += power[a, k] * power[k, b] / (trace * trace)
        power[:] = other
    at = 0
    for a in range(1, 3):
        at = a if power[a, a] > power[at, at] else at
    length = math.sqrt(power[0, at] ** 2 + power[1, at] ** 2 + power[2, at] ** 2)
    for a in range(3):
        way[a] = power[a, at] / length if length > 0.0 else 0.0
    return way


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _farthest(
    xyz: Array, match: NDArray[np.int32], modes: Array, size: float, open_: Array, along: Array
) -> tuple[float, float]:  # fmt: skip
    """Largest displacement of a matched marker beyond a rigid motion of all of them: of any coefficients that are left
    open, and of those ``along`` (K,) one direction of theirs.
    """  # fmt: skip
    n, bends = xyz.shape[0], modes.shape[2]
    seen, count, centre = _roots(match, np.zeros(n, np.bool_)), 0, np.zeros(3)
    for m in range(n):
        if seen[m]:
            count += 1
            centre += xyz[m]
    centre /= max(count, 1)
    basis, rows, at = _motions(xyz, seen, count, centre), np.empty((3 * count, bends)), 0
    for m in range(n):
        if seen[m]:
            rows[at : at + 3] = modes[m]
            at += 3
    rows -= basis.T @ (basis @ rows)
    products, far2, along2 = rows @ open_, 0.0, 0.0
    for first in range(0, at, 3):
        any2, own2 = 0.0, 0.0
        for axis in range(3):
            own = 0.0
            for k in range(bends):
                any2 += products[first + axis, k] * products[first + axis, k]
                own += products[first + axis, k] * along[k]
            own2 += own * own
        far2, along2 = max(far2, any2), max(along2, own2)
    return size * math.sqrt(far2), size * math.sqrt(along2)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _motions(xyz: Array, seen: Mask, count: int, centre: Array) -> Array:
    """(6, 3 M) orthonormal motions of the markers that are seen in which all move as one; zero for what is none."""
    basis, at = np.zeros((6, 3 * count)), 0
    for m in range(xyz.shape[0]):
        if seen[m]:
            x, y, z = xyz[m, 0] - centre[0], xyz[m, 1] - centre[1], xyz[m, 2] - centre[2]
            basis[3, at], basis[4, at + 1], basis[5, at + 2] = 1.0, 1.0, 1.0
            basis[0, at + 1], basis[0, at + 2], basis[1, at], basis[1, at + 2] = -z, y, z, -x
            basis[2, at], basis[2, at + 1] = -y, x
            at += 3
    for b in range(6):
        before = math.sqrt((basis[b] * basis[b]).sum())
        for _ in range(2):  # once more for what rounding left
            for other in range(b):
                part = (basis[b] * basis[other]).sum()
                basis[b] -= part * basis[other]
        length = math.sqrt((basis[b] * basis[b]).sum())
        # A line has no motion about itself.
        basis[b] *= 1.0 / length if length > 1e-9 * before else 0.0
    return basis
