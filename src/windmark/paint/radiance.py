"""Infrared light to the temperature of the surface: Planck's law in a band, emissivity, reflected surroundings.

What the camera sees is L = transmission (emissivity B(T) + (1 - emissivity) B(T_surroundings)) + (1 - transmission)
B(T_window), with B the radiance of a black body in the camera's band, or the camera's own signal for one (M. Vollmer
and K.-P. Moellmann, Infrared Thermal Imaging, 2018, ch. 2).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError
from windmark.paint.modes import NodeField, combined
from windmark.paint.sensor_radiance import SensorRadiance
from windmark.paint.stern_volmer import NO_RATIO, NO_TEMPERATURE, TEMPERATURE_OUTSIDE

Array = NDArray[np.float64]
Flags = NDArray[np.uint8]

_C1, _C2 = 1.191042972e-16, 1.438776877e-2
"""Radiation constants 2 h c^2 in W m^2 / sr and h c / k in m K (CODATA 2018)."""
_POINTS = 48
_TABLE = 4096


class Radiance(Protocol):
    """A black body's signal by its temperature, rising."""

    def radiance(self, temperature: ArrayLike) -> Array:
        """Signal of black bodies at temperatures (...)."""
        ...

    def slope(self, temperature: ArrayLike) -> Array:
        """Its derivative."""
        ...

    def temperature(self, radiance: ArrayLike) -> Array:
        """Temperatures of black bodies of such signals; NaN where there is none."""
        ...

    @property
    def t_range(self) -> tuple[float, float]:
        """Temperatures for which it is known."""
        ...


@dataclass(frozen=True)
class PlanckBand:
    """A black body in a band of wavelengths, W / (m^2 sr).

    Parameters
    ----------
    low_um, high_um : of the band, in micrometres; the sensitivity is even in between
    t_range : temperatures (K) for which the inverse is tabulated

    Examples
    --------
    >>> import windmark as wm
    >>> band = wm.PlanckBand(8.0, 9.4)
    >>> signal = band.radiance([300.0, 310.0])
    >>> round(float(signal[1] / signal[0]), 2)  # ten kelvin more
    1.2
    >>> band.temperature(signal).round(3).tolist()
    [300.0, 310.0]
    """

    low_um: float
    high_um: float
    t_range: tuple[float, float] = (150.0, 2000.0)

    def __post_init__(self) -> None:
        if not (0 < self.low_um < self.high_um < np.inf and 0 < self.t_range[0] < self.t_range[1]):
            raise UsageError(f"PlanckBand: 0 < low_um < high_um and temperatures in K, got {self}")

    @cached_property
    def _nodes(self) -> tuple[Array, Array]:
        x, w = np.polynomial.legendre.leggauss(_POINTS)
        half = 0.5 * (self.high_um - self.low_um) * 1e-6
        return 0.5e-6 * (self.low_um + self.high_um) + half * x, half * w

    @cached_property
    def _table(self) -> tuple[Array, Array]:
        inverse = np.linspace(1 / self.t_range[1], 1 / self.t_range[0], _TABLE)[::-1]
        return np.log(self.radiance(1 / inverse)), inverse

    def radiance(self, temperature: ArrayLike) -> Array:
        """Radiance at temperatures in K, any shape."""
        t = np.asarray(temperature, dtype=float)[..., None]
        at, w = self._nodes
        return np.asarray((_C1 / at**5 / np.expm1(_C2 / (at * t))) @ w)

    def slope(self, temperature: ArrayLike) -> Array:
        """Its derivative by the temperature."""
        t = np.asarray(temperature, dtype=float)[..., None]
        at, w = self._nodes
        e = np.exp(-_C2 / (at * t))
        return np.asarray((_C1 * _C2 / at**6 / t**2 * e / (1 - e) ** 2) @ w)

    def temperature(self, radiance: ArrayLike) -> Array:
        """Inverse by a table of ln L against 1 / T, in which it is nearly straight; NaN beyond ``t_range``."""
        log, inverse = self._table
        value = np.asarray(radiance, dtype=float)
        with np.errstate(invalid="ignore", divide="ignore"):
            wanted = np.log(np.where(value > 0, value, np.nan))
        return np.asarray(1 / np.interp(wanted, log, inverse, left=np.nan, right=np.nan))


@dataclass(frozen=True, eq=False)
class PolynomialRadiance:
    """A camera's own calibration: signal of a black body = sum of coefficients_k T^k, rising over ``t_range``."""

    coefficients: Array
    t_range: tuple[float, float]

    def __post_init__(self) -> None:
        c = np.asarray(self.coefficients, dtype=float)
        object.__setattr__(self, "coefficients", c)
        if c.ndim != 1 or len(c) < 2 or not self.t_range[0] < self.t_range[1]:
            raise UsageError("PolynomialRadiance: coefficients must be (K + 1,) with K at least 1, t_range must rise")
        if not (self.slope(np.linspace(*self.t_range, _TABLE)) > 0).all():
            raise UsageError("PolynomialRadiance: the signal does not rise with the temperature all over t_range")

    def radiance(self, temperature: ArrayLike) -> Array:
        """Signal at temperatures."""
        return np.asarray(np.polynomial.polynomial.polyval(np.asarray(temperature, dtype=float), self.coefficients))

    def slope(self, temperature: ArrayLike) -> Array:
        """Its derivative."""
        c = self.coefficients[1:] * np.arange(1, len(self.coefficients))
        return np.asarray(np.polynomial.polynomial.polyval(np.asarray(temperature, dtype=float), c))

    def temperature(self, radiance: ArrayLike) -> Array:
        """Inverse: a table and one step of Newton; NaN beyond ``t_range``."""
        grid = np.linspace(*self.t_range, _TABLE)
        value = np.asarray(radiance, dtype=float)
        t = np.interp(value, self.radiance(grid), grid, left=np.nan, right=np.nan)
        return np.asarray(t - (self.radiance(t) - value) / self.slope(t))


