"""From pictures of a dot board to a calibration: no table of coordinates, no labels, no start.

Where marked dots tell every dot from picture to picture, the board itself is measured: its nominal grid is a start, and
gives the datum. Where they do not, each picture may show the board turned or shifted, and only the grid as it should be
can be used.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from windmark.calibration import BoardNotFound, BoardView, Calibration, Fixed, Free, NotCalibrated
from windmark.calibration.board import FREEDOMS, find_board, find_boards
from windmark.calibration.datum import Datum
from windmark.errors import UsageError
from windmark.geometry import Camera
from windmark.scene import Detections, MarkerSet, Observations, View
from windmark.tasks.calibrate.board_folded import with_shape
from windmark.tasks.calibrate.board_picture import Board, BoardPicture
from windmark.tasks.calibrate.board_turned import placed_by_print
from windmark.tasks.calibrate.lens import in_lens, with_lens
from windmark.tasks.calibrate.marks import Marks, with_excess, with_focal, with_sigma
from windmark.tasks.calibrate.picture import excess_px
from windmark.tasks.calibrate.run import Calibrated, CalibrateSettings, adjusted, calibrate_marks, explained
from windmark.tasks.calibrate.stage import Stage, unnoticed

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

NEIGHBOURS = 9
"""Dots round one, with itself, that tell the scale of the picture there."""


def calibrate_dots(
    pictures: Sequence[BoardPicture],
    board: Board,
    cameras: Mapping[str, Camera],
    settings: CalibrateSettings,
    *,
    given: Mapping[str, Camera | None] | None = None,
    unknown_focal: bool = False,
    stage: Stage = unnoticed,
) -> tuple[Calibrated | NotCalibrated, tuple[BoardPicture, ...]]:
    """Find the board among the spots of each picture, and calibrate.

    Parameters
    ----------
    pictures : with their spots
    board : what is known of it
    cameras : start values by name
    settings : of calibrating. Without a datum: `Free` over all dots where the marks tell them apart (the board is
        measured; on average it is the nominal one), else all dots are held where they should be
    given : the cameras that a file tells, None for the others, whose start value is a stand-in; not said: all are told
    unknown_focal : whether the focal length of a camera is only a stand-in, and found from the dots
    stage : told of each stage

    Returns
    -------
    The calibration, or why there is none; and what became of each picture.

    Raises
    ------
    ValueError
        For a datum or a rig that needs dots that are told apart.
    """
    check_board(board, settings)
    known = dict(cameras) if given is None else given
    with stage("find the board"):
        pictures = _boards(pictures, board)
    told = sum(p.board is not None and not p.board.freedom for p in pictures)
    apart = bool(board.marks) or 2 * told > sum(p.board is not None for p in pictures)
    if apart:
        pictures = [_named(p, board) for p in pictures]
    datum = settings.datum or (Free() if apart else Fixed())
    if not apart:
        _refuse_moves(datum, settings.rig)
    if not any(p.count for p in pictures):
        return _no_board(pictures), tuple(pictures)
    marks = _marks(pictures, board, in_lens(cameras, known, settings.lens))
    if unknown_focal:
        with stage("focal length from nothing"):
            marks = with_focal(marks, settings.seed)
    settings = replace(settings, datum=datum)
    with stage("lens"):
        marks, lenses = with_lens(marks, settings, known, focal_known=not unknown_focal)
    with stage("calibrate"):
        first = adjusted(marks, replace(settings, max_sigma0=np.inf))
    if not isinstance(first, Calibration):
        why = explained(first, marks)
        return why if apart else with_shape(why, marks, settings), tuple(pictures)
    excess = excess_px(first, 0.0)
    if apart:
        with stage("marks that are hidden"):
            pictures = placed_by_print(pictures, board, first, excess)
        marks = _marks(pictures, board, marks.cameras)
    obs = marks.observations
    wider = replace(marks, observations=replace(obs, cov=with_excess(obs.cov, excess)))
    done = calibrate_marks(wider, settings, stage, lenses)
    # Dots that are told apart are measured: then a board may have any shape.
    done = done if apart else with_shape(done, marks, settings)
    return done, tuple(replace(p, excess_px=excess) for p in pictures)


def _boards(pictures: Sequence[BoardPicture], board: Board) -> list[BoardPicture]:
    """The board in every picture, or why it is not there."""
    known = {"layout": board.layout, "aspect": board.aspect}
    found: list[BoardView | BoardNotFound] = []
    if board.marks:
        for p in pictures:
            how = p.holes if p.holes is not None else board.mark_kind
            found.append(find_board(
                p.detections, columns=board.columns, rows=board.rows, marks=board.marks, mark_spots=how,
                size_px=p.size_px, layout=board.layout, aspect=board.aspect,
            ))  # fmt: skip
    else:
        sizes = {p.size_px for p in pictures}
        one = {"size_px": sizes.pop()} if len(sizes) == 1 else {}
        found = find_boards([p.detections for p in pictures], columns=board.columns, rows=board.rows, **known, **one)
    return [
        replace(p, board=f, round=1) if isinstance(f, BoardView) else replace(p, problem=p.unread or f.reason)
        for p, f in zip(pictures, found, strict=True)
    ]


def _named(picture: BoardPicture, board: Board) -> BoardPicture:
    """Without the picture whose dots are not told apart."""
    if picture.board is None or not picture.board.freedom:
        return picture
    open_ = "; ".join(FREEDOMS[f] for f in picture.board.freedom)
    rings = ""
    if picture.holes is not None:
        rings = f" (a hole is seen in {_rings(picture.detections, picture.holes)} dots, {len(board.marks)} are marked)"
    return replace(picture, problem=f"the marked dots were not found{rings}: {open_}", round=0)


def _rings(dots: Detections, holes: Detections) -> int:
    """Dots with a hole about their centre."""
    if not len(dots) or not len(holes):
        return 0
    far, dot = cKDTree(dots.xy).query(holes.xy)
    return len(np.unique(dot[far < 0.5 * dots.radius_px[dot]]))


def check_board(board: Board, settings: CalibrateSettings) -> None:
    """Raise for what a board whose dots are not told apart cannot give."""
    if not board.marks and board.layout == "square":
        _refuse_moves(settings.datum or Fixed(), settings.rig)


def _refuse_moves(datum: Datum, rig: bool) -> None:
    if datum != Fixed():
        raise UsageError(
            "datum: dots of a board without marks are not the same from picture to picture, so they cannot be measured;"
            " expected fixed (the grid as it should be), or the marks of the board"
        )
    if rig:
        raise UsageError(
            "rig: cameras side by side must see the same dots, and a board without marks looks the same turned or "
            "shifted: the marks of the board are needed"
        )


def _no_board(pictures: Sequence[BoardPicture]) -> NotCalibrated:
    reason = f"no board was found in any of {len(pictures)} pictures. {pictures[0].name}: {pictures[0].problem}"
    return NotCalibrated(reason, "too_few", dropped={p.name: p.problem for p in pictures})


def _marks(pictures: Sequence[BoardPicture], board: Board, cameras: Mapping[str, Camera]) -> Marks:
    """The marks of all pictures with a board, and the dots that are seen as markers named by column and row."""
    good = [(p, p.board) for p in pictures if p.board is not None and not p.problem]
    cells = [np.stack([b.column, b.row], axis=1) for _, b in good]
    every, point = np.unique(np.concatenate(cells), axis=0, return_inverse=True)
    xyz = np.column_stack([every * [board.pitch, board.pitch * board.aspect], np.zeros(len(every))])
    radius = _radii(np.concatenate([_dot_radii(p, b, board) for p, b in good]), point.ravel(), every, board)
    markers = MarkerSet.make(
        [f"c{i:02d}r{j:02d}" for i, j in every.tolist()], xyz, normal=np.tile([0.0, 0.0, -1.0], (len(xyz), 1)),
        radius=radius, length_unit=board.length_unit,
    )  # fmt: skip
    view = np.repeat(np.arange(len(good)), [len(c) for c in cells])
    xy = np.concatenate([b.xy(p.detections) for p, b in good])
    cov = with_sigma(np.concatenate([p.detections.cov[b.spot] for p, b in good]), 0.1)
    used = {p.camera for p, _ in good}
    return Marks(
        Observations(view.astype(np.int64), point.ravel().astype(np.int64), xy, cov), markers,
        {k: c for k, c in cameras.items() if k in used}, tuple(View(p.name, p.camera, p.frame) for p, _ in good),
    )  # fmt: skip


def _radii(seen: Array, point: Ints, cells: Ints, board: Board) -> Array:
    """(N,) radii of the dots from those of their images (O,): one of all, and one of those marked by their size."""
    marked = np.zeros(len(cells), dtype=bool)
    if board.mark_kind != "holes":
        marked = np.isin(cells @ [1 << 32, 1], np.array(board.marks, dtype=np.int64).reshape(-1, 2) @ [1 << 32, 1])
    out = np.empty(len(cells))
    for kind in (marked, ~marked):
        own = seen[kind[point]]
        known = own[np.isfinite(own)]
        out[kind] = np.median(known) if len(known) else np.nanmedian(seen)
    return out


def _dot_radii(picture: BoardPicture, found: BoardView, board: Board) -> Array:
    """(K,) radii of the dots in the length unit, from their images and the board's scale there; NaN where not known.

    The scale is that of the affine map of a dot's neighbourhood: a wide lens maps no plane by one homography.
    """
    plane, xy = found.xyz(board.pitch)[:, :2], found.xy(picture.detections)
    near = cKDTree(plane).query(plane, min(NEIGHBOURS, len(plane)))[1]
    design = np.concatenate([plane[near] - plane[:, None], np.ones((*near.shape, 1))], axis=2)
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = (np.linalg.pinv(design) @ (xy[near] - xy[:, None]))[:, :2]
        scale = np.sqrt(np.abs(np.linalg.det(slope)))
        radii = np.where(scale > 0, picture.detections.radius_px[found.spot] / np.where(scale > 0, scale, 1.0), np.nan)
    return np.asarray(radii)
