"""The freedom of a network that no picture sees: shifts, turns and the scale of the whole.

Similarity motions of points and cameras leave every projection as it is. Which of the seven are really free
depends on what is held or known (fixed points, known coordinates, distances, fixed cameras).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.adjust.network._arrays import Units
from windmark.adjust.network.layout import Layout
from windmark.adjust.network.model import Network
from windmark.adjust.network.state import NetworkState

Array = NDArray[np.float64]

HELD = 1e12
"""Information (per natural unit squared) of what does not move at all."""
NONE = 1e-6
"""Less is none, see `determinacy`."""


@dataclass(frozen=True)
class Gauge:
    """The g free motions, in natural units.

    Parameters
    ----------
    dense : (D, g) of the dense parameters
    blocks : (E b, g) of the eliminated parameters
    """

    dense: Array
    blocks: Array


def free_motions(network: Network, layout: Layout, state: NetworkState, units: Units) -> Gauge:
    """The similarity motions that neither observation nor prior sees."""
    point, frame, offset = _motions(layout, state, units)
    vector = _free(network, layout, state, units, (point, frame, offset))
    point, frame, offset = point @ vector, frame @ vector, offset @ vector
    columns, g = layout.columns, vector.shape[1]
    dense, blocks = np.zeros((layout.dense, g)), np.zeros((layout.blocks, layout.size, g))
    for values, start in ((frame, columns.frame), (offset, columns.offset), (point, columns.point)):
        here = start[start >= 0][:, None] + np.arange(values.shape[1])
        dense[here] = values[start >= 0]
    values, index = (point, columns.point_block) if layout.points_eliminated else (frame, columns.frame_block)
    blocks[index[index >= 0]] = values[index >= 0]
    return Gauge(dense, blocks.reshape(layout.blocks * layout.size, g))


def stabiliser(gauge: Gauge, h_dd: Array) -> Array:
    """(D, k) whose product with itself, added to (D, D), holds the free motions by their dense part.

    That changes neither cost nor estimable quantities, and any other choice of the motions' size or start does as well.
    """
    basis, triangle = np.linalg.qr(gauge.dense)
    size = np.abs(np.diagonal(triangle))
    basis = basis[:, size > 1e-9 * size.max(initial=0.0)]
    return np.asfortranarray(basis * np.sqrt(np.median(np.maximum(np.diagonal(h_dd), 1.0)) if basis.size else 1.0))


def _motions(layout: Layout, state: NetworkState, units: Units) -> tuple[Array, Array, Array]:
    """(N, 3, 7), (F, 6, 7), (A, 6, 7): turn about the centroid, shift and scale, in natural units.

    A point moves to X + w x (X - c) + u t + s (X - c). Every camera must then see (1 + s) times the same
    camera-frame points: it turns by -R w about the centroid's place B c, and shifts by s B c - u R t.
    """
    arm = (state.points - layout.center) / layout.unit
    point = np.zeros((len(arm), 3, 7))
    point[:, 0, 1], point[:, 0, 2] = arm[:, 2], -arm[:, 1]
    point[:, 1, 0], point[:, 1, 2] = -arm[:, 2], arm[:, 0]
    point[:, 2, 0], point[:, 2, 1] = arm[:, 1], -arm[:, 0]
    point[:, :, 3:6] = np.eye(3)
    point[:, :, 6] = arm
    rotation, count = state.frames.rotation, len(state.frames.translation)
    frame = np.zeros((count, 6, 7))
    frame[:, :3, :3] = -rotation
    frame[:, 3:, 3:6] = -rotation * (layout.unit / units.frame_scale)[:, None, None]
    frame[:, 3:, 6] = units.frame_pivot / units.frame_scale[:, None]
    members = len(units.offset_scale)
    offset = np.zeros((members, 6, 7))
    if state.offsets is not None:
        offset[:, 3:, 6] = state.offsets.translation / units.offset_scale[:, None]
    return point, frame, offset


def _free(
    network: Network, layout: Layout, state: NetworkState, units: Units, motions: tuple[Array, Array, Array]
) -> Array:
    """(7, g) combinations of the seven motions that nothing but the pictures could see."""
    point, frame, offset = motions
    rows = [np.sqrt(HELD) * point[network.held & network.used_point[:, None]]]
    rows += [np.sqrt(HELD) * m[fixed].reshape(-1, 7) for m, fixed in _fixed(network, frame, offset) if fixed.any()]
    if network.point_sigma is not None:
        rows.append((point * (units.point / network.point_sigma)[..., None]).reshape(-1, 7))
    if network.together is not None:
        rows.append(network.together.whitener @ point[network.together.point].reshape(-1, 7) * units.point)
    bars = network.bars
    if len(bars.length):
        arm = state.points[bars.first] - state.points[bars.second]
        arm /= np.sqrt((arm**2).sum(axis=1, keepdims=True))
        change = np.einsum("bi,big->bg", arm, point[bars.first] - point[bars.second])
        rows.append(change * (units.point / bars.sigma)[:, None])
    stack = np.concatenate(rows)
    if not len(stack):
        return np.eye(7)
    # Not from the squares: beside what is held, rounding would pass for knowledge where held points are on a line.
    _, value, vector = np.linalg.svd(
        np.concatenate([stack, np.zeros((max(0, 7 - len(stack)), 7))]), full_matrices=False
    )
    return np.asarray(vector[value**2 < NONE].T)


def _fixed(network: Network, frame: Array, offset: Array) -> list[tuple[Array, NDArray[np.bool_]]]:
    """Motions of the poses that are used and fixed."""
    return [(frame, network.used_frame & ~network.free_frame), (offset, network.used_offset & ~network.free_offset)]
