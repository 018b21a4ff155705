"""Markers that touch are fitted together: each with its neighbours' discs taken away from its window, until all stay.

Where the blurred rims of two discs overlap neither window is one disc's: to leave out the pixels of the nearer one cuts
the rim that is to be found, and what is left of the other pulls. Paint that does not overlap takes light away
independently, I = L (1 - c_1 H_1 - c_2 H_2), so that a neighbour's share can be subtracted. Fits of one disc at a time
to what the others leave, repeated, end where the fit of all at once has its minimum (block coordinate descent); the
covariance is that of the fit of all at once: the neighbours' unknowns are among its own,
C_1 = (A_11 - A_12 A_22^-1 A_21)^-1 with the blocks A of the normal matrix.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.detection.template.fit import Fitted, refit
from windmark.detection.template.request import Neighbours, Request, Scene

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

SWEEPS = 12  # at most: the rims that overlap are narrow, and each sweep leaves a small part of the error
STILL = 1e-3  # px that no centre moves by: all stay
MOVED = 0.5  # radii by which the neighbours' light may move a centre


def fit_touching(scene: Scene, request: Request, done: Fitted, others: Neighbours) -> Ints:
    """Fit again, in `done`, the markers whose rims overlap; which they are (L,). Others are not converged with them.

    A marker that does not converge so, whose neighbour does not, or that cannot be told from it, keeps its first fit.
    """
    joint = _overlapping(request, done, others)
    index = np.flatnonzero((joint >= 0).any(axis=1))
    if not index.size:
        return index
    first = done.take(index)
    left_out = replace(others, index=np.where(joint >= 0, -1, others.index)).take(index)
    stay = _swept(scene, request, done, index, joint[index], left_out)
    cov = np.full((len(index), 10, 10), np.nan)
    for k in np.flatnonzero(stay):
        cov[k] = _with_neighbours(scene, request, done, index[k], joint[index[k]][joint[index[k]] >= 0])
    stay &= np.isfinite(cov).all(axis=(1, 2))
    done.put(index[~stay], first.take(~stay))
    done.cov[index[stay]] = cov[stay]
    return index[stay]


def _swept(scene: Scene, request: Request, done: Fitted, index: Ints, joint: Ints, left_out: Neighbours) -> Bools:
    """Fit each of ``index`` (L,) to what its neighbours ``joint`` (L, N) leave, in `done`, until all stay; which do.

    What has settled is fitted again only where a neighbour has moved, and what is lost, or has a neighbour that is, no
    more at all: most candidates that touch others are no discs.
    """
    from windmark.detection.template._kernels.touching import take_away

    part, first = request.take(index), done.params[index, :2].copy()
    place = np.full(len(done.params), -1)
    place[index] = np.arange(len(index))
    beside = np.where(joint >= 0, place[joint], -1)
    good: Bools = np.ones(len(index), dtype=bool)
    moved: Bools = good.copy()
    for _ in range(SWEEPS):
        good &= np.where(beside >= 0, good[beside], True).all(axis=1)
        asked = np.flatnonzero(good & (moved | np.where(beside >= 0, moved[beside], False).any(axis=1)))
        if not asked.size:
            break

        def without_neighbours(k: Ints, patches: Array, weights: Array, asked: Ints = asked) -> None:
            which, column = np.nonzero(joint[asked[k]] >= 0)
            mine = asked[k][which]
            seen = seen_from(scene, done, joint[mine, column], index[mine])
            take_away(patches, weights, which, seen, float(scene.multiplicative))

        before = done.params[index, :2].copy()
        done.put(index[asked], refit(scene, part.take(asked), done.take(index[asked]), left_out.take(asked),
                                     without_neighbours))  # fmt: skip
        moved = np.asarray((np.abs(done.params[index, :2] - before) > STILL).any(axis=1))
        off = np.hypot(*(done.params[index, :2] - first).T)
        good &= (done.column("status")[index] == 1) & (off < MOVED * part.radius)
    return np.asarray(good & np.where(beside >= 0, good[beside], True).all(axis=1))


def _overlapping(request: Request, done: Fitted, others: Neighbours) -> Ints:
    """Of the neighbours (K, L) those whose blurred rim overlaps the marker's own and both of which are fitted; -1."""
    if not others.index.size:
        return others.index
    xy, (xx, yx, yy) = done.pixel + done.params[:, :2], done.params[:, 2:5].T
    i = np.arange(len(xy))[:, None]
    x, y = np.moveaxis(xy[others.index] - xy[i], -1, 0)
    away = np.hypot(x, y)
    # How far an ellipse reaches towards the other: |L e| with e the direction and L its half axes.
    reach = [np.hypot(xx[k] * x + yx[k] * y, yx[k] * x + yy[k] * y) for k in (others.index, i)]
    with np.errstate(divide="ignore", invalid="ignore"):
        gap = away - (reach[0] + reach[1]) / away
    fitted = (done.column("status") == 1) & np.isfinite(done.cov).all(axis=(1, 2))
    with np.errstate(invalid="ignore"):
        near = (others.index >= 0) & fitted[others.index] & fitted[i]
        near &= gap < others.margin[others.index] + others.margin[i]
    return np.where(near, others.index, -1)


