"""Where the free parameters of a network stand: dense columns, eliminated blocks, natural units."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.adjust.blocks import CameraBlock
from windmark.adjust.network._arrays import CHANGE, Columns, Units
from windmark.adjust.network.model import Network
from windmark.adjust.network.state import NetworkState
from windmark.geometry import PARAMETERS

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Layout:
    """Numbering of the free parameters.

    Parameters
    ----------
    columns : dense columns and eliminated blocks
    dense : number of dense columns D
    blocks, size : number and size of the eliminated blocks
    center, unit : (3,), float: centroid of the points and their root mean square distance from it
    """

    columns: Columns
    dense: int
    blocks: int
    size: int
    center: Array
    unit: float

    @property
    def points_eliminated(self) -> bool:
        """Whether the eliminated blocks are points (or frames)."""
        return self.size == 3

    def most_columns(self, camera: Ints, frame: Ints, offset: Ints) -> int:
        """Dense parameters that a mark has at most, by the camera, frame and rig member (-1: none) of each view."""
        columns = self.columns
        count = (columns.camera >= 0).sum(axis=1)[camera] + 6 * (columns.frame >= 0)[frame]
        count = count + (columns.change >= 0).sum(axis=1)
        if len(columns.offset):
            count = count + 6 * ((columns.offset >= 0)[offset] & (offset >= 0))
        return int(count.max(initial=0)) + 3 * bool((columns.point >= 0).any())


_EVERY = CameraBlock(PARAMETERS)


def make_layout(network: Network, state: NetworkState) -> Layout:
    """Number the parameters; what nothing observes and nothing else holds gets no number."""
    tied = network.tied
    point = network.used_point & ~network.held.all(axis=1)
    frame = network.used_frame & network.free_frame
    away = network.eliminate
    if away == "auto":
        away = "points" if 3 * int((point & ~tied).sum()) >= 6 * int(frame.sum()) else "frames"
    count = 0
    camera = np.full((len(network.free_camera), len(PARAMETERS)), -1)
    for c, free in enumerate(network.free_camera):
        for name in (p for p in PARAMETERS if p in free):
            camera[c, PARAMETERS.index(name)] = count
            count += 1

    def number(free: NDArray[np.bool_], size: int) -> Ints:
        nonlocal count
        out = np.full(len(free), -1)
        for i in np.flatnonzero(free):
            out[i] = count
            count += size
        return out

    offset = number(network.free_offset, 6)
    dense_frame = frame if away == "points" else np.zeros_like(frame)
    dense_point = point & tied if away == "points" else point
    frame_column = number(dense_frame, 6)
    change = np.full((len(network.view_camera), CHANGE), -1)
    if network.free_change is not None:
        asked = network.free_change & network.used_view[:, None]
        change[asked] = count + np.arange(asked.sum())
        count += int(asked.sum())
    point_column = number(dense_point, 3)
    columns = Columns(
        camera, offset, frame_column, change, point_column,
        _blocks(frame & ~dense_frame), _blocks(point & ~dense_point), np.ascontiguousarray(network.held),
    )  # fmt: skip
    blocks, size = (point & ~dense_point, 3) if away == "points" else (frame & ~dense_frame, 6)
    used = state.points[network.used_point]
    center = used.mean(axis=0)
    unit = float(np.sqrt(((used - center) ** 2).sum(axis=1).mean())) or 1.0
    return Layout(columns, count, int(blocks.sum()), size, center, unit)


def _blocks(free: NDArray[np.bool_]) -> Ints:
    return np.where(free, np.cumsum(free) - 1, -1)


def natural_units(network: Network, layout: Layout, state: NetworkState) -> Units:
    """Natural units at a state: see `blocks`; a rotation of a frame turns about the points' centroid."""
    camera = np.stack([np.diagonal(_EVERY.natural(c)) for c in state.cameras])
    focal = np.array([c.focal_px for c in state.cameras])[network.view_camera]
    change = np.stack([np.ones_like(focal), focal, focal], axis=1)
    frame_pivot = state.frames.rotation @ layout.center + state.frames.translation
    if state.offsets is None:
        offset_pivot = np.zeros((0, 3))
    else:
        # A member sees the scene from many frames: the mean place of the centroid.
        offset_pivot = np.stack(
            [
                state.offsets.rotation[a] @ frame_pivot[network.view_frame[network.view_offset == a]].mean(axis=0)
                + state.offsets.translation[a]
                if (network.view_offset == a).any()
                else state.offsets.translation[a]
                for a in range(len(state.offsets.translation))
            ]
        )
    return Units(
        camera, change, frame_pivot, _length(frame_pivot, layout.unit), offset_pivot,
        _length(offset_pivot, layout.unit), layout.unit,
    )  # fmt: skip


def _length(vectors: Array, least: float) -> Array:
    return np.maximum(np.sqrt((vectors**2).sum(axis=1)), least)
