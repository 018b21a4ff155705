"""What else than the pose the residuals speak for, to first order: other cameras, a bent model."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._cholesky_kernels import cholesky, forward
from windmark.geometry._jit import nb
from windmark.registration.settle._kernels.project import place_cameras, room_for, see
from windmark.registration.settle._kernels.slopes import slopes_kernel
from windmark.registration.settle._kernels.state import ROWS, Mask, Sights, State, wider, with_more
from windmark.registration.settle._kernels.unseen import unseen_bend

Array = NDArray[np.float64]

DOUBTED_FOCAL, DOUBTED_ASPECT, DOUBTED_CENTRE, DOUBTED_EDGE = 0.15, 0.02, 0.04, 0.02
"""1 sigma of a given camera that is doubted: of the logarithm of its focal length, of its aspect, of its principal
point as part of the image's diagonal, and of the lens' shift of the corner as part of its distance from the centre."""
DOUBTS = ("focal length", "aspect", "principal point", "principal point", "lens")
"""What the columns of `doubted_kernel` are."""
COLUMNS, FIRST_OF, LAST_OF = 5, np.array([0, 1, 2, 4]), np.array([1, 2, 4, 5])
"""The number of these, and which are of each thing that may be wrong."""


@nb.njit(cache=True, nogil=True, error_model="numpy")
def look_kernel(
    sights: Sights, state: State, modes: Array, bows: Array, turns: Array, walls: Mask, size: float, reach: float,
    most: float,
) -> tuple[float, float, float, float, Array]:  # fmt: skip
    """What else the residuals of a settled state speak for, and what they do not show; all to first order.

    Parameters
    ----------
    modes : (N, 3, K) deformations that the model may have, each with a prior of ``size``; 0: it is rigid
    bows, turns, walls, reach, most : see `unseen.unseen_bend`

    Returns
    -------
    What bending gains (nats), and another camera, in one thing or in all; the largest bow that does not show, and how
    far the root is turned by it; and (C, 5) what the spots tell of the camera's doubted columns (`DOUBTS`), each alone.
    """
    bending, bow, turn = -math.inf, 0.0, 0.0
    if size > 0.0 and modes.shape[2] > 0:
        bending = _bending(sights, state, modes, size)
    if size > 0.0 and bows.shape[2] > 0:
        bow, turn = unseen_bend(sights, state, bows, turns, walls, size, reach, most)
    camera, told = _cameras(sights, state)
    return bending, camera, bow, turn, told


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _bending(sights: Sights, state: State, modes: Array, size: float) -> float:
    """What a deformation gains (nats)."""
    slopes, off = slopes_kernel(sights, state, modes, size)
    rigid = state.factor.shape[0]
    asked = np.empty(slopes.shape[1] - rigid, np.int64)
    for k in range(asked.shape[0]):
        asked[k] = rigid + k
    normal, side = reduce_kernel(slopes.T @ slopes, slopes.T @ off, asked)
    return gain_kernel(normal, side, 0, side.shape[0])


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _cameras(sights: Sights, state: State) -> tuple[float, Array]:
    """What other cameras gain at most (nats), and (C, 5) what the spots tell of each column."""
    cameras, own, every = sights.camera.shape[0], sights.loose.shape[2], COLUMNS
    loose, asked = np.zeros((cameras, ROWS, own + every)), np.empty(cameras * every, np.int64)
    for c in range(cameras):
        loose[c, :, :own], loose[c, :, own:] = sights.loose[c], doubted_kernel(sights.camera[c], sights.size[c])
        for k in range(every):
            asked[c * every + k] = 6 + c * (own + every) + own + k
    doubted = with_more(sights, loose, sights.modes)
    normal, side = doubt_kernel(doubted, wider(doubted, state))
    normal, side = reduce_kernel(normal, side, asked)
    gain, told = gain_kernel(normal, side, 0, asked.shape[0]), np.empty((cameras, every))
    for c in range(cameras):
        for part in range(FIRST_OF.shape[0]):
            first, last = c * every + FIRST_OF[part], c * every + LAST_OF[part]
            gain = max(gain, gain_kernel(normal, side, first, last))
        for k in range(every):
            told[c, k] = max(normal[c * every + k, c * every + k], 0.0)
    return gain, told


@nb.njit(cache=True, nogil=True, error_model="numpy")
def doubted_kernel(camera: Array, size: Array) -> Array:
    """(22, 5) how a packed camera of an image's size (2,) may be wrong, see `DOUBTS` and `Sights.loose`."""
    columns, diagonal = np.zeros((ROWS, COLUMNS)), math.hypot(size[0], size[1])
    columns[0, 0], columns[1, 1] = DOUBTED_FOCAL, DOUBTED_ASPECT
    columns[2, 2] = columns[3, 3] = DOUBTED_CENTRE * diagonal
    columns[4, 4] = DOUBTED_EDGE / (0.5 * diagonal / camera[0]) ** 2
    return columns


