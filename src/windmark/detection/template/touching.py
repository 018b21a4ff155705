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

from windmark.detection.template.fit import Fitted, sized_windows
from windmark.detection.template.request import Neighbours, Request, Scene

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

SWEEPS = 12  # at most: the rims that overlap are narrow, and each sweep leaves a small part of the error
STILL = 1e-3  # px that no centre moves by: all stay
MOVED = 0.5  # radii by which the neighbours' light may move a centre


def fit_touching(scene: Scene, request: Request, done: Fitted, others: Neighbours, worth: Bools | None = None) -> Ints:
    """Fit again, in `done`, the markers whose rims overlap; which they are (L,). Others are not converged with them.

    Of candidates only those that are `worth` it (K,), together with others that are; None: all.
    A marker that does not converge so, whose neighbour does not, or that cannot be told from it, keeps its first fit.
    """
    joint = _overlapping(request, done, others)
    if worth is not None:
        joint = np.where(worth[:, None] & (joint >= 0) & worth[joint], joint, -1)
    index = np.flatnonzero((joint >= 0).any(axis=1))
    if not index.size:
        return index
    first = done.take(index)
    left_out = replace(others, index=np.where(joint >= 0, -1, others.index)).take(index)
    stay = _swept(scene, request, done, index, joint[index], left_out)
    cov = np.full((len(index), 10, 10), np.nan)
    cov[stay] = _with_neighbours(scene, request, done, index[stay], joint[index[stay]])
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
    groups = sized_windows(scene, part, left_out)
    place = np.full(len(done.params), -1)
    place[index] = np.arange(len(index))
    beside = np.where(joint >= 0, place[joint], -1)
    good: Bools = np.ones(len(index), dtype=bool)
    moved: Bools = good.copy()
    for _ in range(SWEEPS):
        good &= np.where(beside >= 0, good[beside], True).all(axis=1)
        asked = good & (moved | np.where(beside >= 0, moved[beside], False).any(axis=1))
        if not asked.any():
            break
        before = done.params[index, :2].copy()
        for w in groups:
            rows = np.flatnonzero(asked[w.index])
            if rows.size:
                mine, patches = index[w.index[rows]], w.patches[rows]
                which, column = map(np.ascontiguousarray, np.nonzero(joint[w.index[rows]] >= 0))
                seen = seen_from(scene, done, joint[w.index[rows]][which, column], mine[which])
                take_away(patches, w.weights[rows], which, seen, float(scene.multiplicative))
                done.put(mine, w.fit(rows, done.states[mine], patches))
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


def _with_neighbours(scene: Scene, request: Request, done: Fitted, index: Ints, joint: Ints) -> Array:
    """Covariances (L, 10, 10) of markers whose neighbours' ``joint`` (L, N) discs are unknown too, see the file's head.

    NaN where both cannot be told apart.
    """
    from windmark.detection.template._kernels.touching import SHARED, shared_blocks

    owner, column = (np.ascontiguousarray(n) for n in np.nonzero(joint >= 0))  # of one type for the kernel
    neighbour = joint[owner, column]
    variance, one = done.column("noise2"), request.take(index)
    blocks = np.empty((len(owner), 10, SHARED))
    shared_blocks(
        one.xy - done.pixel[index], one.reach(), done.params[index], owner,
        seen_from(scene, done, neighbour, index[owner]), float(scene.multiplicative), blocks,
    )  # fmt: skip
    unit = np.sqrt(np.diagonal(done.cov[index], axis1=1, axis2=2))
    free = unit > 0.0  # what is held is known
    unit[~free] = 1.0
    alone = np.where(free[:, :, None] & free[:, None, :], done.cov[index], 0.0) / (unit[:, :, None] * unit[:, None, :])
    alone += np.where(free, 0.0, 1.0)[:, :, None] * np.eye(10)
    with np.errstate(invalid="ignore", divide="ignore"):
        mixed = blocks * (unit * free)[owner, :, None]
        known = done.cov[neighbour, :SHARED, :SHARED] / variance[neighbour, None, None]
        theirs = mixed @ known @ mixed.swapaxes(1, 2)
    mine = variance[index]
    good: Bools = np.asarray(_positive(alone) & (mine > 0.0))
    matrix = np.linalg.inv(np.where(good[:, None, None], alone, np.eye(10))) * mine[:, None, None]
    np.subtract.at(matrix, owner, theirs)
    good &= _positive(matrix)
    cov = np.linalg.inv(np.where(good[:, None, None], matrix, np.eye(10))) * mine[:, None, None]
    cov *= (unit * free)[:, :, None] * (unit * free)[:, None, :]
    cov[~good] = np.nan
    return np.asarray(cov)


def _positive(matrices: Array) -> Bools:
    """Which of (L, 10, 10) are finite and positive definite."""
    good: Bools = np.asarray(np.isfinite(matrices).all(axis=(1, 2)))
    return np.asarray(good & (np.linalg.eigvalsh(np.where(good[:, None, None], matrices, np.eye(10)))[:, 0] > 0.0))