def seen_from(scene: Scene, done: Fitted, n: Ints, m: Ints) -> Array:
    """Parameters (L, 10) of the markers n (L,) with regard to the middles of the patches of markers m (L,)."""
    p, away = done.params[n].copy(), (done.pixel[m] - done.pixel[n]).astype(float)
    p[:, :2] -= away
    along = (p[:, 8:] * away).sum(axis=1)
    if scene.multiplicative:  # the light, 1 in the middle of the own patch, is another one there
        light = np.maximum(1.0 + along, 0.05)[:, None]
        p[:, 6:8], p[:, 8:] = p[:, 6:8] * light, p[:, 8:] / light
    else:
        p[:, 7] += along
    return np.asarray(p)


def _with_neighbours(scene: Scene, request: Request, done: Fitted, m: int, neighbours: Ints) -> Array:
    """Covariance (10, 10) of a marker whose neighbours' discs are unknown too; NaN where both cannot be told apart."""
    from windmark.detection.template._kernels.touching import SHARED, shared_blocks

    half = int(np.ceil(request.take(np.array([m])).reach()[0] + 0.5))
    x, offset = np.arange(-half, half + 1), request.xy[m] - done.pixel[m]
    inside = (np.hypot(x[None, :] - offset[0], x[:, None] - offset[1]) <= request.reach()[m]).astype(float)
    variance, cov = done.column("noise2"), np.full((10, 10), np.nan)
    unit = np.sqrt(np.diagonal(done.cov[m]))
    free = np.flatnonzero(unit > 0.0)  # what is held is known
    unit = unit[free]
    alone = done.cov[m][np.ix_(free, free)] / np.outer(unit, unit)
    if not ((variance[[m, *neighbours]] > 0.0).all() and np.linalg.eigvalsh(alone)[0] > 0.0):
        return cov
    blocks = np.empty((len(neighbours), 10, SHARED))
    seen = seen_from(scene, done, neighbours, np.full(len(neighbours), m))
    shared_blocks(inside, done.params[m], seen, float(scene.multiplicative), blocks)
    mixed = blocks[:, free] * unit[:, None]
    known = done.cov[neighbours, :SHARED, :SHARED] / variance[neighbours, None, None]
    matrix = np.linalg.inv(alone) * variance[m] - (mixed @ known @ mixed.swapaxes(1, 2)).sum(axis=0)
    if np.isfinite(matrix).all() and np.linalg.eigvalsh(matrix)[0] > 0.0:
        cov[:] = 0.0
        cov[np.ix_(free, free)] = np.linalg.inv(matrix) * np.outer(unit, unit) * variance[m]
    return cov
