"""Heat flux of nodes from their histories of temperature, gaps and all, with the covariance of what goes in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.paint import FluxOperator, Wall
from windmark.tasks.infrared.flags import BEFORE, BRIDGED, CURVED, GAP, LATE, NO_START

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Flags = NDArray[np.uint16]

BEND = 0.3
"""Curvature times the depth of the heat up to which its first order counts (off by some 2 % there)."""
TESTED = 400
"""Whole histories on which a pattern of gaps is tried."""
TIME_STEP = "time step"
"""Name of the cause: what straight lines between samples leave."""
LATE_FOURIER = 0.2
"""Fourier number from which the back of a semi-infinite wall is felt, see `paint.heat_flux`."""


@dataclass(frozen=True, eq=False)
class HistoryFlux:
    """Heat flux of H nodes in F frames.

    Parameters
    ----------
    flux : (H, F) W / m2, positive into the wall; NaN with a flag of `FLAGS`
    white : (H, F) variance of what is independent between nodes; of bridged frames what the straight lines leave
    modes : name -> (H, F) change for one sigma of each cause
    flags : (H, F)
    """

    flux: Array
    white: Array
    modes: Mapping[str, Array]
    flags: Flags


def history_flux(
    temperature: Array,
    white: Array,
    modes: Mapping[str, Array],
    operator: FluxOperator,
    wall: Wall,
    *,
    curvature: Array,
    longest_gap: int,
    once: Mapping[str, Array] | None = None,
    tried: Array | None = None,
    behind: Mask | None = None,
) -> HistoryFlux:
    """Heat flux of histories.

    Parameters
    ----------
    temperature : (H, F) kelvin, NaN where a node has none
    white : (H, F) variance that is independent between nodes and frames
    modes : name -> (H, F) change for one sigma of causes that last over all frames
    operator, wall : see `flux_operator`
    curvature : (H,) 1 / m, NaN where unknown: no correction, flagged
    longest_gap : frames in a row that may be missing; behind a longer gap there is no flux
    once : name -> (H, F) causes that are new in every frame (registration): of each the frame's own and the one
        before are modes, ``NAME now`` and ``NAME before``, the rest counts as noise
    tried : (K, F) whole histories of this wall on which gaps are tried; None: there are none, and no gap is bridged
    behind : (H, F) samples behind a gap that is too long for another reason (`behind_gaps` in more frames than these)

    Notes
    -----
    A gap is filled by a straight line. What that leaves is measured: the same gap is cut into whole histories, and the
    mean square of what changes, less what noise explains, is added to the variance. What the straight lines between
    samples leave is measured as well: by how much the flux of whole histories, over its own size, changes with every
    second sample left out. That is the mode ``time step``; it counts where the flux begins.
    """
    missing = ~np.isfinite(temperature)
    flags = np.zeros(temperature.shape, np.uint16)
    flags[:, operator.before] |= BEFORE
    flags[missing[:, operator.before].all(axis=1)] |= NO_START
    cut = behind_gaps(missing, operator.before, longest_gap if tried is not None and len(tried) else 0)
    cut = cut if behind is None else cut | behind
    flags[cut & ~missing] |= GAP
    missing = missing | cut
    once = once or {}
    names = (*modes, *(f"{n} {word}" for n in once for word in ("now", "before")), TIME_STEP)
    shape = temperature.shape
    out = HistoryFlux(np.full(shape, np.nan), np.zeros(shape), {name: np.zeros(shape) for name in names}, flags)
    patterns, number = np.unique(missing, axis=0, return_inverse=True)
    number = number.ravel()
    for k, pattern in enumerate(patterns):
        if pattern[operator.before].all():
            continue
        _one_pattern(out, np.flatnonzero(number == k), pattern, temperature, white, modes, once, operator, curvature,
                     tried)  # fmt: skip
    if tried is not None and len(tried):
        known = np.isfinite(out.flux)
        size = np.sqrt(np.where(known, out.flux, 0.0) ** 2 @ np.ones(shape[1]) / np.maximum(known.sum(axis=1), 1))
        out.modes[TIME_STEP][:] = np.where(known, size[:, None] * _left_by_steps(operator, tried), 0.0)
    since = np.maximum(operator.times - operator.start, 0.0)
    out.flags[:, wall.fourier_number(since) > LATE_FOURIER] |= LATE
    sharp = ~(np.abs(curvature)[:, None] * wall.heated_depth(since) <= BEND)
    out.flags[sharp] |= CURVED
    return out


def behind_gaps(missing: Mask, before: Mask, longest: int) -> Mask:
    """(H, F) samples behind more than ``longest`` missing ones in a row, from the first sample with heating on."""
    run = np.zeros(len(missing), int)
    ended = np.zeros(len(missing), bool)
    out = np.zeros(missing.shape, bool)
    for f in np.flatnonzero(~before):
        run = np.where(missing[:, f], run + 1, 0)
        ended |= run > longest
        out[:, f] = ended
    return out


def _one_pattern(
    out: HistoryFlux, nodes: NDArray[np.intp], pattern: Mask, temperature: Array, white: Array,
    modes: Mapping[str, Array], once: Mapping[str, Array], operator: FluxOperator, curvature: Array,
    tried: Array | None,
) -> None:  # fmt: skip
    """The nodes that lack the same frames."""
    filling, w, c = operator.bridged(pattern)
    there = ~pattern & ~operator.before
    rows = np.flatnonzero(there)
    w, c, bend = w[rows], c[rows], np.nan_to_num(curvature[nodes])

    def through(values: Array) -> Array:
        v = np.where(pattern, 0.0, values[nodes])
        return np.asarray(v @ w.T - bend[:, None] * (v @ c.T))

    # Temperatures are taken relative to the first one: the weights' sum is zero, their terms are large.
    level = np.nanmean(temperature[nodes][:, operator.before & ~pattern], axis=1)[:, None]
    at = np.ix_(nodes, rows)
    v = np.where(pattern, 0.0, temperature[nodes] - level)
    out.flux[at] = v @ w.T - bend[:, None] * (v @ c.T)
    var = np.where(pattern, 0.0, white[nodes])
    square = _squared(var, w, c, bend)
    for name, values in once.items():
        own = np.where(pattern, 0.0, values[nodes])
        square += _squared(own**2, w, c, bend)
        for shift, word in ((0, "now"), (1, "before")):
            k = rows - shift
            weight = w[np.arange(len(rows)), k] - bend[:, None] * c[np.arange(len(rows)), k]
            column = weight * own[:, k]
            out.modes[f"{name} {word}"][at] = column
            square -= column**2
    for name, values in modes.items():
        out.modes[name][at] = through(values)
    if pattern[~operator.before].any() and tried is not None:
        left = _left_by_lines(operator, filling, rows, tried)
        square += left**2
        noise = np.sqrt(np.median(square, axis=0))
        behind = np.maximum.accumulate(pattern & ~operator.before)[rows]
        out.flags[np.ix_(nodes, rows[behind & (left > 0.1 * noise)])] |= BRIDGED
    out.white[at] = np.maximum(square, 0.0)


def _left_by_steps(operator: FluxOperator, tried: Array) -> Array:
    """(F,) relative error of the flux for the time between samples, from whole histories (K, F).

    Of a quantity whose error goes with the spacing (a flux that jumps) it is the change when every second sample is
    left out; where the flux is smooth the error is a third of it.
    """
    heated, change = np.flatnonzero(~operator.before), np.zeros_like(operator.weights)
    for parity in (0, 1):
        missing = np.zeros(len(operator.times), bool)
        missing[heated[np.arange(len(heated)) % 2 != parity]] = True
        half = operator.bridged(missing)[1]
        rows = np.flatnonzero(~missing & ~operator.before)
        change[rows] = operator.weights[rows] - half[rows]
    change[heated[0]] = 0.0  # nothing lies between it and the start
    level = tried[:, operator.before].mean(axis=1)[:, None]
    flux = (tried - level) @ np.nan_to_num(operator.weights).T
    size = np.sqrt(np.mean(flux[:, heated] ** 2, axis=1))
    seen = ((tried - level) @ change.T) / size[:, None]
    noise = _noise(tried) * (change**2).sum(axis=1) * np.mean(1 / size**2)
    left = np.where(operator.before, 0.0, np.sqrt(np.maximum(np.mean(seen**2, axis=0) - noise, 0.0)))
    # The error and its estimate pass through zero, not in the same frame: it is as large as beside it.
    return np.maximum(left, np.maximum(np.append(left[1:], 0.0), np.append(0.0, left[:-1])))


def _noise(tried: Array) -> float:
    """Variance of the noise of whole histories (K, F), from their second differences."""
    second = tried[:, 2:] - 2 * tried[:, 1:-1] + tried[:, :-2]
    return float(np.median(np.abs(second)) / 0.6745) ** 2 / 6 if second.size else 0.0


def _squared(var: Array, w: Array, c: Array, bend: Array) -> Array:
    """(H, R) variance of the flux from variances (H, F) of independent samples."""
    total = var @ (w**2).T
    if bend.any():
        total = total - 2 * bend[:, None] * (var @ (w * c).T) + bend[:, None] ** 2 * (var @ (c**2).T)
    return np.asarray(total)


def _left_by_lines(operator: FluxOperator, filling: Array, rows: NDArray[np.intp], tried: Array) -> Array:
    """(R,) standard deviation of what straight lines leave in the flux, from whole histories (K, F)."""
    change = operator.weights[rows] @ (np.eye(len(filling)) - np.nan_to_num(filling))
    seen = (tried - tried[:, :1]) @ change.T
    return np.sqrt(np.maximum(np.mean(seen**2, axis=0) - _noise(tried) * (change**2).sum(axis=1), 0.0))
