"""How far the pictures of one mean are apart: pictures of two states have a mean, too, which is that of neither."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Scatter:
    """Of the pictures of one camera and kind, each brought to the mean light.

    Parameters
    ----------
    times : scatter of a typical node from picture to picture over what its noise says
    part : what noise does not explain of it, relative to the light
    groups : names of the pictures in the two sets that are farthest apart
    """

    times: float
    part: float
    groups: tuple[tuple[str, ...], tuple[str, ...]]


def scatter_of(values: Array, variances: Array, names: Sequence[str]) -> Scatter | None:
    """The scatter of F pictures at N nodes; None for one picture, or where no node is shown by all.

    Of a typical node (medians): a few of them, at markers or at a shock that moves, do not make pictures of two states.

    Parameters
    ----------
    values : (F, N) light, of even lamps
    variances : (F, N) by noise alone
    names : (F,) of the pictures
    """
    from scipy.special import chdtri

    on = (np.isfinite(values) & (values > 0) & (variances > 0)).all(axis=0)
    count = len(values)
    if count < 2 or not on.any():
        return None
    middle = values[:, on].mean(axis=0)
    off = values[:, on] / middle - 1
    noise = variances[:, on].mean(axis=0) / middle**2
    usual = float(chdtri(count - 1, 0.5))  # the median of the sum of squares over the noise, were there noise alone
    square = (off**2).sum(axis=0) / usual
    times = float(np.sqrt(np.median(square / noise)))
    part = float(np.sqrt(max(np.median(square) - np.median(noise), 0.0)))
    return Scatter(times, part, _groups(off, names))


def _groups(off: Array, names: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The two sets on both sides of the widest gap along the direction in which the pictures differ most."""
    place = np.linalg.eigh(off @ off.T)[1][:, -1]
    order = np.argsort(place, kind="stable")
    cut = int(np.argmax(np.diff(place[order]))) + 1
    first, second = (tuple(names[k] for k in np.sort(part)) for part in (order[:cut], order[cut:]))
    return (first, second) if names[0] in first else (second, first)