@nb.njit(cache=True, nogil=True, error_model="numpy")
def doubt_kernel(sights: Sights, state: State) -> tuple[Array, Array]:
    """Normal equations of all unknowns at a state that is settled without some of them: J'WJ and J'W(seen - projected).

    Without the priors. The residuals' covariance is the state's own (`State.spread`).
    """
    size, (cameras, n) = state.factor.shape[0], state.match.shape
    a, g, (xy, by) = np.zeros((size, size)), np.zeros(size), room_for(state)
    place_cameras(sights, state)
    for c in range(cameras):
        match, spread, residual = state.match[c], state.spread[c], state.residual[c]
        see(sights, state, c, match >= 0, xy, by)
        for m in range(n):
            if math.isnan(xy[m, 0]):
                continue
            xx, xy_, yy = spread[m, 0], spread[m, 1], spread[m, 2]
            k2 = 1.0 / (xx * yy - xy_ * xy_)
            du, dv = -residual[m, 0], -residual[m, 1]
            for i in range(size):
                u, v = by[m, 0, i], by[m, 1, i]
                cu, cv = k2 * (yy * u - xy_ * v), k2 * (xx * v - xy_ * u)
                g[i] += cu * du + cv * dv
                for j in range(i + 1):
                    a[i, j] += cu * by[m, 0, j] + cv * by[m, 1, j]
    for i in range(size):
        for j in range(i):
            a[j, i] = a[i, j]
    return a, g


@nb.njit(cache=True, nogil=True, error_model="numpy")
def reduce_kernel(normal: Array, side: Array, asked: NDArray[np.int64]) -> tuple[Array, Array]:
    """Normal equations (M, M), (M,) of the unknowns that are ``asked`` about, all others eliminated; zero where these
    are singular. Others but the pose (the first six) have a unit normal prior.
    """  # fmt: skip
    size, count = side.shape[0], asked.shape[0]
    rest = np.empty(size - count, np.int64)
    is_asked, k = np.zeros(size, np.bool_), 0
    for i in asked:
        is_asked[i] = True
    for i in range(size):
        if not is_asked[i]:
            rest[k] = i
            k += 1
    own, out, pull = np.empty((k, k)), np.zeros((count, count)), np.zeros(count)
    for i in range(k):
        for j in range(i + 1):
            own[i, j] = normal[rest[i], rest[j]]
        if rest[i] >= 6:
            own[i, i] += 1.0
    if not cholesky(own, k, 1e-14):
        return out, pull
    across, towards = np.empty((count, k)), np.empty(k)
    for i in range(k):
        towards[i] = side[rest[i]]
        for j in range(count):
            across[j, i] = normal[rest[i], asked[j]]
    forward(own, towards, k)
    for j in range(count):
        forward(own, across[j], k)
    for i in range(count):
        pull[i] = side[asked[i]]
        for r in range(k):
            pull[i] -= across[i, r] * towards[r]
        for j in range(i + 1):
            out[i, j] = normal[asked[i], asked[j]]
            for r in range(k):
                out[i, j] -= across[i, r] * across[j, r]
            out[j, i] = out[i, j]
    return out, pull


@nb.njit(cache=True, nogil=True, error_model="numpy")
def gain_kernel(normal: Array, side: Array, first: int, last: int) -> float:
    """What unknowns ``first`` to ``last`` of `reduce_kernel`'s gain (nats) if they are free under their priors."""
    size = last - first
    own, pull, total = np.empty((size, size)), side[first:last].copy(), 0.0
    for i in range(size):
        for j in range(i + 1):
            own[i, j] = normal[first + i, first + j]
        own[i, i] = 1.0 + max(own[i, i], 0.0)
    if not cholesky(own, size, 1e-14):
        return -math.inf
    forward(own, pull, size)
    for i in range(size):
        total += 0.5 * pull[i] ** 2 - math.log(own[i, i])
    return total
