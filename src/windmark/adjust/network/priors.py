"""What is known besides the pictures: coordinates, interior parameters, changes of single views, distances."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.adjust.network._arrays import Units
from windmark.adjust.network.layout import Layout
from windmark.adjust.network.model import Network
from windmark.adjust.network.state import NetworkState
from windmark.geometry import PARAMETERS

Array = NDArray[np.float64]
Into = tuple[Array, Array, Array, Array]


def add_priors(network: Network, layout: Layout, state: NetworkState, units: Units, into: Into) -> float:
    """Add information and gradient of all prior knowledge to (h_dd, h_ee, g_d, g_e); half its sum of squares."""
    return (
        _points(network, layout, state, units, into)
        + _together(network, layout, state, units, into)
        + _cameras(network, layout, state, units, into)
        + _changes(network, layout, state, units, into)
        + _bars(network, layout, state, units, into)
    )


def _points(network: Network, layout: Layout, state: NetworkState, units: Units, into: Into) -> float:
    if network.point_sigma is None or network.point_value is None:
        return 0.0
    h_dd, h_ee, g_d, g_e = into
    weight = np.where(network.held, 0.0, 1 / network.point_sigma)
    r = np.where(weight > 0, state.points - np.where(weight > 0, network.point_value, 0.0), 0.0) * weight
    j = units.point * weight
    start, block = layout.columns.point, layout.columns.point_block
    for k in range(3):
        own = start[start >= 0] + k
        h_dd[own, own] += j[start >= 0, k] ** 2
        g_d[own] += (j * r)[start >= 0, k]
    if layout.points_eliminated:
        own = block[block >= 0]
        for k in range(3):
            h_ee[own, k, k] += j[block >= 0, k] ** 2
            g_e[3 * own + k] += (j * r)[block >= 0, k]
    used = (start >= 0) | (block >= 0)
    return 0.5 * float((r[used] ** 2).sum())


def _together(network: Network, layout: Layout, state: NetworkState, units: Units, into: Into) -> float:
    if network.together is None:
        return 0.0
    h_dd, _, g_d, _ = into
    r, j = network.together.residual(state.points), network.together.whitener * units.point
    own = (layout.columns.point[network.together.point][:, None] + np.arange(3)).ravel()
    h_dd[np.ix_(own, own)] += np.triu(j.T @ j)
    g_d[own] += j.T @ r
    return 0.5 * float(r @ r)


def _cameras(network: Network, layout: Layout, state: NetworkState, units: Units, into: Into) -> float:
    h_dd, _, g_d, _ = into
    cost = 0.0
    for c, (value, sigma) in enumerate(zip(network.camera_value, network.camera_sigma, strict=True)):
        now = state.cameras[c].parameters()
        for name, s in sigma.items():
            k = PARAMETERS.index(name)
            column = layout.columns.camera[c, k]
            if column < 0:
                continue
            r, j = (now[k] - value[name]) / s, units.camera[c, k] / s
            h_dd[column, column] += j * j
            g_d[column] += j * r
            cost += 0.5 * r * r
    return cost


def _changes(network: Network, layout: Layout, state: NetworkState, units: Units, into: Into) -> float:
    if network.change_sigma is None:
        return 0.0
    h_dd, _, g_d, _ = into
    own = layout.columns.change >= 0
    change = np.zeros(own.shape) if state.change is None else state.change
    weight = 1 / network.change_sigma[own]
    r, j, column = change[own] * weight, units.change[own] * weight, layout.columns.change[own]
    h_dd[column, column] += j**2
    g_d[column] += j * r
    return 0.5 * float((r * r).sum())


def _bars(network: Network, layout: Layout, state: NetworkState, units: Units, into: Into) -> float:
    h_dd, _, g_d, _ = into
    bars, cost = network.bars, 0.0
    for a, b, length, sigma in zip(bars.first, bars.second, bars.length, bars.sigma, strict=True):
        arm = state.points[a] - state.points[b]
        distance = float(np.sqrt(arm @ arm))
        r = (distance - length) / sigma
        j = np.concatenate([arm, -arm]) * (units.point / (distance * sigma))
        j[:3] *= ~network.held[a]
        j[3:] *= ~network.held[b]
        starts = (layout.columns.point[a], layout.columns.point[b])
        # In ascending order: only the upper triangle is kept.
        parts = sorted((s, j[3 * n : 3 * n + 3]) for n, s in enumerate(starts) if s >= 0)
        for n, (s, u) in enumerate(parts):
            g_d[s : s + 3] += u * r
            h_dd[s : s + 3, s : s + 3] += np.triu(np.outer(u, u))
            for t, v in parts[n + 1 :]:
                h_dd[s : s + 3, t : t + 3] += np.outer(u, v)
        cost += 0.5 * r * r
    return cost
