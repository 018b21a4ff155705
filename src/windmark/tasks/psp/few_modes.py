"""A calibration whose shared error has few columns: a field has room for 30, and others need it too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.paint import NodeField, PressureMap, SternVolmer, TunnelGain, pressure_map
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


_PSF_Pa = 47.880259
_OF_KELVIN = {"K": (1.0, 0.0), "degC": (1.0, -273.15), "degF": (1.8, -459.67)}
"""Factor and offset from kelvin to the units of a gain."""


def gain_pressure(gain: TunnelGain, ratio: NodeField, temperature: NodeField, steady: NodeField) -> PressureMap:
    """`TunnelGain.pressure_map` in pascals from kelvin and pascals, whatever units the gain has."""
    factor, offset = _OF_KELVIN[gain.temperature_unit]
    unit = {"Pa": 1.0, "psf": _PSF_Pa}[gain.pressure_unit]
    warm = temperature.applied(temperature.value * factor + offset, factor, unit=gain.temperature_unit)
    about = steady.applied(steady.value / unit, 1 / unit, unit=gain.pressure_unit)
    out = gain.pressure_map(ratio, warm, about)
    return PressureMap(out.field.applied(out.field.value * unit, unit, unit="Pa"), out.flags)
