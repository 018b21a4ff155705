"""A network as the engine wants it: linearise, retract."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from windmark.adjust.loss import Loss
from windmark.adjust.network import linear
from windmark.adjust.network._arrays import CHANGE, Equations, Marks, Scene, Units
from windmark.adjust.network.equations import NetworkEquations
from windmark.adjust.network.gauge import free_motions, stabiliser
from windmark.adjust.network.layout import Layout, make_layout, natural_units
from windmark.adjust.network.model import Network
from windmark.adjust.network.priors import add_priors
from windmark.adjust.network.state import NetworkState
from windmark.adjust.terms import whitener
from windmark.geometry import PARAMETERS, Pose
from windmark.geometry.lens import tilt_homography, tilt_homography_derivatives
from windmark.geometry.rotations import exp_so3
from windmark.geometry.similarity import Similarity

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Rows = tuple[Array, Array, Ints, Ints]

NO_POSES = Pose(np.zeros((0, 3, 3)), np.zeros((0, 3)))
KEPT = 60_000
"""Marks up to which the derivatives at a minimum are kept for the next who asks (25 MB)."""


class NetworkProblem:
    """A network about its start; `levenberg_marquardt.minimise` solves it.

    Parameters
    ----------
    network : what is observed and what is free
    start : decides natural units and, with "auto", what is eliminated
    shift : (O, 2) added to every projection, in the network's order: the eccentricity of the imaged discs
    """

    def __init__(self, network: Network, start: NetworkState, shift: Array | None = None) -> None:
        self.network = network
        self.layout: Layout = make_layout(network, start)
        self._last: tuple[NetworkState, Units] | None = None
        self._rows: tuple[NetworkState, Rows] | None = None
        self._stabiliser: Array | None = None
        self.order = np.lexsort((network.point, network.view))
        self._weight = None if network.weight is None else network.weight[self.order]
        self._weighted = network.loss.name != "none" or self._weight is not None
        white = whitener(network.cov, len(network.xy))[self.order]
        shift = np.zeros_like(network.xy) if shift is None else shift
        self.marks = Marks(
            np.ascontiguousarray(network.view[self.order], dtype=np.int64),
            np.ascontiguousarray(network.point[self.order], dtype=np.int64),
            np.searchsorted(network.view[self.order], np.arange(len(network.view_camera) + 1)),
            np.ascontiguousarray(network.xy[self.order]),
            np.ascontiguousarray(np.stack([white[:, 0, 0], white[:, 1, 0], white[:, 1, 1]], axis=1)),
            np.ascontiguousarray(shift[self.order]),
        )
        self._view_camera, self._view_frame, self._view_offset = (
            np.ascontiguousarray(index, dtype=np.int64)
            for index in (network.view_camera, network.view_frame, network.view_offset)
        )

    def with_loss(self, loss: Loss) -> NetworkProblem:
        """The same with another loss on the observations."""
        out = copy(self)
        out.network = replace(self.network, loss=loss)
        out._weighted = loss.name != "none" or self._weight is not None
        out._stabiliser = None
        return out

    def moved(self, fit: Similarity) -> NetworkProblem:
        """The same in another frame: natural units go with it, so that steps mean what they did."""
        out = copy(self)
        out.layout = replace(self.layout, center=fit.apply(self.layout.center), unit=fit.scale * self.layout.unit)
        out._last = out._rows = out._stabiliser = None
        return out

    @property
    def size(self) -> int:
        """Length of a step: dense parameters and eliminated blocks."""
        return self.layout.dense + self.layout.blocks * self.layout.size

    def scene(self, state: NetworkState) -> Scene:
        """Values as the kernels want them."""
        camera = np.stack([c.packed() for c in state.cameras])
        tilt = np.stack([_tilt(c.tilt_x, c.tilt_y) for c in state.cameras])
        change = np.zeros((len(self._view_camera), CHANGE)) if state.change is None else state.change
        frames, offsets = state.frames, state.offsets or NO_POSES
        plain = np.ascontiguousarray
        return Scene(
            camera, tilt, self._view_camera, self._view_frame, self._view_offset, change + np.eye(1, CHANGE),
            plain(frames.rotation), plain(frames.translation), plain(offsets.rotation), plain(offsets.translation),
            plain(state.points),
        )  # fmt: skip

    def units(self, state: NetworkState) -> Units:
        """Natural units at a state; those of the last one are kept."""
        if self._last is None or self._last[0] is not state:
            self._last = (state, natural_units(self.network, self.layout, state))
        return self._last[1]

    def residual(self, state: NetworkState) -> Array | None:
        """(O, 2) whitened residuals, projected - observed, in the kernels' `order`; None without prediction."""
        out = np.empty((len(self.order), 2))
        return out if linear.residuals(self.marks, self.scene(state), out) else None

    def jacobian(self, state: NetworkState) -> Rows:
        """Derivatives of the whitened residuals by each observation's own parameters, in the kernels' `order`.

        Returns
        -------
        dense : (O, 2, K) by the dense parameters, whose columns are ``columns`` (O, K); -1 where there is none. K are
            the most that a mark has (`Layout.most_columns`), those of its point behind the others
        eliminated : (O, 2, b) by the eliminated block ``block`` (O,), -1 for none
        columns, block : as said; the four come as (dense, eliminated, columns, block), not to be written into
        """
        if self._rows is not None and self._rows[0] is state:
            return self._rows[1]
        o, lay = len(self.order), self.layout
        width = lay.most_columns(self._view_camera, self._view_frame, self._view_offset)
        dense, eliminated = np.empty((o, 2, width)), np.empty((o, 2, lay.size))
        columns, block = np.empty((o, width), np.int64), np.empty(o, np.int64)
        linear.jacobian_rows(
            self.marks, self.scene(state), self.units(state), lay.columns, dense, eliminated, columns, block
        )  # fmt: skip
        if o <= KEPT:
            self._rows = state, (dense, eliminated, columns, block)
        return dense, eliminated, columns, block

    def linearise(self, state: NetworkState) -> NetworkEquations | None:
        """Cost, gradient and information; None where a point has no image."""
        scene, residual = self.scene(state), np.empty((len(self.order), 2))
        weight, cost = np.empty(0), 0.0
        if self._weighted:
            if not linear.residuals(self.marks, scene, residual):
                return None
            rho, weight = self._losses(residual)
            cost = 0.5 * float(rho.sum())
        lay, units = self.layout, self.units(state)
        h_dd, h_ed = np.zeros((lay.dense, lay.dense)), np.zeros((lay.blocks * lay.size, lay.dense))
        h_ee = np.zeros((lay.blocks, lay.size, lay.size))
        g_d, g_e = np.zeros(lay.dense), np.zeros(lay.blocks * lay.size)
        if not linear.accumulate(
            self.marks, scene, units, lay.columns, residual, weight, self._weighted,
            Equations(h_dd, h_ed, h_ee, g_d, g_e),
        ):  # fmt: skip
            return None
        if not self._weighted:
            cost = 0.5 * float(np.vdot(residual, residual))
        cost += self._priors(state, units, (h_dd, h_ee, g_d, g_e))
        if not np.isfinite(cost):
            return None
        self._hold(h_ee)
        motions = partial(free_motions, self.network, lay, state, units)
        if self._stabiliser is None:
            self._stabiliser = stabiliser(motions(), h_dd)
        return NetworkEquations(cost, (h_dd, h_ed, h_ee), (g_d, g_e), motions, self._stabiliser)

    def _losses(self, residual: Array) -> tuple[Array, Array]:
        """Each observation's part of twice the cost, and its weight."""
        rho, weight = self.network.loss.evaluate(np.einsum("ij,ij->i", residual, residual))
        return (rho, weight) if self._weight is None else (rho * self._weight, weight * self._weight)

    def losses(self, state: NetworkState) -> Array | None:
        """(O,) each observation's part of twice the cost, in the kernels' `order`; None where a point has no image."""
        residual = self.residual(state)
        return None if residual is None else self._losses(residual)[0]

    def prior_cost(self, state: NetworkState) -> float:
        """Half the sum of squares of what is known besides the pictures."""
        lay = self.layout
        scratch = (
            np.zeros((lay.dense, lay.dense)), np.zeros((lay.blocks, lay.size, lay.size)),
            np.zeros(lay.dense), np.zeros(lay.blocks * lay.size),
        )  # fmt: skip
        return self._priors(state, self.units(state), scratch)

    def cost(self, state: NetworkState) -> float:
        """Half the sum of the losses; inf where a point has no image."""
        rho = self.losses(state)
        return float("inf") if rho is None else 0.5 * float(rho.sum()) + self.prior_cost(state)

    def retract(self, state: NetworkState, delta: Array) -> NetworkState | None:
        """The values after a step (D + E b,) in natural units; None where a camera would be impossible."""
        if not np.isfinite(delta).all():
            return None
        lay, columns = self.layout, self.layout.columns
        units = self.units(state)
        dense, blocks = delta[: lay.dense], delta[lay.dense :].reshape(lay.blocks, lay.size)
        cameras = []
        for c, camera in enumerate(state.cameras):
            parameters, own = camera.parameters(), columns.camera[c]
            parameters[own >= 0] += (units.camera[c][own >= 0]) * dense[own[own >= 0]]
            if not np.isfinite(parameters).all() or parameters[0] <= 0 or parameters[1] <= 0:
                return None
            cameras.append(camera.with_parameters(parameters) if (own >= 0).any() else camera)
        frames = _turned(
            state.frames, _gathered(columns.frame, dense, columns.frame_block, blocks, 6), units.frame_pivot,
            units.frame_scale,
        )  # fmt: skip
        offsets = state.offsets
        if offsets is not None and (columns.offset >= 0).any():
            step = _gathered(columns.offset, dense, np.full_like(columns.offset, -1), blocks, 6)
            offsets = _turned(offsets, step, units.offset_pivot, units.offset_scale)
        change, own = state.change, columns.change >= 0
        if own.any():
            change = np.zeros(own.shape) if change is None else change.copy()
            change[own] += units.change[own] * dense[columns.change[own]]
            if not (change[:, 0] > -1).all():
                return None
        step = _gathered(columns.point, dense, columns.point_block, blocks, 3)
        points = state.points + units.point * np.where(columns.held, 0.0, step)
        return NetworkState(tuple(cameras), frames, points, offsets, change)

    def _hold(self, h_ee: Array) -> None:
        """Coordinates of eliminated points that do not move: a unit on the diagonal."""
        block = self.layout.columns.point_block
        if self.layout.points_eliminated:
            point, k = np.nonzero(self.network.held & (block >= 0)[:, None])
            h_ee[block[point], k, k] += 1.0

    def _priors(self, state: NetworkState, units: Units, into: tuple[Array, Array, Array, Array]) -> float:
        """Add what is known besides the pictures; half its sum of squares."""
        return add_priors(self.network, self.layout, state, units, into)


