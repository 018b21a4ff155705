"""A calibration whose shared error has few columns: a field has room for 30, and others need it too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.paint import NodeField, PressureMap, SternVolmer, pressure_map
from windmark.paint.modes import principal_axes

Array = NDArray[np.float64]

COLUMNS = 6
"""Of the calibration: the nodes of a point are at nearly one temperature, where powers of pressure are all there is."""


def pressure_of(law: SternVolmer, ratio: NodeField, temperature: NodeField, p_off: float, t_off: float) -> PressureMap:
    """`pressure_map` with at most `COLUMNS` modes of the calibration; what these leave out counts as noise.

    The directions that are kept are those that change these pressures most.
    """
    if law.cov is None or len(law.cov) <= COLUMNS:
        return pressure_map(law, ratio, temperature, p_off=p_off, t_off=t_off)
    axes = principal_axes(law.cov)
    slopes = np.nan_to_num(law.invert(ratio.value, temperature.value, p_off=p_off, t_off=t_off).by_coefficients)
    _, turn = np.linalg.eigh((slopes @ axes).T @ (slopes @ axes))
    turned = axes @ turn[:, ::-1]
    few = replace(law, cov=turned[:, :COLUMNS] @ turned[:, :COLUMNS].T)
    out = pressure_map(few, ratio, temperature, p_off=p_off, t_off=t_off)
    rest = np.where(out.field.known, ((slopes @ turned[:, COLUMNS:]) ** 2).sum(axis=1), 0.0)
    return PressureMap(replace(out.field, white=out.field.white + rest), out.flags)
