"""Is a grown lattice right everywhere? What does not fit its neighbours goes; what hangs loose goes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from windmark.calibration.board.grow import NOISE, Lattice, Prediction, fill, take
from windmark.geometry.two_view.homography import fit_homography, transfer

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_FAR = 5.0  # times the scatter: not at its place
_LEAST = 0.03  # cells; nearer is never wrong
_MOST = 0.15  # cells; farther is always wrong
_STRANGE = 0.25  # cells; what lens distortion leaves after a homography and a cubic is far below
_CUBIC = 40  # dots from which on the cubic is fitted
_ROUNDS = 30
_WIDE = 3.0  # times that where few neighbours predict the place
_SIZE = 0.30  # of the logarithm of the radius: not a dot of this board
_MANY = 0.4  # share of the places between the cells with a spot: the lattice leaves dots out
_SAMPLE = 150  # dots whose surroundings are looked at for that
_BETWEEN = np.array(sorted({(a / n, b / n) for n in (2, 3, 4, 5) for a in range(n) for b in range(n)} - {(0.0, 0.0)}))


def clean(lattice: Lattice, tree: cKDTree, radius: Array | None) -> None:
    """Drop what does not fit, fill with what does, also across gaps, and keep the largest connected part.

    Parameters
    ----------
    lattice : changed in place
    tree : of all spots
    radius : (N,) of the spots; None does not look at them
    """
    for step in (fill, _bridge, fill):
        _drop_misfits(lattice)
        if radius is not None:
            _drop_odd_sizes(lattice, radius)
        if len(lattice.spots) < 4:
            return
        near = gate(scatter(lattice))
        step(lattice, tree, (near, _WIDE * near))
    _drop_misfits(lattice)
    if radius is not None:
        _drop_odd_sizes(lattice, radius)
    _drop_strangers(lattice)
    _keep_largest(lattice)


def gate(sigma: float) -> float:
    """Distance from its place, in cells, beyond which a spot is not the dot; of the scatter."""
    return float(np.clip(_FAR * sigma, _LEAST, _MOST))


def scatter(lattice: Lattice) -> float:
    """Robust 1 sigma per coordinate of the spots about the places their neighbours predict, in cells."""
    spots = lattice.spots
    if len(spots) < 4:
        return float("nan")
    return float(np.median(_misfit(lattice, spots)) / 1.17741)  # the median of Rayleigh's distribution


def _misfit(lattice: Lattice, spots: Ints) -> Array:
    """Distance from the predicted places in cells, in parts of what it is where many neighbours predict."""
    at = lattice.predict(lattice.cell[spots])
    return np.asarray(at.distance(lattice.xy[spots]) / np.hypot(1, at.sigma / NOISE))


def _drop_misfits(lattice: Lattice) -> None:
    """The worst of each neighbourhood first: a wrong spot spoils the prediction of those beside it."""
    look = lattice.spots
    if len(look) < 4:
        return
    misfit = np.zeros(len(lattice.xy) + 1)  # the last one stands for the empty cells' spot -1
    misfit[look] = _misfit(lattice, look)
    limit = gate(float(np.median(misfit[look])) / 1.17741)
    for _ in range(_ROUNDS):
        bad = np.flatnonzero(misfit > limit)
        if not len(bad):
            return
        near = lattice.neighbours(lattice.cell[bad])
        worst = misfit[bad] >= misfit[near].max(axis=1)
        lattice.drop(bad[worst])
        misfit[bad[worst]] = 0.0
        look = np.unique(near[worst])
        look = look[(look >= 0) & (lattice.cell[look, 0] >= 0)]
        misfit[look] = _misfit(lattice, look)


def _drop_odd_sizes(lattice: Lattice, radius: Array) -> None:
    """Spots whose radius is not that of the dots round them."""
    spots = lattice.spots
    near = lattice.neighbours(lattice.cell[spots])
    size = np.where(near >= 0, np.log(radius)[near], np.nan)
    has = np.isfinite(size).sum(axis=1) >= 3
    if has.any():
        middle = np.nanmedian(size[has], axis=1)
        lattice.drop(spots[has][np.abs(np.log(radius)[spots[has]] - middle) > _SIZE])


def _bridge(lattice: Lattice, tree: cKDTree, near: tuple[float, float]) -> None:
    """Label across gaps: one homography predicts the cells round all, if it holds for those that are labelled."""
    spots = lattice.spots
    cells = lattice.cell[spots]
    h = fit_homography(cells.astype(float), lattice.xy[spots])
    at = lattice.predict(cells)
    if h is None or not (at.distance(transfer(h, cells.astype(float))) < _MOST).all():
        return
    empty = lattice.beside(cells, 3)
    place = transfer(h, empty.astype(float))
    empty, place = empty[np.isfinite(place).all(axis=1)], place[np.isfinite(place).all(axis=1)]
    steps = np.stack([transfer(h, empty + s) - transfer(h, empty - s) for s in 0.5 * np.eye(2)], axis=1)
    good = np.isfinite(steps).all(axis=(1, 2))
    chosen, found = take(lattice, tree, Prediction(place[good], steps[good], np.full(good.sum(), _MOST / 3)), near)
    lattice.put(empty[good][chosen], found)


def _drop_strangers(lattice: Lattice) -> None:
    """What does not fit one flat board behind one smooth lens: a homography and a cubic in column and row.

    Each part of a wrongly joined lattice is smooth; only all together are not. The worst go first.
    """
    for _ in range(_ROUNDS):
        spots = lattice.spots
        cells = lattice.cell[spots].astype(float)
        h = fit_homography(lattice.xy[spots], cells)
        if h is None:
            return
        off = transfer(h, lattice.xy[spots]) - cells
        off = np.where(np.isfinite(off), off, 1.0)
        if len(spots) > _CUBIC:
            u, v = ((cells - cells.mean(axis=0)) / np.maximum(np.ptp(cells, axis=0), 1)).T
            design = np.stack([u**i * v**j for i in range(4) for j in range(4 - i)], axis=1)
            off = off - design @ np.linalg.lstsq(design, off, rcond=None)[0]
        length = np.hypot(*off.T)
        if not (length > _STRANGE).any():
            return
        lattice.drop(spots[length > max(_STRANGE, 0.7 * length.max())])


def _keep_largest(lattice: Lattice) -> None:
    """The largest part without gaps of more than two cells."""
    parts, count = ndimage.label(ndimage.binary_dilation(lattice.table >= 0, np.ones((3, 3))), np.ones((3, 3)))
    if count > 1:
        largest = int(np.argmax(np.bincount(parts[lattice.table >= 0])))
        lattice.drop(lattice.table[(parts != largest) & (lattice.table >= 0)])


def leaves_out(lattice: Lattice, tree: cKDTree) -> bool:
    """Whether there are dots between the cells: the steps are then twice, three, four or five times too long."""
    spots = lattice.spots
    spots = spots[:: max(1, len(spots) // _SAMPLE)]
    at = lattice.predict(lattice.cell[spots])
    places = lattice.xy[spots][:, None] + np.einsum("sk,mkc->msc", _BETWEEN, at.steps)
    found = tree.query(places)[1]
    hit = at.distance(lattice.xy[found] - places + at.xy[:, None]) < _MOST
    return bool((hit & (lattice.cell[found, 0] < 0)).mean(axis=0).max() > _MANY)