@lru_cache(maxsize=64)
def _tilt(tilt_x: float, tilt_y: float) -> Array:
    """(3, 3, 3) homography of the sensor and its derivatives."""
    return np.stack([tilt_homography(tilt_x, tilt_y), *tilt_homography_derivatives(tilt_x, tilt_y)])


def _gathered(column: Ints, dense: Array, block: Ints, blocks: Array, size: int) -> Array:
    """(n, size) steps of n parameter groups, zero for fixed ones."""
    out = np.zeros((len(column), size))
    own = column >= 0
    out[own] = dense[column[own][:, None] + np.arange(size)]
    if blocks.shape[1] == size:
        out[block >= 0] = blocks[block[block >= 0]]
    return out


def _turned(pose: Pose, step: Array, pivot: Array, scale: Array) -> Pose:
    """Poses after natural steps (n, 6): a turn about the pivot and a shift in parts of the scale."""
    turn = exp_so3(step[:, :3])
    arm = (turn @ (pose.translation - pivot)[..., None])[..., 0]
    return Pose.trusted(turn @ pose.rotation, pivot + arm + scale[:, None] * step[:, 3:])


def camera_columns(layout: Layout) -> list[tuple[int, str, int]]:
    """(camera, parameter, dense column) of all free interior parameters."""
    column = layout.columns.camera
    return [(int(c), PARAMETERS[k], int(column[c, k])) for c, k in np.argwhere(column >= 0)]
