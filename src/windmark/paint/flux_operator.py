"""Heat flux at given times as a linear function of the samples of the surface temperature, gaps and all.

Between its samples the temperature is taken as straight, so the flux is a weighted sum of the samples: the formula of
Cook and Felderman (AIAA J. 4, 1966) for any times and any wall, see `walls`. A sample that is missing lies on the
straight line between its neighbours. Being linear, the flux has the exact covariance of the samples' errors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import DataError, UsageError
from windmark.paint.walls import Wall

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SAME = 1e-7
"""Differences of times nearer than this part of the run's length are one."""


@dataclass(frozen=True, eq=False)
class FluxOperator:
    """Heat flux of F samples: ``weights @ T - curvature * curved @ T``.

    Parameters
    ----------
    times : (F,) seconds
    start : when the heating began; the mean of the samples until then is the temperature of the whole wall
    weights, curved : (F, F) W / (m^2 K) and W / (m K); rows of NaN until the start
    mean : (F,) weights of the samples in the initial temperature
    """

    times: Array
    start: float
    weights: Array
    curved: Array
    mean: Array

    @property
    def before(self) -> Mask:
        """(F,) samples that say the initial temperature."""
        return before_start(self.times, self.start)

    def bridged(self, missing: Mask) -> tuple[Array, Array, Array]:
        """(F, F) filling, and weights and curved as they are where samples (F,) are missing.

        ``filling`` gives the samples with the missing ones on straight lines; the initial temperature is the mean of
        those that are there, and holds until the start. Nothing is known behind the last sample: rows of NaN there and
        where it is missing.
        """
        filling, weights, curved = np.eye(len(self.times)), self.weights, self.curved
        there = np.flatnonzero(~missing)
        initial = there[self.before[there]]
        if not len(initial):
            raise DataError("no sample says the initial temperature")
        for k in np.flatnonzero(missing):
            filling[k] = 0.0
            after = int(np.searchsorted(there, k))
            if self.before[k]:  # the mean of the others: it then has the weight of none
                filling[k, initial] = 1 / len(initial)
            elif after == len(there):
                filling[k] = np.nan
            else:
                a, b = there[after - 1], there[after]
                begins = self.start if self.before[a] else self.times[a]
                part = (self.times[k] - begins) / (self.times[b] - begins)
                if self.before[a]:  # from the wall's initial temperature at the start, not at the last sample before it
                    filling[k, initial] = (1 - part) / len(initial)
                else:
                    filling[k, a] = 1 - part
                filling[k, b] = part
        zeroed = np.nan_to_num(filling)
        out = [np.where(missing[:, None], np.nan, m @ zeroed) for m in (weights, curved)]
        return filling, out[0], out[1]


def before_start(times: ArrayLike, start: float) -> Mask:
    """(F,) samples until the start, those included that are after it by rounding alone."""
    t = np.asarray(times, dtype=float)
    return np.asarray(t <= start + SAME * (float(t.max()) - float(t.min())))


def flux_operator(times: ArrayLike, wall: Wall, start: float) -> FluxOperator:
    """Make it.

    Parameters
    ----------
    times : (F,) seconds, increasing
    wall : what is below the surface
    start : when the heating began, between the first sample and the last

    Raises
    ------
    DataError
        For times that do not increase, or a start that leaves no sample before or after it.
    """
    t = np.asarray(times, dtype=float)
    if t.ndim != 1 or not np.isfinite(t).all():
        raise UsageError(f"flux_operator: times must be (F,) numbers, got {t.shape}")
    if (np.diff(t) <= 0).any():
        k = int(np.argmax(np.diff(t) <= 0))
        raise DataError(f"times must increase: {t[k + 1]:g} s comes after {t[k]:g} s")
    before = before_start(t, start)
    if not before.any() or before.all():
        raise DataError(
            f"the heating begins at {start:g} s, the samples are from {t[0]:g} to {t[-1]:g} s: expected at least one "
            "before it, for the initial temperature, and one after it"
        )
    knots = np.concatenate([[start], t[~before]])
    mean = before / before.sum()
    # Samples to knots: the first one is the mean of the samples until the start.
    to_knots = np.zeros((len(knots), len(t)))
    to_knots[0] = mean
    to_knots[1:, ~before] = np.eye(len(knots) - 1)
    made = []
    for response in (wall.ramp_response, wall.curved_ramp_response):
        full = np.full((len(t), len(t)), np.nan)
        full[~before] = _at_knots(knots, response)[1:] @ to_knots
        made.append(full)
    return FluxOperator(t, float(start), made[0], made[1], mean)


def _at_knots(knots: Array, response: Callable[[Array], Array]) -> Array:
    """(K, K) flux at each knot for a kelvin at each knot."""
    apart = knots[:, None] - knots[None, :]
    on = apart > 0
    values, number = np.unique(np.round(apart[on] / (SAME * (knots[-1] - knots[0]))), return_inverse=True)
    exact = np.zeros(len(values))
    exact[number] = apart[on]
    ramp = np.zeros(apart.shape)
    ramp[on] = response(exact)[number]
    # A rise of 1 K between knots j - 1 and j, seen at knot i.
    rise = np.tril((ramp[:, :-1] - ramp[:, 1:]) / np.diff(knots), -1)
    out = np.zeros(apart.shape)
    out[:, 1:] += rise
    out[:, :-1] -= rise
    return out
