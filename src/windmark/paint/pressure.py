"""Ratio and temperature of nodes to pressure, with everything that the pressure's error shares between nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError
from windmark.paint.modes import NodeField, combined
from windmark.paint.stern_volmer import NO_RATIO, NO_REFERENCE, NO_TEMPERATURE, SternVolmer
from windmark.scene.shown import check_kinds

Array = NDArray[np.float64]
Flags = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class PressureMap:
    """Pressure on N nodes.

    Parameters
    ----------
    field : pressure with its uncertainty
    flags : (N,) uint8, sums of `stern_volmer.FLAGS`: outside the calibrated range, or why there is no value
    """

    field: NodeField
    flags: Flags


def pressure_map(
    law: SternVolmer,
    ratio: NodeField,
    temperature: NodeField,
    *,
    p_off: float | None = None,
    p_off_sigma: float = 0.0,
    t_off: NodeField | float | None = None,
    t_off_sigma: float = 0.0,
) -> PressureMap:
    """Pressure from the ratio by a calibrated paint.

    Parameters
    ----------
    law : the calibration; its covariance becomes the modes ``calibration:k``
    ratio : (N) I_off / I_on
    temperature : (N) of the surface, wind on, in the law's unit
    p_off, p_off_sigma : pressure of the wind-off picture (mode ``wind-off pressure``); None: the law's p_ref
    t_off : temperature of the wind-off picture, a field of N nodes or one number with ``t_off_sigma`` (mode
        ``wind-off temperature``); None: the law's t_ref. An error that wind-on and wind-off temperature share must be
        a mode of the same name in both fields

    Returns
    -------
    PressureMap; nodes without ratio or temperature are NaN and flagged, never taken at a temperature of their own.

    Raises
    ------
    ValueError
        For fields of different lengths or a temperature in another unit.

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> paint = wm.SternVolmer(np.array([[0.2, 0.0], [0.8, 0.005]]), 1e5, 300.0, (2e4, 1.2e5), (290.0, 320.0))
    >>> ratio = wm.NodeField.make([0.6, 1.0, 9.0])
    >>> result = wm.pressure_map(paint, ratio, wm.given_temperature(300.0, count=3))
    >>> result.field.value.round(3).tolist(), result.flags.tolist()
    ([50000.0, 100000.0, 1100000.0], [0, 0, 1])
    """
    check_kinds("pressure_map", law=(law, SternVolmer), ratio=(ratio, NodeField), temperature=(temperature, NodeField))
    _same_unit(temperature, law.temperature_unit)
    if isinstance(t_off, NodeField):
        _same_unit(t_off, law.temperature_unit)
        if t_off_sigma:
            raise UsageError("pressure_map: t_off_sigma belongs to one number; a field has a sigma of its own")
        cold = t_off
    else:
        cold = NodeField.make(np.full(len(ratio), law.t_ref if t_off is None else t_off), unit=law.temperature_unit)
        cold = cold.with_mode("wind-off temperature", t_off_sigma) if t_off_sigma else cold
    for name, part in (("temperature", temperature), ("t_off", cold)):
        if len(part) != len(ratio):
            raise ValueError(f"pressure_map: {name} must have {len(ratio)} nodes, got {len(part)}")
    p0 = law.p_ref if p_off is None else p_off
    inv = law.invert(ratio.value, temperature.value, p_off=p0, t_off=cold.value)
    parts = [(ratio, inv.by_ratio), (temperature, inv.by_temperature), (cold, inv.by_t_off)]
    out = combined(inv.pressure, parts, unit=law.pressure_unit)
    if p_off_sigma:
        out = out.with_mode("wind-off pressure", _zero_unknown(inv.by_p_off * p_off_sigma))
    if law.cov is not None:
        out = out.with_modes("calibration", _zero_unknown(inv.by_coefficients), law.cov)
    return PressureMap(out, inv.flags)


def _same_unit(field: NodeField, unit: str) -> None:
    if field.unit and unit and field.unit != unit:
        raise UsageError(f"pressure_map: the temperature is in {field.unit}, the calibration in {unit}")


def _zero_unknown(values: Array) -> Array:
    """A node without a value has no error either."""
    return np.where(np.isfinite(values), values, 0.0)


@dataclass(frozen=True, eq=False)
class TunnelGain:
    """The tunnel's gain form: dp / d(ratio) = a + b T + c T^2 + (d + e T + f T^2) p_ss.

    Parameters
    ----------
    coefficients : (6,) a to f
    p_range, t_range : calibrated range of the steady pressure p_ss and of T
    cov : (6, 6); None: exact
    pressure_unit, temperature_unit : of everything. AIAA 2017-1402 has psf and degF

    Source: AIAA 2017-1402. It turns small changes about a known steady pressure into pressure:
    p = p_ss + gain(T, p_ss) (I_ss / I - 1), I_ss being the light of the steady state (a mean over the run).
    """

    coefficients: Array
    p_range: tuple[float, float]
    t_range: tuple[float, float]
    cov: Array | None = None
    pressure_unit: str = "Pa"
    temperature_unit: str = "K"

    def __post_init__(self) -> None:
        c = np.asarray(self.coefficients, dtype=float)
        if c.shape != (6,) or not np.isfinite(c).all():
            raise ValueError(f"TunnelGain: coefficients must be (6,) finite numbers a to f, got {c.shape}")
        object.__setattr__(self, "coefficients", c)
        p, t = (g.ravel() for g in np.meshgrid(np.linspace(*self.p_range, 33), np.linspace(*self.t_range, 33)))
        if not (self.gain(p, t) > 0).all():
            raise UsageError("TunnelGain: the gain must be above zero everywhere in the calibrated range")

    def gain(self, steady: ArrayLike, temperature: ArrayLike) -> Array:
        """(N,) pressure per unit of I_ss / I, at steady pressures and temperatures."""
        return np.asarray(self._terms(steady, temperature) @ self.coefficients)

    def pressure_map(self, ratio: NodeField, temperature: NodeField, steady: NodeField) -> PressureMap:
        """Pressure of N nodes from I_ss / I, the temperature and the steady pressure. NaN and flags as elsewhere."""
        _same_unit(temperature, self.temperature_unit)
        p, t, d = steady.value, temperature.value, ratio.value - 1
        terms = self._terms(p, t)
        gain = terms @ self.coefficients
        c = self.coefficients
        by_t = (c[1] + 2 * c[2] * t + (c[4] + 2 * c[5] * t) * p) * d
        by_p = 1 + (c[3] + c[4] * t + c[5] * t**2) * d
        flags = np.zeros(len(p), np.uint8)
        for bit, bad in ((NO_RATIO, ~(ratio.value > 0)), (NO_TEMPERATURE, ~np.isfinite(t)),
                         (NO_REFERENCE, ~np.isfinite(p)), (1, (p < self.p_range[0]) | (p > self.p_range[1])),
                         (2, (t < self.t_range[0]) | (t > self.t_range[1]))):  # fmt: skip
            flags[bad] |= np.uint8(bit)
        value = np.where(ratio.value > 0, p + gain * d, np.nan)
        out = combined(value, [(ratio, gain), (temperature, by_t), (steady, by_p)], unit=self.pressure_unit)
        if self.cov is not None:
            out = out.with_modes("calibration", _zero_unknown(terms * d[:, None]), self.cov)
        return PressureMap(out, flags)

    @staticmethod
    def _terms(steady: ArrayLike, temperature: ArrayLike) -> Array:
        p, t = np.broadcast_arrays(np.asarray(steady, dtype=float), np.asarray(temperature, dtype=float))
        return np.stack([np.ones(p.shape), t, t * t, p, p * t, p * t * t], axis=-1)
