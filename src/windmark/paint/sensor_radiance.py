"""A camera's own answer to black bodies, from a table of them: S = R / (exp(B / T) - 1) + O.

The form of Planck's law at one effective wavelength, whose B and R the camera's band and lens decide and O its
electronics (Sakuma and Hattori, Temperature: Its Measurement and Control 5, 1982; the calibration of makers' cameras).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError, g3
from windmark.paint.refusal import NotFitted

Array = NDArray[np.float64]

LEAST_ROWS = 4
BEYOND = 0.05
"""The law holds so far beyond the table, as part of its range of temperatures."""
SPREAD = 5.0
"""Black bodies must span so many kelvin."""


@dataclass(frozen=True, eq=False)
class SensorRadiance:
    """S = R / (exp(B / T) - 1) + O.

    Parameters
    ----------
    r, b, o : R in the signal's unit, B in K, O in the signal's unit; R and B above zero
    t_range : temperatures (K) for which it holds
    cov : (3, 3) of (ln R, ln B, O); None: taken as exact
    rms : what a fit left, in the signal's unit
    """

    r: float
    b: float
    o: float
    t_range: tuple[float, float]
    cov: Array | None = None
    rms: float = 0.0

    def __post_init__(self) -> None:
        if not (self.r > 0 and self.b > 0 and np.isfinite(self.o) and 0 < self.t_range[0] < self.t_range[1]):
            raise UsageError(f"SensorRadiance: R and B must be above zero, temperatures in K and rising, got {self}")

    def radiance(self, temperature: ArrayLike) -> Array:
        """Signal of black bodies at temperatures (...) in K."""
        return np.asarray(self.r / np.expm1(self.b / np.asarray(temperature, dtype=float)) + self.o)

    def slope(self, temperature: ArrayLike) -> Array:
        """Its derivative by the temperature."""
        t = np.asarray(temperature, dtype=float)
        e = np.exp(-self.b / t)
        return np.asarray(self.r * self.b / t**2 * e / (1 - e) ** 2)

    def temperature(self, radiance: ArrayLike) -> Array:
        """Inverse; NaN beyond ``t_range``."""
        above = np.asarray(radiance, dtype=float) - self.o
        with np.errstate(invalid="ignore", divide="ignore"):
            t = self.b / np.log1p(self.r / np.where(above > 0, above, np.nan))
        return np.asarray(np.where((t >= self.t_range[0]) & (t <= self.t_range[1]), t, np.nan))

    def by_parameters(self, temperature: ArrayLike) -> Array:
        """(..., 3) derivative of the signal by (ln R, ln B, O)."""
        t = np.asarray(temperature, dtype=float)
        return np.stack([self.radiance(t) - self.o, -t * self.slope(t), np.ones(t.shape)], axis=-1)


def fit_sensor_radiance(
    temperature: ArrayLike, signal: ArrayLike, *, signal_sigma: ArrayLike | None = None
) -> SensorRadiance | NotFitted:
    """The camera's law from a table of black bodies.

    Parameters
    ----------
    temperature, signal : (N,) kelvin, and what the camera said
    signal_sigma : (N,) or one number; None: the scatter about the law says it

    Returns
    -------
    SensorRadiance; or NotFitted for fewer than four rows, temperatures that span less than 5 K, or a signal that does
    not rise with the temperature.
    """
    from scipy.optimize import least_squares

    t, s = np.asarray(temperature, dtype=float), np.asarray(signal, dtype=float)
    if t.ndim != 1 or t.shape != s.shape or not (np.isfinite(t).all() and np.isfinite(s).all()):
        raise UsageError(f"fit_sensor_radiance: temperature and signal must be (N,) numbers, got {t.shape}, {s.shape}")
    span = float(np.ptp(t)) if len(t) else 0.0
    if len(np.unique(t)) < LEAST_ROWS or span < SPREAD:
        return NotFitted(
            f"{len(np.unique(t))} black bodies over {g3(span)} K say no law of three numbers; {LEAST_ROWS} over "
            f"{SPREAD:g} K are needed"
        )
    if not (t > 0).all() or np.polyfit(t, s, 1)[0] <= 0:
        return NotFitted("the signal does not rise with the temperature")
    sigma = np.ones(len(t)) if signal_sigma is None else np.broadcast_to(np.asarray(signal_sigma, float), t.shape)
    middle = float(t.mean())

    def law(b: float) -> tuple[Array, Array]:
        """R and O by linear least squares for a B, and what is left over sigma."""
        shape = np.expm1(b / middle) / np.expm1(b / t)
        design = np.stack([shape, np.ones(len(t))], axis=1) / sigma[:, None]
        found = np.linalg.lstsq(design, s / sigma, rcond=None)[0]
        return found, design @ found - s / sigma

    best = least_squares(lambda x: law(float(np.exp(x[0])))[1], [np.log(1450.0)], x_scale=0.1,
                         bounds=(np.log(100.0), np.log(2e4)))  # fmt: skip
    b = float(np.exp(best.x[0]))
    (scale, o), left = law(b)
    if not scale > 0:
        return NotFitted("the signal does not rise with the temperature")
    margin = BEYOND * span
    out = SensorRadiance(float(scale * np.expm1(b / middle)), b, float(o),
                         (max(float(t.min()) - margin, 1.0), float(t.max()) + margin),
                         rms=float(np.sqrt(np.mean((left * sigma) ** 2))))  # fmt: skip
    design = out.by_parameters(t) / sigma[:, None]
    norm = np.linalg.norm(design, axis=0)
    inverse = np.linalg.pinv((design / norm).T @ (design / norm), hermitian=True)
    own = float((left**2).sum()) / max(len(t) - 3, 1)
    factor = own if signal_sigma is None else max(own, 1.0)
    return SensorRadiance(out.r, out.b, out.o, out.t_range, inverse / np.outer(norm, norm) * factor, out.rms)
