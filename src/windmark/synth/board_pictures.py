"""Pictures of a printed board of dots: what a camera that is calibrated by such a board takes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Camera, Pose

Array = NDArray[np.float64]

SUBPIXELS = 5
"""Along each side of a pixel: the centre of a dot of 12 px radius is off by some 0.001 px."""
PAPER, INK, WALL = 0.85, 0.12, 0.35
"""Light of the paper, of a dot on it and of what is behind the board, 1 for all of it."""
HOLE = 0.4
"""Radius of a ring's hole by that of the ring."""


@dataclass(frozen=True)
class Board:
    """A printed board of dots, and where the printer has put each of them.

    Parameters
    ----------
    xy : (rows, columns, 2) centres in the board's plane; x along columns, y along rows
    pitch, radius : between two dots as it was meant, and of a dot; length units of ``xy``
    rings : (column, row) of the dots that have a hole
    """

    xy: Array
    pitch: float
    radius: float
    rings: Sequence[tuple[int, int]] = ()

    @staticmethod
    def printed(
        rng: np.random.Generator, columns: int, rows: int, pitch: float, *, scatter: float = 0.0, share: float = 0.26,
        rings: Sequence[tuple[int, int]] = (),
    ) -> Board:  # fmt: skip
        """A board whose dots are off by ``scatter`` (1 sigma along each axis); radius = ``share`` * pitch."""
        x, y = np.meshgrid(np.arange(columns) * pitch, np.arange(rows) * pitch)
        xy = np.stack([x, y], axis=-1) + rng.normal(0, scatter, (rows, columns, 2))
        return Board(xy, pitch, share * pitch, tuple(rings))

    @property
    def middle(self) -> Array:
        """(3,) the middle of the board."""
        rows, columns, _ = self.xy.shape
        return np.array([(columns - 1) * self.pitch / 2, (rows - 1) * self.pitch / 2, 0.0])


def board_picture(board: Board, camera: Camera, cam_from_board: Pose) -> Array:
    """(H, W) light of each pixel, the mean over its sub-pixels; without the lens's blur and the sensor's noise.

    The board must be before the camera; what is behind it is a plain wall. Where rays meet the board is exact at the
    pixels' corners and straight between them, which is off by some 1e-5 px.
    """
    width, height = camera.size_px
    corners = np.stack(np.meshgrid(np.arange(width + 1) - 0.5, np.arange(height + 1) - 0.5), axis=-1)
    at = _met(camera.unproject(corners), cam_from_board)
    whole, near = _light(board, (at[1:, 1:] + at[:-1, :-1]) / 2)
    v, u = np.nonzero(near < _size(at))
    step = (np.arange(SUBPIXELS) + 0.5) / SUBPIXELS
    b, a = (s.ravel()[:, None] for s in np.meshgrid(step, step, indexing="ij"))
    light = np.zeros(len(v))
    for k in range(len(a)):
        place = (1 - b[k]) * ((1 - a[k]) * at[v, u] + a[k] * at[v, u + 1])
        place += b[k] * ((1 - a[k]) * at[v + 1, u] + a[k] * at[v + 1, u + 1])
        light += _light(board, place)[0]
    whole[v, u] = light / len(a)
    return whole


def _met(rays: Array, pose: Pose) -> Array:
    """(..., 2) where rays (z = 1) of the camera meet the board's plane."""
    normal, away = pose.rotation[:, 2], pose.translation
    return np.asarray((rays * (away @ normal / (rays @ normal))[..., None] - away) @ pose.rotation[:, :2])


def _size(at: Array) -> Array:
    """(H, W) no part of a pixel is farther from its middle than this, on the board."""
    along, across = at[:-1, 1:] - at[:-1, :-1], at[1:, :-1] - at[:-1, :-1]
    return np.asarray(np.linalg.norm(along, axis=-1) + np.linalg.norm(across, axis=-1))


def _light(board: Board, at: Array) -> tuple[Array, Array]:
    """(...) light at places of the board's plane, and how near the next edge of a dot, a hole or the paper is."""
    rows, columns, _ = board.xy.shape
    cell = np.clip(np.nan_to_num(np.rint(at / board.pitch)), 0, [columns - 1, rows - 1]).astype(int)
    far = np.linalg.norm(at - board.xy[cell[..., 1], cell[..., 0]], axis=-1)
    holes = np.zeros((rows, columns))
    for column, row in board.rings:
        holes[row, column] = HOLE * board.radius
    inner = holes[cell[..., 1], cell[..., 0]]
    ink = (far < board.radius) & (far >= inner)
    edge = board.pitch * np.array([[-1.0, -1.0], [columns, rows]])
    inside = np.minimum(at - edge[0], edge[1] - at).min(axis=-1)
    hole = np.where(inner > 0, np.abs(far - inner), np.inf)
    near = np.minimum(np.minimum(np.abs(far - board.radius), hole), np.abs(inside))
    return np.where(inside > 0, np.where(ink, INK, PAPER), WALL), near
