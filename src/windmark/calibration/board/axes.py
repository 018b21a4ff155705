"""Which directions of a lattice are columns and rows.

A lattice has many bases; a tilted square grid and a sheared one look alike. What tells them apart is the board's
outline (the cells of its bounding box are filled), a limit of the tilt, and perspective: a camera with square pixels
and the principal point in the middle sees a square grid through few homographies only.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from windmark.geometry.two_view.homography import fit_homography, transfer

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

QUARTER = np.array([[0, -1], [1, 0]])
_LARGEST = 3  # entry of a change of basis: seeds' steps are the shortest, so columns and rows are near
_FOCAL = np.geomspace(0.3, 40.0, 80)  # picture widths
_TRIM = 3  # outermost columns and rows that may go, on each side
_SPARSE = 0.1  # share of the dots of the next line that is next to none
_SQUARE = 0.05  # relative error of a square that a principal point off the middle makes
_TELLS = 2.5  # another basis must fit so many times worse


@dataclass(frozen=True)
class Frame:
    """The picture, as far as it may hold dots: centre and half size, pixels."""

    middle: Array
    half: Array

    @staticmethod
    def of(xy: Array, size_px: tuple[int, int] | None) -> Frame:
        """The whole picture; without its size the box round all spots."""
        if size_px is not None:
            size = np.array(size_px, dtype=float)
            return Frame((size - 1) / 2, size / 2)
        low, high = xy.min(axis=0), xy.max(axis=0)
        return Frame((low + high) / 2, (high - low) / 2)


def symmetries(aspect: float) -> list[Ints]:
    """Turns of the indices that leave an unmarked lattice as it is."""
    step = 1 if aspect == 1.0 else 2
    return [np.linalg.matrix_power(QUARTER, k) for k in range(0, 4, step)]


def candidate_axes(
    cells: Ints,
    xy: Array,
    frame: Frame,
    *,
    layout: str,
    aspect: float,
    size: tuple[int | None, int | None],
    max_tilt_deg: float,
) -> list[Ints]:
    """Changes of basis (2, 2) that give columns and rows, one of each family of `symmetries`; best first.

    More than one: the picture cannot tell. None: no basis agrees with the board's size or the largest tilt.
    """
    h = fit_homography(cells.astype(float), xy)
    if h is None:
        return []
    steps = _derivative(h, cells.mean(axis=0))
    possible = [(b, cells[whole_lines(cells @ b.T)]) for b in _bases(layout, steps, aspect, max_tilt_deg)]
    bases = [(b, c) for b, c in possible if _fits(c @ b.T, size, aspect)]
    if not bases:
        return []
    margin = float(np.percentile(np.hypot(*(transfer(h, cells.astype(float)) - xy).T), 95))
    inside = Frame(frame.middle, frame.half - margin - 0.5 * np.sqrt(abs(np.linalg.det(steps))))
    empty = np.array([_empty(c @ b.T, h, b, inside, layout) for b, c in bases])
    limit = empty.min() + 3 + 3 * np.sqrt(empty.min())
    left = [bases[k][0] for k in np.argsort(empty, kind="stable") if empty[k] <= limit]
    if len(left) == 1:
        return left
    skew = np.array([_skew(h @ _lift(np.linalg.inv(b) @ np.diag([1, 1 / aspect])), frame) for b in left])
    good = np.argsort(skew, kind="stable")
    best = skew[good[0]]
    return [left[k] for k in good if skew[k] <= max(_TELLS * best, _SQUARE)]


def _bases(layout: str, steps: Array, aspect: float, max_tilt_deg: float) -> list[Ints]:
    """Integer changes of basis seen from the front at a possible tilt, one of each family of symmetries."""
    area, largest = (1 if layout == "square" else 2), 1 / np.cos(np.radians(max_tilt_deg))
    turns, found = symmetries(aspect), {}
    for entries in product(range(-_LARGEST, _LARGEST + 1), repeat=4):
        basis = np.array(entries).reshape(2, 2)
        det = entries[0] * entries[3] - entries[1] * entries[2]
        if abs(det) != area or (area == 2 and (basis.sum(axis=0) % 2).any()):
            continue
        new = steps @ np.linalg.inv(basis)
        if np.linalg.det(new) <= 0 or np.linalg.cond(new @ np.diag([1, 1 / aspect])) > largest:
            continue
        # Of a family the one whose columns run most to the right.
        family = [turn @ basis for turn in turns]
        right = [(steps @ np.linalg.inv(b))[:, 0] for b in family]
        chosen = family[int(np.argmax([v[0] / np.hypot(*v) for v in right]))]
        found[tuple(chosen.ravel().tolist())] = chosen
    return list(found.values())


def whole_lines(index: Ints) -> NDArray[np.bool_]:
    """Which dots are not on an outermost column or row that has next to none: a false spot beside the board is not."""
    keep = np.ones(len(index), bool)
    for _ in range(_TRIM):
        for axis in (0, 1):
            for end in (index[keep, axis].min(), index[keep, axis].max()):
                inward = 1 if end == index[keep, axis].min() else -1
                lines = np.unique(index[keep, axis], return_counts=True)[1][::inward]
                if lines[0] <= max(1, _SPARSE * np.median(lines)) and lines[0] < np.median(lines) - 1:
                    keep &= index[:, axis] != end
    return keep


def _fits(index: Ints, size: tuple[int | None, int | None], aspect: float) -> bool:
    """Whether the dots fit on the board, turned or not."""
    seen = np.ptp(index, axis=0) + 1
    turned = [seen] if aspect != 1.0 else [seen, seen[::-1]]
    return any(all(n is None or k <= n for k, n in zip(s, size, strict=True)) for s in turned)


def _empty(index: Ints, h: Array, basis: Ints, inside: Frame, layout: str) -> int:
    """Cells of the bounding box that are in the picture and have no dot."""
    low, high = index.min(axis=0), index.max(axis=0)
    box = np.stack(np.meshgrid(*(np.arange(a, b + 1) for a, b in zip(low, high, strict=True))), -1).reshape(-1, 2)
    if layout != "square":
        box = box[(box - index[0]).sum(axis=1) % 2 == 0]
    return int(seen(box, h @ _lift(np.linalg.inv(basis)), inside).sum()) - int(
        seen(index, h @ _lift(np.linalg.inv(basis)), inside).sum()
    )


def seen(index: Ints, h: Array, inside: Frame) -> NDArray[np.bool_]:
    """Whether cells are inside a part of the picture."""
    with np.errstate(invalid="ignore"):
        return np.asarray((np.abs(transfer(h, index.astype(float)) - inside.middle) <= inside.half).all(axis=1))


def _lift(linear: Array) -> Array:
    out = np.eye(3)
    out[:2, :2] = linear
    return out


def _derivative(h: Array, at: Array) -> Array:
    """(2, 2) pixels per cell: columns are the steps."""
    q = h @ np.append(at, 1.0)
    return np.asarray((h[:2, :2] - np.outer(q[:2] / q[2], h[2, :2])) / q[2])


def _skew(h: Array, frame: Frame) -> float:
    """How far from a square the unit square is, at the focal length that suits it best (Zhang 2000, eq. 3-4)."""
    width = 2 * frame.half[0]
    centred = np.array([[1, 0, -frame.middle[0]], [0, 1, -frame.middle[1]], [0, 0, 1.0]]) @ h
    a, b = centred[:, 0], centred[:, 1]
    focal2 = (_FOCAL * width) ** 2
    aa, bb, ab = (x[0] * y[0] + x[1] * y[1] + focal2 * x[2] * y[2] for x, y in ((a, a), (b, b), (a, b)))
    return float(np.hypot(ab / np.sqrt(aa * bb), 0.5 * np.log(aa / bb)).min())