def surface_temperature(
    signal: NodeField,
    radiance: Radiance,
    *,
    emissivity: ArrayLike,
    emissivity_sigma: float = 0.0,
    surroundings: float,
    surroundings_sigma: float = 0.0,
    transmission: float = 1.0,
    transmission_sigma: float = 0.0,
    window_temperature: float | None = None,
    unit: str = "K",
) -> tuple[NodeField, Flags]:
    """Temperature of nodes from the infrared signal.

    Parameters
    ----------
    signal : (N) in the unit of ``radiance``
    radiance : `PlanckBand` or `PolynomialRadiance`
    emissivity : (N,) or one number, in (0, 1]; for the viewing angle `dielectric_emissivity`
    emissivity_sigma : error that all nodes share, relative to the emissivity (mode ``emissivity``)
    surroundings, surroundings_sigma : temperature of what the surface reflects, and its error (mode ``surroundings``)
    transmission, window_temperature : of a window; needs its temperature below 1
    transmission_sigma : error of the transmission (mode ``window``)

    Returns
    -------
    (N) temperature, with the errors of a fitted ``radiance`` as the modes ``calibration``, and (N,) flags: 8 no signal
    or emissivity, 4 less of it than is reflected, 2 beyond the radiance's range. NaN with a flag.

    Examples
    --------
    >>> import windmark as wm
    >>> band = wm.PlanckBand(8.0, 9.4)
    >>> signal = wm.NodeField.make(0.9 * band.radiance([300.0, 340.0]) + 0.1 * band.radiance([295.0]), 0.01)
    >>> wall, flags = wm.surface_temperature(signal, band, emissivity=0.9, surroundings=295.0)
    >>> wall.value.round(2).tolist(), flags.tolist()
    ([300.0, 340.0], [0, 0])
    """
    e = np.broadcast_to(np.asarray(emissivity, dtype=float), signal.value.shape)
    if not ((e > 0) & (e <= 1) | np.isnan(e)).all() or not 0 < transmission <= 1:
        raise UsageError("surface_temperature: emissivity and transmission must be above 0 and at most 1")
    if transmission < 1 and window_temperature is None:
        raise UsageError("surface_temperature: a window that takes light gives some back: window_temperature is needed")
    around = float(radiance.radiance(surroundings))
    glass = 0.0 if window_temperature is None else float(radiance.radiance(window_temperature))
    black = ((signal.value - (1 - transmission) * glass) / transmission - (1 - e) * around) / e
    t = radiance.temperature(black)
    flags = np.zeros(len(signal), np.uint8)
    flags[~np.isfinite(signal.value) | ~np.isfinite(e)] |= NO_TEMPERATURE
    flags[~(black > 0)] |= NO_RATIO
    flags[(black > 0) & ~np.isfinite(t)] |= TEMPERATURE_OUTSIDE
    with np.errstate(invalid="ignore", divide="ignore"):
        rise = radiance.slope(np.where(np.isfinite(t), t, surroundings))
        slope = np.where(np.isfinite(t), 1 / (transmission * e * rise), 0.0)
        by_e = np.where(np.isfinite(t), (around - black) / rise, 0.0) * emissivity_sigma
        by_around = np.where(np.isfinite(t), -(1 - e) / (e * rise), 0.0) * float(radiance.slope(surroundings))
    out = combined(t, [(signal, slope)], unit=unit)
    if emissivity_sigma:
        out = out.with_mode("emissivity", by_e)
    if surroundings_sigma:
        out = out.with_mode("surroundings", by_around * surroundings_sigma)
    if transmission_sigma:
        by_window = np.where(np.isfinite(t), slope * (glass - signal.value) / transmission, 0.0)
        out = out.with_mode("window", by_window * transmission_sigma)
    if isinstance(radiance, SensorRadiance) and radiance.cov is not None:
        out = out.with_modes("calibration", _by_calibration(radiance, t, e, surroundings, rise), radiance.cov)
    return out, flags


def _by_calibration(radiance: SensorRadiance, t: Array, e: Array, surroundings: float, rise: Array) -> Array:
    """(N, 3) change of the temperature for the calibration's parameters, at the same signal."""
    on = np.isfinite(t) & np.isfinite(e)
    known = np.where(on, t, surroundings)
    reflected = ((1 - e) / e)[:, None] * radiance.by_parameters(surroundings)
    both = -(radiance.by_parameters(known) + reflected) / rise[:, None]
    return np.where(on[:, None], both, 0.0)
