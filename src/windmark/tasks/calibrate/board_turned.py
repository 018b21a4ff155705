"""Pictures in which the marked dots are hidden: how the board lies there is told by how it was printed.

No print is exact. Where the other pictures have measured every dot, a board that is taken turned or shifted by whole
cells does not fit: its dots are off by what they differ from the regular grid. The right placement leaves the marks'
noise, all others leave much more; where they do not, the board is too regular to tell, and the picture stays out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark.adjust import refine_pose
from windmark.calibration import BoardView, Calibration
from windmark.calibration.board.axes import symmetries
from windmark.calibration.start import start_poses
from windmark.geometry import DegenerateGeometry, Pose
from windmark.scene import MarkerSet
from windmark.tasks.calibrate.board_picture import Board, BoardPicture
from windmark.tasks.calibrate.marks import with_excess
from windmark.tasks.calibrate.picture import lost_most

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

LEAST_DOTS, LEAST_PART = 20, 0.8
"""Dots of a picture that must be known for a placement, and which part of all."""
APART = 4.0
"""Squared residuals of the second best placement by those of the best one: half of what is left is not chance."""
FITS = 2.0
"""Residuals of the right placement, at most so many times those of the pictures that are placed."""


@dataclass(frozen=True)
class Placement:
    """Indices (K, 2) of a picture's dots, and the mean squared residual by its variance that they leave."""

    index: Ints
    misfit: float


def placed_by_print(
    pictures: Sequence[BoardPicture], board: Board, known: Calibration, excess_px: float
) -> list[BoardPicture]:
    """The pictures, those among them placed whose dots fit the board as ``known`` has it in one way only.

    They are those whose marks were not found, and those that contradict the others: a false mark may have placed them.
    ``excess_px`` is what the residuals of the known pictures have beyond the detector's noise.
    """
    out, doubtful = [], {*lost_most(known), *known.dropped}
    for picture in pictures:
        view = picture.board
        hidden = view is not None and bool(picture.problem) and bool(view.freedom)
        if view is None or not (hidden or picture.name in doubtful) or picture.camera not in known.cameras:
            out.append(picture)
            continue
        index = _only(picture, view, board, known, excess_px)
        out.append(picture if index is None else replace(
            picture, problem="", round=2,
            board=replace(view, column=index[:, 0], row=index[:, 1], freedom=()),
        ))  # fmt: skip
    return out


def _only(picture: BoardPicture, view: BoardView, board: Board, known: Calibration, excess_px: float) -> Ints | None:
    """Columns and rows of the one placement that fits; None where none does, or not clearly one."""
    place = _cells_of(known.markers)
    pose = _rough_pose(picture, view, board, known)
    if pose is None:
        return None
    found = [
        p for index, motion in _placements(view, board, place)
        if (p := _fitted(picture, view, index, pose @ motion.inverse(), place, known, excess_px)) is not None
    ]  # fmt: skip
    found.sort(key=lambda p: p.misfit)
    if len(found) < 2 or found[0].misfit > (FITS * max(known.sigma0, 1.0)) ** 2:
        return None
    return found[0].index if found[1].misfit > APART * found[0].misfit else None


def _cells_of(markers: MarkerSet) -> dict[tuple[int, int], int]:
    """Index of the marker of every column and row, by their names."""
    return {(int(c), int(r)): n for n, (c, r) in enumerate(name[1:].split("r") for name in markers.name.tolist())}


def _rough_pose(picture: BoardPicture, view: BoardView, board: Board, known: Calibration) -> Pose | None:
    """Of the board as its indices stand, on the regular grid."""
    marks = [(view.xy(picture.detections), view.xyz(board.pitch))]
    rng = np.random.default_rng(0)
    return start_poses(known.cameras[picture.camera], marks, scan_focal=False, rng=rng)[1][0]


def _placements(
    view: BoardView, board: Board, place: dict[tuple[int, int], int]
) -> Iterator[tuple[Ints, Pose]]:
    """Indices of the dots turned and shifted so that most of them are known dots; and how that moves the board."""
    cells, known = np.stack([view.column, view.row], axis=1), np.array(list(place))
    scale = np.array([board.pitch, board.pitch * board.aspect])
    needed = max(LEAST_DOTS, LEAST_PART * len(cells))
    for turn in symmetries(board.aspect):
        turned = cells @ turn.T
        low = known.min(axis=0) - turned.min(axis=0) - np.ptp(turned, axis=0)
        high = known.max(axis=0) - turned.max(axis=0) + np.ptp(turned, axis=0)
        for shift in np.stack(np.meshgrid(*map(np.arange, low, high + 1)), axis=-1).reshape(-1, 2):
            index = turned + shift
            inside = ((index >= known.min(axis=0)) & (index <= known.max(axis=0))).all(axis=1)
            if inside.sum() >= needed and sum(cell in place for cell in map(tuple, index.tolist())) >= needed:
                rotation = np.eye(3)
                rotation[:2, :2] = turn * (scale[:, None] / scale)
                yield index, Pose(rotation, np.append(shift * scale, 0.0))


def _fitted(
    picture: BoardPicture, view: BoardView, index: Ints, start: Pose, place: dict[tuple[int, int], int],
    known: Calibration, excess_px: float,
) -> Placement | None:  # fmt: skip
    """What the dots leave where the board lies so; None where no pose fits."""
    number = np.array([place.get((c, r), -1) for c, r in index.tolist()])
    there = number >= 0
    xyz, xy = known.markers.xyz[number[there]], view.xy(picture.detections)[there]
    cov = with_excess(picture.detections.cov[view.spot[there]], excess_px)
    try:
        fit = refine_pose(known.cameras[picture.camera], start, xyz, xy, cov, loss="huber")
    except (ValueError, DegenerateGeometry):
        return None
    off = fit.residuals_px
    square = np.einsum("ki,kij,kj->k", off, np.linalg.inv(cov), off)
    # The median: a dot that merged with something else is no misfit of the whole.
    return Placement(index, float(np.median(square) / (2 * np.log(2.0))))
